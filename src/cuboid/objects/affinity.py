"""Pairwise affinity of objects: the log-odds that two of them are one, accumulated over all frames.

A proposal that covers most of the visible part of two objects is evidence that they are one; a proposal for each, side
by side, that they are two. A single frame errs; the sum over all frames seldom does.
"""

from __future__ import annotations

from math import log

from cuboid.tolerances import SURE

# Over-segmentation (one in three frames) is more frequent than under-segmentation (one in seven): what a frame adds to
# the log-odds that two are one, or takes off.
SPLIT_RATE, JOIN_RATE = 0.35, 0.15
SAME_LOG_ODDS, DIFFERENT_LOG_ODDS = log((1.0 - SPLIT_RATE) / JOIN_RATE), log(SPLIT_RATE / (1.0 - JOIN_RATE))
# Log-odds saturate here, of an object as of a pair, so that early mistakes can be corrected.
MAX_LOG_ODDS = 2.0 * SURE


class Affinity:
    """The log-odds, for each pair of objects seen side by side, that they are one."""

    def __init__(self) -> None:
        # Of each object, by those that it was seen beside; a pair is there both ways.
        self._told: dict[int, dict[int, float]] = {}

    def add_evidence(self, a: int, b: int, *, one: bool, novelty: float) -> None:
        """Add the evidence of a frame on two objects, weighted by the novelty (0..1) of its viewpoint."""
        self._add(a, b, (SAME_LOG_ODDS if one else DIFFERENT_LOG_ODDS) * novelty)

    def add_attachment(self, a: int, b: int, novelty: float) -> None:
        """Add that one of two is attached to the other: borders seen between them were those of a part."""
        evidence = self.of(a, b)
        self._add(a, b, SAME_LOG_ODDS * novelty - min(0.0, evidence or 0.0))

    def _add(self, a: int, b: int, evidence: float) -> None:
        mine = self._told.setdefault(a, {})
        mine[b] = self._told.setdefault(b, {})[a] = min(MAX_LOG_ODDS, max(-MAX_LOG_ODDS, mine.get(b, 0.0) + evidence))

    def of(self, a: int, b: int) -> float | None:
        """Return the log-odds that two objects are one; None where they were never seen side by side."""
        return self._told.get(a, {}).get(b)

    def objects(self) -> list[int]:
        """Return the objects that were seen beside any, ascending."""
        return sorted(number for number, beside in self._told.items() if beside)

    def partners(self, number: int, least: float = -MAX_LOG_ODDS, most: float = MAX_LOG_ODDS) -> list[int]:
        """Return the objects that were seen beside one, ascending: those whose log-odds lie in a range."""
        beside = self._told.get(number)
        return sorted([other for other, evidence in beside.items() if least <= evidence <= most]) if beside else []

    def transfer(self, gone: int, kept: int) -> None:
        """Add the affinities of an object that was merged to those of the one that remains."""
        for partner, evidence in list(self._told.get(gone, {}).items()):
            if partner != kept:
                self._add(kept, partner, evidence)
        self.remove(gone)

    def remove(self, number: int) -> None:
        """Remove an object."""
        for partner in self._told.pop(number, {}):
            del self._told[partner][number]
