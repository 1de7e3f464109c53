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

    def see(self, claim: npt.NDArray[np.int32], pixel_owner: npt.NDArray[np.int32]) -> None:
        """Take in a frame.

        Parameters
        ----------
        claim : (h, w) int32
            Number of the mask that claims a pixel, -1 none.
        pixel_owner : (h, w) int32
            Number of the object that a pixel belongs to, 0 none.
        """
        pixels = np.flatnonzero((claim >= 0) & (pixel_owner > 0))
        if len(pixels) == 0:
            return
        numbers, mask = pixel_owner.ravel()[pixels], claim.ravel()[pixels]
        order = np.argsort(numbers, kind="stable")
        numbers, mask = numbers[order], mask[order]
        first = np.flatnonzero(np.diff(numbers, prepend=0))
        owners, total = numbers[first], np.diff(first, append=len(numbers))
        width = int(mask.max()) + 1
        cells = np.repeat(np.arange(len(owners)), total) * width + mask
        table = np.bincount(cells, minlength=len(owners) * width).reshape(len(owners), width)
        strong = np.flatnonzero((total >= LEAST_PIXELS) & (table.max(1) >= HELD * total))
        best = table.argmax(1)
        v, u = np.divmod(pixels[order], claim.shape[1])
        low = np.stack([np.minimum.reduceat(v, first), np.minimum.reduceat(u, first)])[:, strong]
        high = np.stack([np.maximum.reduceat(v, first), np.maximum.reduceat(u, first)])[:, strong]
        touch = (low[:, :, None] <= high[:, None, :] + NEAR_PIXELS).all(0)
        for i, j in zip(*np.nonzero(np.triu(touch & touch.T, 1)), strict=True):
            together = best[strong[i]] == best[strong[j]]
            pair = (int(owners[strong[i]]), int(owners[strong[j]]))
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

    def forget(self, number: int) -> None:
        """Drop an object that is no more."""
        self._counts = {pair: n for pair, n in self._counts.items() if number not in pair}
        self._severed = {pair for pair in self._severed if number not in pair}
