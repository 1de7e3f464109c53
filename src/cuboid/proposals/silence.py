"""Keeps what native code prints off the program's own output."""

from __future__ import annotations

import ctypes
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_STDOUT = 1
_turn = threading.Lock()


@contextmanager
def silent_stdout() -> Iterator[None]:
    """Send what any code of this process writes to standard output nowhere, native code included.

    Python's and C's buffers are emptied before and after, so that no line of either side goes the wrong way.
    """
    import sys

    with _turn:
        _flush(sys.stdout)
        try:
            kept = os.dup(_STDOUT)
        except OSError:  # standard output is closed: there is nothing to keep clean
            yield
            return
        nowhere = os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(nowhere, _STDOUT)
            yield
        finally:
            _flush(None)
            os.dup2(kept, _STDOUT)
            os.close(kept)
            os.close(nowhere)


def _flush(stream: object) -> None:
    flush = getattr(stream, "flush", None)
    if flush is not None:
        flush()
    # A null pointer: all of C's streams.
    ctypes.CDLL(None).fflush(None)
