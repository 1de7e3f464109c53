"""The time that compiling kernels takes, kept apart from the time of the work itself."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

# Called when a kernel begins to compile and when one is compiled.
Listener = Callable[[], None]


class _Thread(threading.local):
    """Seconds that this thread has compiled for, when it began to, and how deep: kernels compile what they call."""

    seconds = 0.0
    begun_s = 0.0
    depth = 0


_thread = _Thread()
_listeners: list[Listener] = []


def working_s() -> float:
    """Return the seconds of a steady clock that stands still while this thread compiles kernels."""
    return time.perf_counter() - compiling_s()


def compiling_s() -> float:
    """Return the seconds for which this thread has compiled kernels."""
    return _thread.seconds + (time.perf_counter() - _thread.begun_s if _thread.depth else 0.0)


def compiling() -> bool:
    """Tell whether this thread compiles a kernel."""
    return _thread.depth > 0


@contextmanager
def listening(listener: Listener) -> Iterator[None]:
    """Call `listener` when a kernel begins to compile and when one is compiled."""
    _listeners.append(listener)
    try:
        yield
    finally:
        _listeners.remove(listener)


def begin() -> None:
    """Note that this thread begins to compile a kernel."""
    if _thread.depth == 0:
        _thread.begun_s = time.perf_counter()
    _thread.depth += 1
    _tell()


def end() -> None:
    """Note that this thread has compiled the kernel that it began last."""
    _thread.depth -= 1
    if _thread.depth == 0:
        _thread.seconds += time.perf_counter() - _thread.begun_s
    _tell()


def _tell() -> None:
    for listener in _listeners:
        listener()
