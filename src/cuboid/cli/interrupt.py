"""Ctrl-C ends a run; its results so far are written."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

STDERR = 2
NOTICE = b"\ncuboid: ending after this frame and writing the results so far; a second Ctrl-C discards them\n"


class Interruption:
    """Whether a signal asked the run to end; call it to know.

    Attributes
    ----------
    status : int
        Exit status of a run that was ended so: 128 and the number of the signal, as shells have it.
    tell : callable
        Called at the first signal, inside its handler.
    """

    def __init__(self) -> None:
        self.status = 0
        self.tell: Callable[[], None] = lambda: None

    def __call__(self) -> bool:
        """Return whether the run is to end."""
        return self.status != 0

    def handle(self, number: int, frame: FrameType | None) -> None:
        """Note the signal; the second one ends the program at once."""
        if self.status:
            raise KeyboardInterrupt
        self.status = 128 + number
        self.tell()
        os.write(STDERR, NOTICE)  # print may be at work already


@contextmanager
def interruptible() -> Iterator[Interruption]:
    """Let SIGINT and SIGTERM ask for the end of what runs inside, instead of breaking it off."""
    interruption = Interruption()
    before = {number: signal.signal(number, interruption.handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield interruption
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
