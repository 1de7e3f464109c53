"""A cluster of points to the box that rests on its plane: minimal-area footprint, height from the plane up."""

from __future__ import annotations

import math

import numpy as np

from cuboid.frame import Float32Array, Float64Array
from cuboid.geometry.box import Box
from cuboid.kernels.extents import best_turn, reach

# A cluster whose lowest point is within this of the plane rests on it, metres: the foot of an object is lost to the
# noise floor of the plane, and the part below a bowl's belly is seldom seen.
REST_M = 0.06
# A box whose footprint is larger by no more than this, and which is turned by at least so many steps of two degrees, is
# taken instead of the smallest one where the points of the sides, those this far below the top (metres), lie so much
# nearer to its sides. So many such boxes are looked at.
RIVAL_AREA, APART, LID_M, BETTER_SIDES, MOST_RIVALS = 1.15, 5, 0.012, 0.7, 3
# Footprints are tried every two degrees: a 30 cm box turned by one degree is 3 mm off at its ends, below the noise.
_ANGLES = np.radians(np.arange(0.0, 180.0, 2.0))
DIRECTIONS = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)])
_QUARTER = len(_ANGLES) // 2
_NOTHING = np.zeros((0, 2))
_ALONG_FIRST = np.array([[1.0, 0.0]])
# Arcs of 130 degrees of the full turn, one every ten degrees: less does not fix a radius in noise, and a half disc,
# whose ends are cut, has not much more. For each the design of c.u + r and its least-squares solver.
_ARCS = (np.arange(0, 180, 5)[:, None] + np.arange(66)[None]) % 180
_ARC_DESIGNS = np.dstack([np.concatenate([DIRECTIONS, -DIRECTIONS])[_ARCS], np.ones((36, 66))])
_ARC_SOLVERS = np.linalg.pinv(_ARC_DESIGNS)
# A round footprint follows the law of the disc to this share of its radius, and is at most this share of what was
# seen of it wide, per side: half a disc shows its whole width, but for what is lost at its edges.
ROUND_RESIDUAL, ROUND_RADIUS = 0.03, 0.6
# A disc of which no more than this is missing, metres, is whole: drift and noise widen what was seen all round by a
# centimetre in one direction.
MISSING_M = 0.012


def fit_box(
    points: Float32Array | Float64Array,
    normal: Float64Array,
    offset: float | None,
    share: float,
    weights: Float64Array | None = None,
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
    share : float
        Share of the weight that may stick out at each of the four sides, at the top and, off the plane, at the
        bottom: strays. 0..0.1.
    weights : (N,) float64, optional
        How far each point is to be believed.

    Returns
    -------
    Box
        In the points' frame; its length is not less than its width.
    """
    cloud = np.asarray(points, dtype=np.float64)
    trust = np.ones(len(cloud)) if weights is None else weights
    first, second = plane_axes(normal)
    plan = cloud @ np.array([first, second]).T
    low, high = reach_of(plan, trust, DIRECTIONS, share)
    disc = _disc(low, high)
    if disc is not None:
        along = DIRECTIONS @ disc[:2]
        low, high = np.minimum(low, along - disc[2]), np.maximum(high, along + disc[2])
    heights = np.zeros((len(cloud), 2))
    heights[:, 0] = cloud @ normal
    (bottom,), (top,) = reach_of(heights, trust, _ALONG_FIRST, share)
    if offset is not None and bottom + offset < REST_M:
        bottom = -offset
    side = heights[:, 0] < top - LID_M
    return box_within(low, high, bottom, top, normal, plan[side], trust[side])


def box_within(
    low: Float64Array,
    high: Float64Array,
    bottom: float,
    top: float,
    normal: Float64Array,
    side: Float64Array = _NOTHING,
    trust: Float64Array = _NOTHING[:, 0],
) -> Box:
    """Return the box of least footprint around what reaches from `low` to `high` in each of `DIRECTIONS`.

    Of a carton that shows two sides and not its top the footprint is a triangle, and the box along its long side is
    as small as the carton's own: then the box is taken whose sides fit the points (Zhang et al., "Efficient L-Shape
    Fitting", IV 2017, on cars in laser scans).

    Parameters
    ----------
    low, high : (90,) float64
        In the plane's own axes, see `plane_axes`; metres.
    bottom, top : float
        Along the normal, metres.
    normal : (3,) float64
        Unit.
    side : (N, 2) float64, optional
        Points of the sides, not of the top, in the plane's own axes.
    trust : (N,) float64, optional
        How far each of them is to be believed.
    """
    first, second = plane_axes(normal)
    extent = high - low
    a = best_turn(side, trust, DIRECTIONS, low, high, RIVAL_AREA, APART, BETTER_SIDES, MOST_RIVALS)
    b = a + _QUARTER
    u, v = (c * first + s * second for c, s in (DIRECTIONS[a], DIRECTIONS[b]))
    if extent[a] < extent[b]:
        # A turn by 90 degrees keeps the axes right-handed: (v, -u).
        u, v = v, -u
        size = np.array([extent[b], extent[a], 0.0])
        middle = np.array([low[b] + high[b], -(low[a] + high[a]), 0.0]) / 2.0
    else:
        size = np.array([extent[a], extent[b], 0.0])
        middle = np.array([low[a] + high[a], low[b] + high[b], 0.0]) / 2.0
    size[2], middle[2] = max(top - bottom, 0.0), (top + bottom) / 2.0
    axes = np.ascontiguousarray(np.array([u, v, normal]).T)
    return Box(center=axes @ middle, size=size, rotation=axes)


def _disc(low: Float64Array, high: Float64Array) -> Float64Array | None:
    """Return centre and radius (3,) of the disc that a footprint shows a part of, if it does.

    A can, a bottle, a ball or a bowl that was seen from one side only shows half a disc. How far a disc reaches in
    direction u is c.u + r: where that holds over an arc of 130 degrees, centre and radius follow by least squares.
    The reach of a rectangle departs from any such law by a sixth of its side.
    """
    extent = high - low
    narrow, wide = float(extent.min()), float(extent.max())
    if narrow > wide - MISSING_M:
        return None
    arcs = np.concatenate([high, -low])[_ARCS]
    fits = (_ARC_SOLVERS @ arcs[:, :, None])[:, :, 0]
    radius = fits[:, 2]
    fit = np.flatnonzero((narrow < 2.0 * radius - MISSING_M) & (radius <= ROUND_RADIUS * wide))
    if not len(fit):
        return None
    residual = np.abs(arcs[fit] - (_ARC_DESIGNS[fit] @ fits[fit][:, :, None])[:, :, 0]).max(1) / radius[fit]
    best = int(np.argmin(residual))
    return np.asarray(fits[fit[best]]) if residual[best] <= ROUND_RESIDUAL else None


def plane_axes(normal: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return two axes (3,) that make a right-handed frame with a unit normal."""
    # In plain numbers: NumPy's products of such short vectors take ten times as long, and every box asks for them.
    x, y, z = normal.tolist()
    least = min(abs(x), abs(y), abs(z))
    a, b, c = (0.0, -z, y) if abs(x) == least else (z, 0.0, -x) if abs(y) == least else (-y, x, 0.0)
    long = math.sqrt(a * a + b * b + c * c)
    a, b, c = a / long, b / long, c / long
    return np.array([a, b, c]), np.array([y * c - z * b, z * a - x * c, x * b - y * a])


def reach_of(
    points: Float64Array, weights: Float64Array, directions: Float64Array, share: float
) -> tuple[Float64Array, Float64Array]:
    """Return from where to where (D,) points (N, 2) reach along directions (D, 2), but for a share of their weight."""
    low, high = np.empty(len(directions)), np.empty(len(directions))
    reach(points, weights, directions, share, low, high)
    return low, high
