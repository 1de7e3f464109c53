"""Timing of commits, and pacing of a background thread so that it never slows the main thread much at a time."""

from __future__ import annotations

import time
from threading import Event

# Processor time of one stretch of work, and minimum wall-clock rest after it, seconds.
STRETCH_S, MIN_REST_S = 0.002, 0.02
# Maximum fraction of processor time for commits, however large the scene. To keep it, a commit waits at most
# LONGEST_WAIT times the requested interval.
COMMIT_FRACTION, LONGEST_WAIT = 0.05, 5.0
# Where other programs use the processor, a commit waits at most this many times as long as on an idle machine. Commits
# then take a larger fraction of the remaining processor time, but a crash of the process loses little.
LOADED_WAIT = 2.0


class CommitTimer:
    """Decides when to commit.

    Parameters
    ----------
    every_s : float
        Requested interval; commits are rarer if they cost too much.

    Attributes
    ----------
    cost_s : float
        Processor time that the last commit has taken so far.
    """

    def __init__(self, every_s: float) -> None:
        self._every_s, self.cost_s = every_s, 0.0
        self._begun = time.monotonic(), time.process_time()

    @property
    def wait_s(self) -> float:
        """Waiting time after the last commit, from the cost of that commit, on an otherwise idle machine."""
        return min(max(self._every_s, self.cost_s / COMMIT_FRACTION), LONGEST_WAIT * self._every_s)

    def due(self) -> bool:
        """Return whether a commit is due."""
        waited_s, worked_s = time.monotonic() - self._begun[0], time.process_time() - self._begun[1]
        longest_s = min(LOADED_WAIT * self.wait_s, LONGEST_WAIT * self._every_s)
        return waited_s >= self._every_s and (worked_s >= self.wait_s or waited_s >= longest_s)

    def begin(self, cost_s: float) -> None:
        """Note that a commit begins, and the processor time that it has taken so far."""
        self._begun, self.cost_s = (time.monotonic(), time.process_time()), cost_s


class Pace:
    """Limits the work of a thread to a fraction of the process's work.

    Parameters
    ----------
    fraction : float
        Fraction of the process's processor time.
    max_s : float
        After this time the thread works without rest: the others may be idle.
    cost_s : float
        Expected processor time of the work, 0 if unknown. It spreads the rests over `max_s`.
    """

    def __init__(self, fraction: float = 1.0, max_s: float = 0.0, cost_s: float = 0.0) -> None:
        self._fraction, self._until_s = fraction, time.monotonic() + max_s
        self._stretched = max_s / cost_s if cost_s > 0.0 else float("inf")
        self._hurry = Event()
        self._begun: tuple[float, float] | None = None

    def rest(self) -> None:
        """Rest if the stretch of work is long enough; called by the working thread between two pieces of work."""
        now_s = time.thread_time()
        if self._begun is None:
            self._begun = now_s, time.process_time()
        worked_s, due_s = now_s - self._begun[0], self._begun[1] + (now_s - self._begun[0]) / self._fraction
        if worked_s < STRETCH_S:
            return
        # Where other programs use the processor, processor time advances slower than the clock.
        until_s = min(self._until_s, time.monotonic() + worked_s * self._stretched)
        while (left_s := due_s - time.process_time()) > 0.0 and not self._hurry.is_set():
            rest_s = min(max(left_s, MIN_REST_S), until_s - time.monotonic())
            if rest_s <= 0.0:
                break
            self._hurry.wait(rest_s)
        self._begun = time.thread_time(), time.process_time()

    def hurry(self) -> None:
        """End the rests: another thread waits for the work."""
        self._hurry.set()
