"""The sides of a box, one by one: out to where its object ends, and into the faces that were seen."""

from __future__ import annotations

import math

import numpy as np

from cuboid.boxes.fit import reach_of
from cuboid.frame import Float64Array
from cuboid.geometry.box import Box
from cuboid.kernels.extents import side_layers
from cuboid.tolerances import JUMP_SIGMAS, LEAST_SIGMA_M, SIGMAS, SOME

# Of normal noise this share departs farther than readings of a surface do.
TAIL_SHARE = math.erfc(SIGMAS / math.sqrt(2.0))


def to_ends(box: Box, points: Float64Array, trust: Float64Array, share: float, stands: bool, top_alone: bool) -> Box:
    """Return a box whose sides lie where its points end, but for the tail of their noise.

    What is left out as strays is a share of all of an object. Of a side of which little was seen, as of the far one,
    and of what is long and evenly dense, that is more than strays: the side is moved out again, no farther than such a
    share cuts off where only some was seen of what is seen elsewhere. So what is not the object's, and lies farther
    out, moves it by little.

    Parameters
    ----------
    box : Box
        Around the points but for strays.
    points : (N, 3) float64
        World, metres.
    trust : (N,) float64
    share : float
        Share of the trust that was left out at each side.
    stands : bool
        Whether the box stands on its plane: the bottom stays.
    top_alone : bool
        Only the top is moved: the other sides are known better.
    """
    own = (points - box.center) @ box.rotation
    plan, upright, axes = own[:, :2].copy(), np.zeros((len(own), 2)), np.eye(2)
    upright[:, 0] = own[:, 2]
    reaches = reach_of(plan, trust, axes, TAIL_SHARE), reach_of(upright, trust, axes[:1], TAIL_SHARE)
    low, high = np.concatenate(reaches, axis=1)
    half, most = box.size / 2.0, (share - TAIL_SHARE) / SOME * box.size
    moved_low, moved_high = np.clip(-half - low, 0.0, most), np.clip(high - half, 0.0, most)
    if stands or top_alone:
        moved_low[2] = 0.0
    if top_alone:
        moved_low[:2] = moved_high[:2] = 0.0
    return _moved(box, moved_low, moved_high)


def _moved(box: Box, low: Float64Array, high: Float64Array) -> Box:
    """Return a box whose sides lie farther out, metres (3,) along its axes; less than 0 is farther in."""
    size, center = box.size + low + high, box.center + box.rotation @ ((high - low) / 2.0)
    if size[0] >= size[1]:
        return Box(center, size, box.rotation)
    # A turn by 90 degrees keeps the axes right-handed.
    turned = np.column_stack([box.rotation[:, 1], -box.rotation[:, 0], box.rotation[:, 2]])
    return Box(center, size[[1, 0, 2]], turned)


def to_faces(box: Box, points: Float64Array, trust: Float64Array, noise_m: float, top_alone: bool) -> Box:
    """Return a box whose sides lie in the middle of the faces that were seen, not at the outer end of their noise.

    A flat face is a dense layer of points beneath its side, and little beneath that layer: the side is moved to the
    layer's middle, the less the more there is beneath. Where a side was not seen, what the top ends with there is
    evenly dense, and the side stays.

    Parameters
    ----------
    box : Box
    points : (N, 3) float64
        World, metres.
    trust : (N,) float64
    noise_m : float
        Standard deviation of the points of a face, metres.
    top_alone : bool
        Only the top is moved: the sides are known better.
    """
    layers = np.empty((5, 3))
    half = box.size / 2.0
    band = JUMP_SIGMAS * max(noise_m, LEAST_SIGMA_M)
    side_layers(points, trust, box.center, np.ascontiguousarray(box.rotation), half, band, layers)
    outer, depth, inner = layers.T
    some = np.maximum(outer, 1e-12)
    moved = depth / some * np.maximum(0.0, 1.0 - inner / some)
    if top_alone:
        moved[:4] = 0.0
    moved = np.minimum(moved, SOME * box.size[[0, 0, 1, 1, 2]])
    return _moved(box, -np.array([moved[1], moved[3], 0.0]), -moved[[0, 2, 4]])
