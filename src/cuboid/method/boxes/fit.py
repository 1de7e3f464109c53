"""Fit of a box that rests on a plane to a cluster of points: footprint of minimal area, height from the plane up."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.tolerances import MIN_SIGMA_M
from cuboid.ground.geometry.box import Box
from cuboid.method.boxes.kernels import resting as kernel
from cuboid.method.boxes.kernels.extents import reach

# Footprints are tried every two degrees: a 30 cm box rotated by one degree is 3 mm off at its ends, below the noise.
_ANGLES = np.radians(np.arange(0.0, 180.0, 2.0))
DIRECTIONS = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)])
# Arcs of 130 degrees, one every ten degrees of a full turn: less does not determine a radius in noise, and a half disc
# with cut ends shows hardly more. For each arc the least-squares solver of c.u + r.
ARCS = (np.arange(0, 180, 5)[:, None] + np.arange(66)[None]) % 180
ARC_DESIGNS = np.dstack([np.concatenate([DIRECTIONS, -DIRECTIONS])[ARCS], np.ones((36, 66))])
ARC_SOLVERS = np.linalg.pinv(ARC_DESIGNS)
# Normal, and offset or None if no known plane lies beneath.
Resting = tuple[Float64Array, float | None]
_NO_SIDE, _NO_TRUST, _NO_ARCS = np.zeros((0, 2)), np.zeros(0), np.zeros((0, 3, ARCS.shape[1]))


def fit_box(
    points: Float32Array | Float64Array,
    normal: Float64Array,
    offset: float | None,
    fraction: float,
    weights: Float64Array | None = None,
    *,
    discs: bool = True,
) -> Box:
    """Fit the box of minimal footprint whose third axis is a plane's normal.

    Parameters
    ----------
    points : (N, 3)
        At least one, metres.
    normal : (3,) float64
        Unit normal of the supporting plane, or up.
    offset : float or None
        The plane is normal.p + offset = 0; None: no known support, the box ends at the lowest point.
    fraction : float
        Fraction of the weight, 0..0.1, that may lie outside at each of the four sides, at the top and, for a box that
        does not rest on the plane, at the bottom: outliers.
    weights : (N,) float64, optional
        Weight of each point.
    discs : bool
        Whether a footprint that is a part of a disc is extended to the whole disc.

    Returns
    -------
    Box
        In the frame of the points; its length is not less than its width.
    """
    cloud = np.ascontiguousarray(points, dtype=np.float64)
    trust = np.ones(len(cloud)) if weights is None else weights
    row = np.empty(15)
    rest = math.nan if offset is None else offset
    solvers = ARC_SOLVERS if discs else _NO_ARCS
    kernel.fit(cloud, trust, np.ascontiguousarray(normal), rest, fraction, DIRECTIONS, solvers, row)
    return _box(row)


def fit_boxes(points: Float64Array, counts: Sequence[int], planes: Sequence[Resting], fraction: float) -> list[Box]:
    """Fit a box to each of several clouds; see `fit_box`.

    Parameters
    ----------
    points : (N, 3) float64
        All clouds, one after the other.
    counts : sequence of int
        Number of points of each cloud, at least one.
    planes : sequence of ((3,) float64, float or None)
        Normal and offset of the support of each cloud.
    fraction : float
    """
    if not counts:
        return []
    first = np.cumsum([0, *counts])
    normals = np.array([normal for normal, _ in planes])
    offsets = np.array([math.nan if offset is None else offset for _, offset in planes])
    rows = np.empty((len(counts), 15))
    kernel.fit_each(points, first, normals, offsets, fraction, DIRECTIONS, ARC_SOLVERS, rows)
    turned = rows[:, 6:].reshape(-1, 3, 3)
    return [Box(*parts) for parts in zip(rows[:, :3], rows[:, 3:6], turned, strict=True)]


def box_within(
    low: Float64Array, high: Float64Array, bottom: float, top: float, normal: Float64Array, towards: float | None = None
) -> Box:
    """Return the box of minimal footprint around the extents from `low` to `high` along each of `DIRECTIONS`.

    Footprints that differ by less than the smallest depth error are equivalent. Of these, the one best aligned with
    `towards` is taken; otherwise noise would decide, and the box would rotate from fit to fit.

    Parameters
    ----------
    low, high : (90,) float64
        Extents in the axes of the plane, see `plane_axes`; metres.
    bottom, top : float
        Along the normal, metres.
    normal : (3,) float64
        Unit.
    towards : float, optional
        Preferred direction in the axes of the plane, radians.
    """
    row = np.empty(15)
    if towards is None:
        kernel.around(low, high, bottom, top, _axes(normal), DIRECTIONS, _NO_SIDE, _NO_TRUST, row)
        return _box(row)
    quarter = len(DIRECTIONS) // 2
    length, width = np.split(high - low, 2)
    area = length * width
    smallest = int(area.argmin())
    alike = area <= area[smallest] + 2.0 * MIN_SIGMA_M * (length[smallest] + width[smallest])
    turn = (_ANGLES[:quarter] - towards) % (math.pi / 2)
    off = np.minimum(turn, math.pi / 2 - turn)
    kernel.turned(low, high, int(np.where(alike, off, np.inf).argmin()), bottom, top, _axes(normal), DIRECTIONS, row)
    return _box(row)


def _axes(normal: Float64Array) -> Float64Array:
    axes = np.empty((3, 3))
    kernel.plane_axes(np.ascontiguousarray(normal), axes)
    return axes


def _box(row: Float64Array) -> Box:
    return Box(center=row[:3], size=row[3:6], rotation=row[6:].reshape(3, 3))


def plane_axes(normal: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return two axes (3,) that make a right-handed frame with a unit normal."""
    first, second, _ = _axes(normal)
    return first, second


def reach_of(
    points: Float64Array, weights: Float64Array, directions: Float64Array, fraction: float
) -> tuple[Float64Array, Float64Array]:
    """Return the extents (D,), low and high, of points (N, 2) along directions (D, 2) without outliers."""
    low, high = np.empty(len(directions)), np.empty(len(directions))
    reach(points, weights, directions, fraction, low, high)
    return low, high
