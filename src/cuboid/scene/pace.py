"""Work that one thread does beside another, spread over time, so that no moment of the other has much of it."""

from __future__ import annotations

import time
from threading import Event

# Processor time that is worked at a stretch, and the least that is rested, by the clock, seconds.
STRETCH_S, REST_S = 0.002, 0.02


class Pace:
    """Lets a thread work for a share of what the process works.

    Parameters
    ----------
    share : float
        Of the process's processor time.
    most_s : float
        After so long it works without rest: the others may have nothing to do.
    """

    def __init__(self, share: float = 1.0, most_s: float = 0.0) -> None:
        self._share, self._until_s = share, time.monotonic() + most_s
        self._hurry = Event()
        self._begun: tuple[float, float] | None = None

    def rest(self) -> None:
        """Rest, where enough was done at a stretch; called by the thread that works, between two pieces of work."""
        now_s = time.thread_time()
        if self._begun is None:
            self._begun = now_s, time.process_time()
        worked_s, due_s = now_s - self._begun[0], self._begun[1] + (now_s - self._begun[0]) / self._share
        if worked_s < STRETCH_S:
            return
        # Where others have the processor it comes later than by the clock.
        while (left_s := due_s - time.process_time()) > 0.0 and not self._hurry.is_set():
            rest_s = min(max(left_s, REST_S), self._until_s - time.monotonic())
            if rest_s <= 0.0:
                break
            self._hurry.wait(rest_s)
        self._begun = time.thread_time(), time.process_time()

    def hurry(self) -> None:
        """Let it rest no more: somebody waits."""
        self._hurry.set()
