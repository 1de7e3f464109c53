"""Pairwise affinity of objects: the log-odds that two of them are one, accumulated over all frames.

A proposal that covers most of the visible part of two objects is evidence that they are one; separate proposals side by
side are evidence that they are two. A single frame may be wrong; the sum over all frames seldom is.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import log

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.state import Record

# Log-odds of 99 to 1: certain.
CERTAIN_LOG_ODDS = log(99.0)
Pair = tuple[int, int]

# Over-segmentation (one frame in three) is more frequent than under-segmentation (one in seven). From these rates
# follow the log-odds that a frame adds or subtracts.
SPLIT_RATE, JOIN_RATE = 0.35, 0.15
SAME_LOG_ODDS, DIFFERENT_LOG_ODDS = log((1.0 - SPLIT_RATE) / JOIN_RATE), log(SPLIT_RATE / (1.0 - JOIN_RATE))
# An object that is attached to another one is a part of it in nine of ten cases, in made recordings.
ATTACHED_LOG_ODDS = log(9.0)
# Limit of the log-odds, of an object and of a pair, so that early mistakes can be corrected.
MAX_LOG_ODDS = 2.0 * CERTAIN_LOG_ODDS


@dataclass(frozen=True, slots=True)
class AffinityState(Record):
    """State of an `Affinity`.

    Attributes
    ----------
    pairs : (N, 2) int64
        Numbers of two objects, the lower one first.
    log_odds : (N,) float64
        Log-odds that the two are one object.
    """

    pairs: npt.NDArray[np.int64]
    log_odds: Float64Array


class Affinity:
    """The log-odds, for each pair of objects seen side by side, that they are one."""

    NOT_SAVED = frozenset({"_partners"})

    def __init__(self) -> None:
        self._log_odds: dict[Pair, float] = {}
        self._partners: dict[int, set[int]] = {}

    def state(self) -> AffinityState:
        """Return the current state; later updates do not change it."""
        odds = self._log_odds
        pairs = np.array(list(odds), np.int64).reshape(-1, 2)
        return AffinityState(pairs, np.fromiter(odds.values(), np.float64, len(odds)))

    @classmethod
    def from_state(cls, state: AffinityState) -> Affinity:
        """Return the affinities of a state."""
        affinity = cls()
        for (a, b), log_odds in zip(state.pairs.tolist(), state.log_odds.tolist(), strict=True):
            affinity._add(a, b, log_odds)
        return affinity

    def add_evidence(self, a: int, b: int, log_odds: float, *, novelty: float) -> None:
        """Add the evidence of a frame that two objects are the same one, or that they are not.

        It is weighted by the novelty (0..1) of the viewpoint of the frame.
        """
        self._add(a, b, log_odds * novelty)

    def add_attachment(self, a: int, b: int) -> None:
        """Add the evidence of a fit that one object is attached to the other: evidence for two objects is reset.

        A fit judges the points of all frames, and is repeated when their number has grown: unlike the evidence of a
        frame, that of a fit does not depend on the novelty of the viewpoint.
        """
        self._add(a, b, ATTACHED_LOG_ODDS - min(0.0, self.of(a, b) or 0.0))

    def _add(self, a: int, b: int, evidence: float) -> None:
        pair = (min(a, b), max(a, b))
        self._partners.setdefault(a, set()).add(b)
        self._partners.setdefault(b, set()).add(a)
        self._log_odds[pair] = min(MAX_LOG_ODDS, max(-MAX_LOG_ODDS, self._log_odds.get(pair, 0.0) + evidence))

    def of(self, a: int, b: int) -> float | None:
        """Return the log-odds that two objects are one; None if they were never seen side by side."""
        return self._log_odds.get((min(a, b), max(a, b)))

    def objects(self) -> list[int]:
        """Return the objects that were seen beside another one, ascending."""
        return sorted(number for number, partners in self._partners.items() if partners)

    def partners(
        self, number: int, min_log_odds: float = -MAX_LOG_ODDS, max_log_odds: float = MAX_LOG_ODDS
    ) -> list[int]:
        """Return the objects that were seen beside an object and whose log-odds lie in a range, ascending."""
        odds, partners = self._log_odds, self._partners.get(number)
        if not partners:
            return []
        if min_log_odds <= -MAX_LOG_ODDS and max_log_odds >= MAX_LOG_ODDS:
            return sorted(partners)
        return sorted(
            [k for k in partners if min_log_odds <= odds[(number, k) if number < k else (k, number)] <= max_log_odds]
        )

    def transfer(self, gone: int, kept: int) -> None:
        """Add the affinities of a merged object to those of the remaining one."""
        for partner in self.partners(gone):
            if partner != kept:
                self._add(kept, partner, self._log_odds[(min(gone, partner), max(gone, partner))])
        self.remove(gone)

    def remove(self, number: int) -> None:
        """Remove an object."""
        for partner in self._partners.pop(number, ()):
            self._log_odds.pop((min(number, partner), max(number, partner)), None)
            self._partners[partner].discard(number)
