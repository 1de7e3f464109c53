"""The noise that a box holds besides its object, taken off again."""

from __future__ import annotations

import numpy as np

from cuboid.boxes.kernels.extents import side_layers
from cuboid.core.frame import Float64Array
from cuboid.core.tolerances import JUMP_SIGMAS, MIN_SIGMA_M
from cuboid.geometry.box import Box

# A side is moved by at most this fraction of the size of the box.
MAX_MOVE_FRACTION = 0.2


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
    band = JUMP_SIGMAS * max(noise_m, MIN_SIGMA_M)
    side_layers(points, trust, box.center, np.ascontiguousarray(box.rotation), half, band, layers)
    outer, depth, inner = layers.T
    some = np.maximum(outer, 1e-12)
    moved = depth / some * np.maximum(0.0, 1.0 - inner / some)
    if top_alone:
        moved[:4] = 0.0
    moved = np.minimum(moved, MAX_MOVE_FRACTION * box.size[[0, 0, 1, 1, 2]])
    high = half - moved[[0, 2, 4]]
    low = half - np.array([moved[1], moved[3], 0.0])
    size, center = high + low, box.center + box.rotation @ ((high - low) / 2.0)
    if size[0] >= size[1]:
        return Box(center, size, box.rotation)
    # A turn by 90 degrees keeps the axes right-handed.
    turned = np.column_stack([box.rotation[:, 1], -box.rotation[:, 0], box.rotation[:, 2]])
    return Box(center, size[[1, 0, 2]], turned)
