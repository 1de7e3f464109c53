"""A cluster of points to the box that rests on its plane: minimal-area footprint, height from the plane up."""

from __future__ import annotations

import numpy as np

from cuboid.frame import Float32Array, Float64Array
from cuboid.geometry.box import Box
from cuboid.geometry.rectangle import min_area_rectangle

# A cluster whose lowest point is within this of the plane rests on it, metres: the foot of an object is lost to the
# noise floor of the plane, and the part below a bowl's belly is seldom seen.
REST_M = 0.06


def fit_box(
    points: Float32Array | Float64Array,
    normal: Float64Array,
    offset: float | None,
    trim: float = 0.0,
) -> Box:
    """Fit the box of minimal footprint whose third axis is a plane's normal.

    Parameters
    ----------
    points : (N, 3)
        At least one, metres.
    normal : (3,) float64
        Unit normal of the supporting plane, or up.
    offset : float or None
        The plane is normal.p + offset = 0; None: the cluster stands on nothing known and ends at its lowest point.
    trim : float
        Share of the points that may stick out at each of the four sides and at the top, 0..0.1: strays of a single
        frame.

    Returns
    -------
    Box
        In the points' frame; its length is not less than its width.
    """
    cloud = np.asarray(points, dtype=np.float64)
    side = np.eye(3)[int(np.argmin(np.abs(normal)))]
    first = np.cross(side, normal)
    first /= np.linalg.norm(first)
    second = np.cross(normal, first)
    plan = np.column_stack([cloud @ first, cloud @ second])
    heights = cloud @ normal
    _, _, angle = min_area_rectangle(plan)
    c, s = np.cos(angle), np.sin(angle)
    along, across = plan @ np.array([c, s]), plan @ np.array([-s, c])
    low_a, high_a = _range(along, trim)
    low_b, high_b = _range(across, trim)
    low, high = _range(heights, trim)
    if offset is not None and low + offset < REST_M:
        low = -offset
    axes = np.column_stack([c * first + s * second, -s * first + c * second, normal])
    size = np.array([high_a - low_a, high_b - low_b, max(high - low, 0.0)])
    middle = np.array([low_a + high_a, low_b + high_b, low + high]) / 2.0
    if size[0] < size[1]:  # after trimming the other side may be the longer one
        axes = np.column_stack([axes[:, 1], -axes[:, 0], axes[:, 2]])
        size, middle = size[[1, 0, 2]], np.array([middle[1], -middle[0], middle[2]])
    return Box(center=axes @ middle, size=size, rotation=axes)


def _range(values: Float64Array, trim: float) -> tuple[float, float]:
    k = int(trim * len(values))
    if k == 0:
        return float(values.min()), float(values.max())
    ordered = np.partition(values, (k, len(values) - 1 - k))
    return float(ordered[k]), float(ordered[len(values) - 1 - k])
