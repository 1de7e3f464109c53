"""The number of threads that this process and its libraries may use."""

from __future__ import annotations

import os

# Environment variables that OpenMP, the linear algebra libraries of NumPy and SciPy, and numba read at first import.
POOLS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMEXPR_NUM_THREADS",
    "NUMBA_NUM_THREADS",
)


def cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def pool_size(threads: int) -> int:
    """Return the number of threads for a library: one of `threads` decodes frames ahead, if there are two or more."""
    return max(1, threads - 1)


def limit_threads(threads: int) -> None:
    """Limit the thread pool of every library to its part of `threads`; call this before importing the libraries."""
    threads_of_pool = pool_size(threads)
    for name in POOLS:
        os.environ[name] = str(threads_of_pool)
    import cv2

    cv2.setNumThreads(threads_of_pool)
