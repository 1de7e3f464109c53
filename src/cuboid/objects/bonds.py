"""Do two objects belong together: what the proposals of every frame say of it.

A mask that covers most of what is seen of two objects takes them for one; where each has a mask of its own, they are
two. One frame errs; the count over all frames seldom does. A bowl whose far wall is parted from the near one by its
rim is one by this count, two boxes that touch are two.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

# An object is looked at when it shows this many pixels, and a mask holds it with this share of them.
LEAST_PIXELS, HELD = 15, 0.5
# The count is sure from so many frames on, when one side has so many times the other.
SURE_FRAMES, SURE_RATIO = 4, 2.0

Pair = tuple[int, int]


class Bonds:
    """Counts, for each pair of objects seen side by side, of frames that saw one thing and of frames that saw two."""

    def __init__(self) -> None:
        self._counts: dict[Pair, list[int]] = {}

    def see(self, claim: npt.NDArray[np.int32], pixel_owner: npt.NDArray[np.int32]) -> None:
        """Take in a frame.

        Parameters
        ----------
        claim : (h, w) int32
            Number of the mask that claims a pixel, -1 none.
        pixel_owner : (h, w) int32
            Number of the object that a pixel belongs to, 0 none.
        """
        both = (claim >= 0) & (pixel_owner > 0)
        if not both.any():
            return
        owners, which = np.unique(pixel_owner[both], return_inverse=True)
        masks, mask = np.unique(claim[both], return_inverse=True)
        table = np.zeros((len(owners), len(masks)))
        np.add.at(table, (which, mask), 1)
        total = table.sum(1)
        strong = np.flatnonzero((total >= LEAST_PIXELS) & (table.max(1) >= HELD * total))
        best = table.argmax(1)
        near = self._neighbours(claim, pixel_owner, owners[strong].tolist())
        for i in range(len(strong)):
            for j in range(i + 1, len(strong)):
                pair = (int(owners[strong[i]]), int(owners[strong[j]]))
                together = best[strong[i]] == best[strong[j]]
                if together or pair in near:
                    self._counts.setdefault(pair, [0, 0])[0 if together else 1] += 1

    @staticmethod
    def _neighbours(claim: npt.NDArray[np.int32], pixel_owner: npt.NDArray[np.int32], numbers: list[int]) -> set[Pair]:
        """Return the pairs whose rectangles in the image touch: only of these is being apart any news."""
        rectangles = {}
        for number in numbers:
            v, u = np.nonzero(pixel_owner == number)
            rectangles[number] = (u.min() - 4, v.min() - 4, u.max() + 4, v.max() + 4)
        pairs = set()
        for a in numbers:
            for b in numbers:
                p, q = rectangles[a], rectangles[b]
                if a < b and p[0] <= q[2] and q[0] <= p[2] and p[1] <= q[3] and q[1] <= p[3]:
                    pairs.add((a, b))
        return pairs

    def verdict(self, a: int, b: int) -> bool | None:
        """Return True where two objects are one, False where they are two, None while it is not sure."""
        together, apart = self._counts.get((min(a, b), max(a, b)), (0, 0))
        if together >= SURE_FRAMES and together >= SURE_RATIO * apart:
            return True
        if apart >= SURE_FRAMES and apart >= SURE_RATIO * together:
            return False
        return None

    def forget(self, number: int) -> None:
        """Drop an object that is no more."""
        self._counts = {pair: n for pair, n in self._counts.items() if number not in pair}
