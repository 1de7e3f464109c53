"""The compile time of kernels, measured apart from the time of the work itself."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

# Called when the compilation of a kernel begins and when it ends.
Listener = Callable[[], None]


class _Thread(threading.local):
    """Compile time of this thread, begin of the current compilation, and its depth: kernels compile their callees."""

    seconds = 0.0
    begun_s = 0.0
    depth = 0


_thread = _Thread()
_listeners: list[Listener] = []


def working_s() -> float:
    """Return a steady clock in seconds that stands still while this thread compiles kernels."""
    return time.perf_counter() - compiling_s()


def compiling_s() -> float:
    """Return the total time for which this thread has compiled kernels, seconds."""
    return _thread.seconds + (time.perf_counter() - _thread.begun_s if _thread.depth else 0.0)


def waited_for_compiling(seconds: float) -> None:
    """Record that this thread has waited while another one compiled kernels for it."""
    _thread.seconds += seconds


def compiling() -> bool:
    """Return whether this thread is compiling a kernel."""
    return _thread.depth > 0


@contextmanager
def listening(listener: Listener) -> Iterator[None]:
    """Call `listener` when the compilation of a kernel begins and when it ends."""
    _listeners.append(listener)
    try:
        yield
    finally:
        _listeners.remove(listener)


def begin() -> None:
    """Record that this thread begins to compile a kernel."""
    if _thread.depth == 0:
        _thread.begun_s = time.perf_counter()
    _thread.depth += 1
    _tell()


def end() -> None:
    """Record that this thread has finished the kernel whose compilation it began last."""
    _thread.depth -= 1
    if _thread.depth == 0:
        _thread.seconds += time.perf_counter() - _thread.begun_s
    _tell()


def _tell() -> None:
    for listener in _listeners:
        listener()
