"""The number of threads that this process and its libraries may use, and their memory."""

from __future__ import annotations

import ctypes
import os
import sys
from contextlib import suppress

# Environment variables that OpenMP, the linear algebra libraries of NumPy and SciPy, and numba read at first import.
POOLS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMEXPR_NUM_THREADS",
    "NUMBA_NUM_THREADS",
)
# Parameter of glibc's `mallopt`: the largest number of heaps (malloc.h).
M_ARENA_MAX = -8


def cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def limit_threads(threads: int) -> None:
    """Limit the thread pool of every library to its part of `threads`; call this before importing the libraries.

    All threads of the process share one heap.
    """
    _share_heap()
    threads_of_pool = max(1, threads - 1)  # one of them prepares frames ahead, if there are two or more
    for name in POOLS:
        os.environ[name] = str(threads_of_pool)
    import cv2

    cv2.setNumThreads(threads_of_pool)


def _share_heap() -> None:
    """Let all threads share one heap: otherwise each has its own, and what one frees is lost to the others."""
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):  # another C library than glibc
            ctypes.CDLL(None).mallopt(M_ARENA_MAX, 1)


def return_free_memory() -> None:
    """Return the free memory of the heap to the system, after a stage that needed more than the next ones."""
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).malloc_trim(0)
