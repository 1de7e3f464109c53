"""Do two objects belong together: what the proposals of every frame say of it.

A mask that covers most of what is seen of two objects takes them for one; where each has a mask of its own, they are
two. One frame errs; the count over all frames seldom does. A bowl whose far wall is parted from the near one by its
rim is one by this count, two boxes that touch are two.
"""

from __future__ import annotations

import numpy as np

from cuboid.objects.holdings import Holdings

# An object is looked at when it shows this many pixels, and a mask holds it with this share of them.
LEAST_PIXELS, HELD = 15, 0.5
# Only of objects whose rectangles in the working image are this near each other is anything learned, pixels.
NEAR_PIXELS = 8
# The count is sure from so many frames on, when one side has so many times the other.
SURE_FRAMES, SURE_RATIO = 4, 2.0

Pair = tuple[int, int]


class Bonds:
    """Counts, for each pair of objects seen side by side, of frames that saw one thing and of frames that saw two."""

    def __init__(self) -> None:
        self._counts: dict[Pair, list[int]] = {}
        self._severed: set[Pair] = set()
        self._partners: dict[int, set[int]] = {}

    def see(self, held: Holdings) -> None:
        """Take in what the masks of a frame hold of the objects."""
        total = held.table.sum(1)
        strong = np.flatnonzero((total >= LEAST_PIXELS) & (held.table.max(1) >= HELD * total))
        best = held.table.argmax(1)
        corner = np.stack(np.divmod(held.pixels, held.width))
        low = np.minimum.reduceat(corner, held.first[:-1], axis=1)[:, strong]
        high = np.maximum.reduceat(corner, held.first[:-1], axis=1)[:, strong]
        touch = (low[:, :, None] <= high[:, None, :] + NEAR_PIXELS).all(0)
        for i, j in zip(*np.nonzero(np.triu(touch & touch.T, 1)), strict=True):
            together = best[strong[i]] == best[strong[j]]
            pair = (int(held.numbers[strong[i]]), int(held.numbers[strong[j]]))
            if pair not in self._counts:
                self._meet(pair)
            self._counts.setdefault(pair, [0, 0])[0 if together else 1] += 1

    def verdict(self, a: int, b: int) -> bool | None:
        """Return True where two objects are one, False where they are two, None while it is not sure."""
        pair = (min(a, b), max(a, b))
        if pair in self._severed:
            return False
        together, apart = self._counts.get(pair, (0, 0))
        if together >= SURE_FRAMES and together >= SURE_RATIO * apart:
            return True
        if apart >= SURE_FRAMES and apart >= SURE_RATIO * together:
            return False
        return None

    def sever(self, a: int, b: int) -> None:
        """Hold two objects for two, whatever later frames say: they were told apart before."""
        self._severed.add((min(a, b), max(a, b)))
        self._meet((a, b))

    def forget(self, number: int) -> None:
        """Drop an object that is no more."""
        for partner in self._partners.pop(number, ()):
            pair = (min(number, partner), max(number, partner))
            self._counts.pop(pair, None)
            self._severed.discard(pair)
            self._partners[partner].discard(number)

    def _meet(self, pair: Pair) -> None:
        for one, other in (pair, pair[::-1]):
            self._partners.setdefault(one, set()).add(other)
