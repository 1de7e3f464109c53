"""How often a state is committed, and work beside another thread's, spread so that no moment of that has much of it."""

from __future__ import annotations

import time
from threading import Event

# Processor time that is worked at a stretch, and the least that is rested, by the clock, seconds.
STRETCH_S, REST_S = 0.002, 0.02
# Commits have no larger fraction of the processor's time than this, however large the scene; for that they wait at most
# this many times as long as they should.
COMMIT_FRACTION, LONGEST_WAIT = 0.05, 5.0
# Where other programs have the processor they wait at most this many times as long as without these: of what little is
# left they have a larger fraction then, but what is lost with the process stays little.
LOADED_WAIT = 2.0


class Rhythm:
    """When to commit.

    Parameters
    ----------
    every_s : float
        How often that should be; less often where it costs too much.

    Attributes
    ----------
    cost_s : float
        Processor time that the last one has taken so far.
    """

    def __init__(self, every_s: float) -> None:
        self._every_s, self.cost_s = every_s, 0.0
        self._begun = time.monotonic(), time.process_time()

    @property
    def wait_s(self) -> float:
        """How long a commit waits after the one before, by what that cost, where nothing else has the processor."""
        return min(max(self._every_s, self.cost_s / COMMIT_FRACTION), LONGEST_WAIT * self._every_s)

    def due(self) -> bool:
        """Tell whether it is time for one."""
        waited_s, worked_s = time.monotonic() - self._begun[0], time.process_time() - self._begun[1]
        longest_s = min(LOADED_WAIT * self.wait_s, LONGEST_WAIT * self._every_s)
        return waited_s >= self._every_s and (worked_s >= self.wait_s or waited_s >= longest_s)

    def begin(self, cost_s: float) -> None:
        """Note that one begins, and the processor time that it has taken so far."""
        self._begun, self.cost_s = (time.monotonic(), time.process_time()), cost_s


class Pace:
    """Lets a thread work for a fraction of what the process works.

    Parameters
    ----------
    fraction : float
        Of the process's processor time.
    most_s : float
        After so long it works without rest: the others may have nothing to do.
    cost_s : float
        Processor time that the work is likely to take, 0 where that is not known: it rests as `most_s` allows for.
    """

    def __init__(self, fraction: float = 1.0, most_s: float = 0.0, cost_s: float = 0.0) -> None:
        self._fraction, self._until_s = fraction, time.monotonic() + most_s
        self._stretched = most_s / cost_s if cost_s > 0.0 else float("inf")
        self._hurry = Event()
        self._begun: tuple[float, float] | None = None

    def rest(self) -> None:
        """Rest, where enough was done at a stretch; called by the thread that works, between two pieces of work."""
        now_s = time.thread_time()
        if self._begun is None:
            self._begun = now_s, time.process_time()
        worked_s, due_s = now_s - self._begun[0], self._begun[1] + (now_s - self._begun[0]) / self._fraction
        if worked_s < STRETCH_S:
            return
        # Where others have the processor it comes later than by the clock.
        until_s = min(self._until_s, time.monotonic() + worked_s * self._stretched)
        while (left_s := due_s - time.process_time()) > 0.0 and not self._hurry.is_set():
            rest_s = min(max(left_s, REST_S), until_s - time.monotonic())
            if rest_s <= 0.0:
                break
            self._hurry.wait(rest_s)
        self._begun = time.thread_time(), time.process_time()

    def hurry(self) -> None:
        """Let it rest no more: somebody waits."""
        self._hurry.set()
