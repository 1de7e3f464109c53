"""What the masks of a frame hold of the objects of the map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, slots=True)
class Holdings:
    """The pixels that belong to an object and to a mask, object by object.

    Attributes
    ----------
    numbers : (K,) int64
        The objects, ascending.
    first : (K + 1,) int64
        Where each one's pixels begin in `pixels`, and their end.
    pixels, mask : (N,) int64
        Places in the flattened image, and the mask that claims each.
    table : (K, M) int64
        Pixels by object and mask.
    width : int
        Of the image.
    """

    numbers: npt.NDArray[np.int64]
    first: npt.NDArray[np.int64]
    pixels: npt.NDArray[np.int64]
    mask: npt.NDArray[np.int64]
    table: npt.NDArray[np.int64]
    width: int

    def of(self, k: int, mask: int) -> npt.NDArray[np.int64]:
        """Return the pixels of the k-th object that a mask claims."""
        own = slice(self.first[k], self.first[k + 1])
        return np.asarray(self.pixels[own][self.mask[own] == mask], dtype=np.int64)


def holdings(claim: npt.NDArray[np.int32], pixel_owner: npt.NDArray[np.int32]) -> Holdings | None:
    """Gather what the masks hold; None where they hold nothing of any object.

    Parameters
    ----------
    claim : (h, w) int32
        Number of the mask that claims a pixel, -1 none.
    pixel_owner : (h, w) int32
        Number of the object that a pixel belongs to, 0 none.
    """
    pixels = np.flatnonzero((claim >= 0) & (pixel_owner > 0))
    if len(pixels) == 0:
        return None
    owner = pixel_owner.ravel()[pixels]
    counts = np.bincount(owner)
    numbers = np.flatnonzero(counts)
    # As few bits as that: sorting short integers takes a fraction of the time.
    place = (np.cumsum(counts > 0) - 1)[owner].astype(np.int16)
    order = np.argsort(place, kind="stable")
    pixels = pixels[order]
    mask = claim.ravel()[pixels].astype(np.int64)
    masks = int(mask.max()) + 1
    table = np.bincount(place[order] * np.int64(masks) + mask, minlength=len(numbers) * masks)
    first = np.concatenate([[0], np.cumsum(counts[numbers])])
    return Holdings(numbers, first, pixels, mask, table.reshape(len(numbers), masks), claim.shape[1])
