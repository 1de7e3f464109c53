"""The end of an object's outline: whether its top was seen to end freely."""

from __future__ import annotations

from typing import Any

import numpy.typing as npt

from cuboid.method.surfaces.kernels.outlines import BORDER, FREE, SUPPORT, TOP

# The top ends if this fraction of it was judged: a part that always continues upwards, behind or into something, is a
# leg or a post.
KNOWN_TOP_FRACTION = 0.35

Outline = npt.NDArray[Any]


def ends_above(outline: Outline) -> bool:
    """Return whether part of an object's top was seen to end freely, not at another object of the same depth.

    Parameters
    ----------
    outline : (4, KINDS)
    """
    top = outline[TOP]
    return bool(top[FREE] + top[SUPPORT] >= KNOWN_TOP_FRACTION * (top.sum() - top[BORDER]))
