"""Objectness of a segment from its outline: free space around it, and its support."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.method.objects.affinity import CERTAIN_LOG_ODDS
from cuboid.method.surfaces.kernels.outlines import (
    BORDER,
    BOTTOM,
    CONTACT,
    FREE,
    HIDDEN,
    LEFT,
    RIGHT,
    SUPPORT,
    TOP,
    UNSURE,
)

# Log-odds of a sighting with a completely visible and free outline: two or three of these confirm an object.
CLEAR = CERTAIN_LOG_ODDS / 2.0
# Smallest fraction of an object's judged outline that is free or rests on its support.
OWN_FRACTION = 0.6
# The top ends if this fraction of it was judged: a part that always continues upwards, behind or into something, is a
# leg or a post.
KNOWN_TOP_FRACTION = 0.35
# The other sides end if this fraction of them was judged.
KNOWN_SIDE_FRACTION = 0.2
# More than this fraction of a side decides the kind of the side.
MAJORITY = 0.5
# A segment has full weight if this fraction of its pixels are readings; the others are filled holes, an estimate.
FULLY_READ_FRACTION = 0.5
# After this change of the viewing angle, radians, a sighting is independent of the previous one.
NEW_VIEW_RAD = 0.2

Outline = npt.NDArray[Any]


def log_odds_of(outlines: Outline, read: Float64Array) -> Float64Array:
    """Return the log-odds (N,), added by each sighting, that it shows an object.

    Parameters
    ----------
    outlines : (N, 4, KINDS)
        Pixels by side and kind; see `kernels.outlines.outlines`.
    read : (N,) float64
        Fraction of each segment's pixels that are readings, not filled holes.
    """
    kinds = outlines.sum(1)
    # Every object stands on something: contact at the bottom counts as support, known or not.
    kinds[:, SUPPORT] += outlines[:, BOTTOM, CONTACT]
    kinds[:, CONTACT] -= outlines[:, BOTTOM, CONTACT]
    judged = kinds[:, :HIDDEN].sum(1).astype(np.float64)
    # A border at another object, or at a hole without a color edge, is the object's own outline half of the time.
    bounding = kinds[:, FREE] + kinds[:, SUPPORT] + 0.5 * kinds[:, UNSURE]
    fraction = bounding / np.maximum(judged, 1.0)
    # The hidden or cut-off part of the bottom is where the object stands.
    visible = kinds.sum(1) - outlines[:, BOTTOM, HIDDEN:].sum(1)
    evidence = CLEAR * judged / np.maximum(visible, 1.0) * (fraction - OWN_FRACTION) / (1.0 - OWN_FRACTION)
    # Filled pixels are an estimate: a sighting has full weight if half of the segment is readings, otherwise less.
    return np.asarray(evidence * np.minimum(1.0, read / FULLY_READ_FRACTION), dtype=np.float64)


def with_viewpoint_change(evidence: float, viewpoint_angle: float) -> float:
    """Return the log-odds of a repeated sighting; the weight grows with the change of the viewpoint.

    Errors of sightings from one viewpoint are correlated. A sighting that is as clear after a change of the viewing
    angle is independent evidence: it counts once more, in proportion to its clearness.

    Parameters
    ----------
    evidence : float
        Log-odds of the sighting alone; see `log_odds_of`.
    viewpoint_angle : float
        Change of the viewing angle since the previous frame, radians.
    """
    return evidence + max(0.0, evidence) * evidence / CLEAR * min(1.0, viewpoint_angle / NEW_VIEW_RAD)


def enclosed(outline: Outline, *, cut_off: bool = True, beside: bool = False) -> bool:
    """Return whether all sides except the bottom were seen to end; an object that may continue is not confirmed yet.

    One of the left and right sides may always have been cut off by the image border, or hidden by a known neighbour:
    the visible part is an object, and later views enlarge it. A part that continues upwards may be a post or a wall.

    Parameters
    ----------
    outline : (4, KINDS)
        Sum over the sightings of an object.
    cut_off : bool, optional
        Whether it may continue beyond the image border and still have the size of an object.
    beside : bool, optional
        Whether it stands beside another object and is certainly separate from it.
    """
    judged = outline[:, :HIDDEN].sum(1)
    total = outline.sum(1)
    min_fraction = np.full(4, KNOWN_SIDE_FRACTION)
    min_fraction[TOP] = KNOWN_TOP_FRACTION
    # The part of the top that the image border cuts off is ignored, if frames saw some of the top.
    uncut = total.copy()
    uncut[TOP] -= outline[TOP, BORDER]
    observed = (outline[:, :CONTACT].sum(1) >= min_fraction * uncut) & (uncut >= KNOWN_SIDE_FRACTION * total)
    structure = outline[:, CONTACT] > MAJORITY * judged
    hidden = beside * outline[:, HIDDEN]
    cut = cut_off * outline[:, BORDER] + hidden > MAJORITY * total
    ends = observed & ~structure
    # An object that hides a side usually touches it.
    behind = hidden > MAJORITY * total
    sides = (ends | (~observed & (behind | (cut & ~structure))))[[LEFT, RIGHT]]
    return bool(ends[TOP] and sides.all() and ends[[LEFT, RIGHT]].any())


def ends_above(outline: Outline) -> bool:
    """Return whether part of an object's top was seen to end freely, not at another object of the same depth.

    Parameters
    ----------
    outline : (4, KINDS)
    """
    top = outline[TOP]
    return bool(top[FREE] + top[SUPPORT] >= KNOWN_TOP_FRACTION * (top.sum() - top[BORDER]))


def ends_beside(outline: Outline) -> bool:
    """Return whether part of both the left and the right side was seen to end: neither continues behind an object.

    Parameters
    ----------
    outline : (4, KINDS)
    """
    sides = outline[[LEFT, RIGHT]]
    return bool((sides[:, :CONTACT].sum(1) >= KNOWN_TOP_FRACTION * (sides.sum(1) - sides[:, BORDER])).all())
