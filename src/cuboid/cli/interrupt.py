"""Ctrl-C ends a run, and the results so far are written."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cuboid.results.files import RunReport

STDERR = 2
NOTICE = b"\ncuboid: ending after this frame and writing the results so far; a second Ctrl-C discards them\n"


class Interruption:
    """Whether a signal has ended the run; call the object to find out.

    Attributes
    ----------
    status : int
        Exit status of a run that a signal ended: 128 plus the number of the signal, as in shells. 0 without a signal.
    on_signal : callable
        Called at the first signal, inside its handler.
    """

    def __init__(self) -> None:
        self.status = 0
        self.on_signal: Callable[[], None] = lambda: None

    def __call__(self) -> bool:
        """Return whether the run must end."""
        return self.status != 0

    def handle(self, number: int, frame: FrameType | None) -> None:
        """Store the first signal; a second one ends the program at once."""
        if self.status:
            raise KeyboardInterrupt
        self.status = 128 + number
        self.on_signal()
        os.write(STDERR, NOTICE)  # the signal may have interrupted a print

    def status_of(self, report: RunReport) -> int:
        """Return the exit status of a run; if it is incomplete, say that it was interrupted."""
        if report.complete:
            return 0
        print("cuboid: interrupted; the results are marked as incomplete", file=sys.stderr)
        return self.status


@contextmanager
def interruptible() -> Iterator[Interruption]:
    """Within the context, SIGINT and SIGTERM request the end of the run instead of aborting it."""
    interruption = Interruption()
    before = {number: signal.signal(number, interruption.handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield interruption
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
