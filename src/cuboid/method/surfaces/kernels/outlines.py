"""Hot loop over the outlines of a frame's segments: the kind of neighbour across each outline pixel."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cuboid.ground.compiling.compiled import kernel
from cuboid.ground.core.tolerances import JUMP_SIGMAS

# Kinds of neighbour across an outline pixel: last axis of `outline`.
FREE, SUPPORT, UNSURE, CONTACT, HIDDEN, BORDER = range(6)
KINDS = 6
# Sides of a segment in the image of an upright camera: middle axis of `outline`.
TOP, BOTTOM, LEFT, RIGHT = range(4)
# The top and the bottom of a segment are this fraction of its height.
END_FRACTION = 0.05
# A color change of this many levels, over three channels, is an edge: shading and noise cause a third of it. The color
# inside is taken this many pixels from the outline, away from its blur.
EDGE_LEVELS, INNER_PIXELS = 90, 2


@kernel(inline="always")
def surrounded(claim, v, u):
    """Return whether all four neighbours of a pixel belong to its segment; the pixel must not lie at the border."""
    a = claim[v, u]
    both_sides = (claim[v, u - 1] == a) & (claim[v, u + 1] == a)
    return both_sides & (claim[v - 1, u] == a) & (claim[v + 1, u] == a)


@kernel(inline="always")
def inwards(readings, claim, v, u, dv, du, reach):
    """Return the number of steps from an outline pixel inwards to the first reading of its segment, at most `reach`."""
    height, width = readings.shape
    for n in range(reach):
        vv, uu = v - n * dv, u - n * du
        if vv < 0 or uu < 0 or vv >= height or uu >= width or claim[vv, uu] != claim[v, u]:
            return reach
        if readings[vv, uu] > 0.0:
            return n
    return reach


class Picture(NamedTuple):
    """A frame and its segments.

    Attributes
    ----------
    depth : (h, w) float32
        Depth with holes filled.
    readings : (h, w) float32
        Depth as measured, with holes.
    color : (h, w, 3) uint8
    claim : (h, w) int32
        Segment of each pixel, -1: none.
    on_plane : (h, w) int32
        Supporting plane on which a pixel lies, -1: none.
    """

    depth: npt.NDArray[np.float32]
    readings: npt.NDArray[np.float32]
    color: npt.NDArray[np.uint8]
    claim: npt.NDArray[np.int32]
    on_plane: npt.NDArray[np.int32]


@kernel
def across(picture, plane, v, u, dv, du, limit, reach):
    """Return the kind of neighbour across an outline pixel of a segment: the first reading outwards, beyond holes.

    Parameters
    ----------
    picture : Picture
    plane : int
        Plane on which the segment stands, -1: none.
    v, u, dv, du : int
        The pixel, and the direction outwards.
    limit : float
        Larger depth differences are jumps, metres.
    reach : int
        Largest number of steps to a reading.

    Returns
    -------
    (int, int)
        The kind, -1 if the segment itself continues beyond a hole; and the segment that begins there, -1: none.
    """
    depth, readings, color, claim, on_plane = picture
    height, width = depth.shape
    a, z = claim[v, u], depth[v, u]
    vi, ui = v - INNER_PIXELS * dv, u - INNER_PIXELS * du
    if vi < 0 or ui < 0 or vi >= height or ui >= width or claim[vi, ui] != a:
        vi, ui = v, u
    edge, first, inner_steps = False, -1, inwards(readings, claim, v, u, dv, du, reach)
    for n in range(1, reach + 1):
        vv, uu = v + n * dv, u + n * du
        if vv < 0 or uu < 0 or vv >= height or uu >= width:
            return BORDER, -1
        b, beyond = claim[vv, uu], readings[vv, uu]
        if b == a:
            return -1, -1
        first = b if first < 0 else first
        change = 0
        for c in range(3):
            change += abs(np.int64(color[vv, uu, c]) - np.int64(color[vi, ui, c]))
        edge = edge or change >= EDGE_LEVELS
        if beyond > 0.0:
            if on_plane[vv, uu] >= 0 and on_plane[vv, uu] == plane:
                return SUPPORT, b
            if beyond > z + limit:
                return FREE if edge or inner_steps + n <= reach else UNSURE, b
            if beyond < z - limit:
                return HIDDEN, b
            return UNSURE if b >= 0 else CONTACT, b
    return FREE if edge else UNSURE, first


@kernel
def outlines(picture, corners, plane_of, side_of, focal, noise, jump, gap_m, outline, contact):
    """Classify the neighbours of each segment of a frame: free space, support, other segment, other surface or unknown.

    For each outline pixel, the first reading outwards is searched, across holes up to a width of `gap_m`. The kind is
    FREE if this reading lies behind by more than a jump; SUPPORT if it lies on the plane on which the segment stands;
    UNSURE if another segment begins at the same depth; CONTACT if another surface continues there; HIDDEN if it lies in
    front (the space behind it is unknown); BORDER if the image ends. In a wide hole (dark or shiny objects) color
    decides: FREE beyond a color edge, UNSURE if the color of the segment continues. A hole extends from the last
    reading of the segment to the first reading beyond: filled pixels count as part of the hole.

    Parameters
    ----------
    picture : Picture
    corners : (count, 4) int64
        Smallest and largest column and row of each segment: left, top, right, bottom.
    plane_of : (count,) int64
        Plane on which each segment stands, -1: none.
    side_of : (4,) int64
        Side of a segment (see TOP) for the neighbours below, above, right and left in the image.
    focal : float
        Pixels.
    noise : float
        The standard deviation of depth is this value times z squared.
    jump, gap_m : float
        Metres.
    outline : (count, 4, KINDS) int64, output
        Number of outline pixels by side and kind.
    contact : (count, count) int64, output
        [i, j]: number of outline pixels of i next to j, with or without a jump.
    """
    depth, claim = picture.depth, picture.claim
    height, width = depth.shape
    outline[:] = 0
    contact[:] = 0
    for v in range(height):
        for u in range(width):
            a = claim[v, u]
            if a < 0 or (0 < v < height - 1 and 0 < u < width - 1 and surrounded(claim, v, u)):
                continue
            for k in range(4):
                dv, du = (k == 0) - (k == 1), (k == 2) - (k == 3)
                if 0 <= v + dv < height and 0 <= u + du < width and claim[v + dv, u + du] == a:
                    continue
                if side_of[k] <= BOTTOM:
                    # Top and bottom are counted only at the ends, not at the steps of a slanted side.
                    low, high = (corners[a, 1], corners[a, 3]) if k < 2 else (corners[a, 0], corners[a, 2])
                    position = v if k < 2 else u
                    to_end = high - position if dv + du > 0 else position - low
                    if to_end > max(1.0, END_FRACTION * (high - low)):
                        continue
                z = depth[v, u]
                limit = jump + JUMP_SIGMAS * noise * z * z
                reach = max(2, int(gap_m * focal / z))
                kind, b = across(picture, plane_of[a], v, u, dv, du, limit, reach)
                if b >= 0:
                    contact[a, b] += 1
                if kind >= 0:
                    outline[a, side_of[k], kind] += 1
