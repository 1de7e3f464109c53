"""Are two objects one: what the proposals of every frame say of it, as log-odds.

A proposal that covers most of what is seen of two objects takes them for one; where each has a proposal of its own,
side by side, they are two. One frame errs; the sum over all frames seldom does.
"""

from __future__ import annotations

from math import log

Pair = tuple[int, int]

# A frame's word on a pair is wrong once in four: what it adds to the log-odds that two are one, or takes off.
WORD = log(3.0)
# Two are one when that is so in 99 of 100 such cases, and hardly ever are when it is so in one of 100.
SURE = log(99.0)
# Beyond this no more is counted, so that a mistake of long ago can be mended.
MOST = 2.0 * SURE


class Affinity:
    """The log-odds, for each pair of objects seen side by side, that they are one."""

    def __init__(self) -> None:
        self._log_odds: dict[Pair, float] = {}
        self._partners: dict[int, set[int]] = {}

    def tell(self, a: int, b: int, *, one: bool, weight: float = 1.0) -> None:
        """Take in what a frame says of two objects."""
        pair = (min(a, b), max(a, b))
        self._partners.setdefault(a, set()).add(b)
        self._partners.setdefault(b, set()).add(a)
        total = self._log_odds.get(pair, 0.0) + (WORD if one else -WORD) * weight
        self._log_odds[pair] = min(MOST, max(-MOST, total))

    def of(self, a: int, b: int) -> float | None:
        """Return the log-odds that two objects are one; None where they were never seen side by side."""
        return self._log_odds.get((min(a, b), max(a, b)))

    def partners(self, number: int) -> list[int]:
        """Return the objects that were seen beside one, ascending."""
        return sorted(self._partners.get(number, ()))

    def pass_on(self, gone: int, kept: int) -> None:
        """Let what was told of one object hold of another."""
        for partner in self.partners(gone):
            if partner != kept:
                told = self._log_odds[(min(gone, partner), max(gone, partner))]
                self.tell(kept, partner, one=told > 0, weight=abs(told) / WORD)
        self.forget(gone)

    def forget(self, number: int) -> None:
        """Drop an object that is no more."""
        for partner in self._partners.pop(number, ()):
            self._log_odds.pop((min(number, partner), max(number, partner)), None)
            self._partners[partner].discard(number)
