"""Are two objects one: what the proposals of every frame say of it, as log-odds.

A proposal that covers most of what is seen of two objects takes them for one; where each has a proposal of its own,
side by side, they are two. One frame errs; the sum over all frames seldom does.
"""

from __future__ import annotations

from math import log

from cuboid.tolerances import SURE

# Frames take one thing apart more often (here, once in three) than two things for one (once in seven): what a frame
# adds to the log-odds that two are one, or takes off.
SPLIT_RATE, JOIN_RATE = 0.35, 0.15
ONE, TWO = log((1.0 - SPLIT_RATE) / JOIN_RATE), log(SPLIT_RATE / (1.0 - JOIN_RATE))
# Beyond this no more is counted, of an object as of a pair, so that a mistake of long ago can be mended.
MOST_TOLD = 2.0 * SURE


class Affinity:
    """The log-odds, for each pair of objects seen side by side, that they are one."""

    def __init__(self) -> None:
        # Of each object, by those that it was seen beside; a pair is there both ways.
        self._told: dict[int, dict[int, float]] = {}

    def tell(self, a: int, b: int, *, one: bool, news: float) -> None:
        """Take in what a frame says of two objects, as far as it is news (0..1)."""
        self._add(a, b, (ONE if one else TWO) * news)

    def hold(self, a: int, b: int, news: float) -> None:
        """Take in that one of two holds the other: borders that frames saw between them were those of a part."""
        told = self.of(a, b)
        self._add(a, b, ONE * news - min(0.0, told or 0.0))

    def _add(self, a: int, b: int, told: float) -> None:
        mine = self._told.setdefault(a, {})
        mine[b] = self._told.setdefault(b, {})[a] = min(MOST_TOLD, max(-MOST_TOLD, mine.get(b, 0.0) + told))

    def of(self, a: int, b: int) -> float | None:
        """Return the log-odds that two objects are one; None where they were never seen side by side."""
        return self._told.get(a, {}).get(b)

    def objects(self) -> list[int]:
        """Return the objects that were seen beside any, ascending."""
        return sorted(number for number, beside in self._told.items() if beside)

    def partners(self, number: int, least: float = -MOST_TOLD, most: float = MOST_TOLD) -> list[int]:
        """Return the objects that were seen beside one, ascending: those whose log-odds lie in a range."""
        beside = self._told.get(number)
        return sorted([other for other, told in beside.items() if least <= told <= most]) if beside else []

    def pass_on(self, gone: int, kept: int) -> None:
        """Let what was told of one object hold of another."""
        for partner, told in list(self._told.get(gone, {}).items()):
            if partner != kept:
                self._add(kept, partner, told)
        self.forget(gone)

    def forget(self, number: int) -> None:
        """Drop an object that is no more."""
        for partner in self._told.pop(number, {}):
            del self._told[partner][number]
