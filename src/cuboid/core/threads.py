"""How many threads this process may use, and those of the libraries under it."""

from __future__ import annotations

import os

# Environment variables that OpenMP, the linear algebra under NumPy and SciPy, and numba read at their first import.
POOLS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMEXPR_NUM_THREADS",
    "NUMBA_NUM_THREADS",
)


def cores() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def pool_size(threads: int) -> int:
    """Return what a library may use of `threads`, one of which decodes ahead where there are two."""
    return max(1, threads - 1)


def limit_threads(threads: int) -> None:
    """Limit every library's pool to its part of `threads`; call it before they are imported."""
    threads_of_pool = pool_size(threads)
    for name in POOLS:
        os.environ[name] = str(threads_of_pool)
    import cv2

    cv2.setNumThreads(threads_of_pool)
