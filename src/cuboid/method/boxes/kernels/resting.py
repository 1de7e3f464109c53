"""Hot loop: the box around a weighted cloud of points that rests on a plane."""

from __future__ import annotations

import math

import numpy as np

from cuboid.ground.compiling.compiled import kernel
from cuboid.ground.core.tolerances import DRIFT_M, JUMP_M
from cuboid.method.boxes.kernels.extents import best_turn, reach

# A cluster whose lowest point is within this distance of the plane rests on it, metres: the foot of an object vanishes
# in the noise of the plane, and the part below a bowl's belly is seldom seen.
REST_M = 2.0 * DRIFT_M
# A box with at most this times the smallest footprint replaces the smallest one if it halves the variance of the side
# points (those below the top by a jump) around the sides.
RIVAL_AREA, BETTER_SIDES = 1.2, math.sqrt(0.5)
# A round footprint follows the law of the disc to ROUND_RESIDUAL of its radius, and its radius is at most ROUND_RADIUS
# of the visible width: half a disc shows its whole width, except for losses at its edges.
ROUND_RESIDUAL, ROUND_RADIUS = 0.03, 0.6
# A disc of which at most this much is missing, metres, is complete: drift and noise widen a fully seen footprint by a
# centimetre in one direction.
MISSING_M = JUMP_M
# Length and width are equal within this, metres: for a round footprint the first direction wins, not rounding errors.
SAME_LENGTH_M = 1e-9
# Shortest side, metres: points that are exactly level, or all in one place, still have a box.
MIN_M = 1e-3


@kernel
def fit_each(points, first, normals, offsets, fraction, directions, solvers, boxes):
    """Fit a box to each of several clouds of points of equal weight.

    Parameters
    ----------
    points : (N, 3) float64
        All clouds, one after the other.
    first : (K + 1,) int64
        Begin of each cloud, and the end of the last one.
    normals : (K, 3) float64
    offsets : (K,) float64
    boxes : (K, 15) float64, output
        The result of `fit` for each cloud.
    """
    trust = np.ones(points.shape[0])
    for k in range(first.size - 1):
        cloud = slice(first[k], first[k + 1])
        fit(points[cloud], trust[cloud], normals[k], offsets[k], fraction, directions, solvers, boxes[k])


@kernel
def plane_axes(normal, axes):
    """Write two axes that form a right-handed frame with a unit normal (3,), and the normal: (3, 3), row by row."""
    x, y, z = normal[0], normal[1], normal[2]
    smallest = min(abs(x), abs(y), abs(z))
    a, b, c = (0.0, -z, y) if abs(x) == smallest else (z, 0.0, -x) if abs(y) == smallest else (-y, x, 0.0)
    long = np.sqrt(a * a + b * b + c * c)
    a, b, c = a / long, b / long, c / long
    axes[0, 0], axes[0, 1], axes[0, 2] = a, b, c
    axes[1, 0], axes[1, 1], axes[1, 2] = y * c - z * b, z * a - x * c, x * b - y * a
    axes[2, 0], axes[2, 1], axes[2, 2] = x, y, z


@kernel
def fit(points, weights, normal, offset, fraction, directions, solvers, box):
    """Fit the box of minimal footprint whose third axis is a plane's normal.

    Parameters
    ----------
    points : (N, 3) float64
        At least one, metres.
    weights : (N,) float64
    normal : (3,) float64
        Unit.
    offset : float
        The plane is normal.p + offset = 0; NaN: no known support, the box ends at the lowest point.
    fraction : float
        Fraction of the weight that may lie outside at each side.
    directions : (2 Q, 2) float64
        Uniformly over half a turn, in the axes of the plane.
    solvers : (K, 3, L) float64
        See `disc`.
    box : (15,) float64, output
        Centre, size, rotation row by row.
    """
    axes, n = np.empty((3, 3)), points.shape[0]
    plane_axes(normal, axes)
    plan, heights = np.empty((n, 2)), np.empty(n)
    for i in range(n):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        plan[i, 0] = x * axes[0, 0] + y * axes[0, 1] + z * axes[0, 2]
        plan[i, 1] = x * axes[1, 0] + y * axes[1, 1] + z * axes[1, 2]
        heights[i] = x * axes[2, 0] + y * axes[2, 1] + z * axes[2, 2]
    low, high = np.empty(directions.shape[0]), np.empty(directions.shape[0])
    reach(plan, weights, directions, fraction, low, high)
    x, y, radius = disc(low, high, directions, solvers)
    if radius > 0.0:
        for d in range(directions.shape[0]):
            along = x * directions[d, 0] + y * directions[d, 1]
            low[d], high[d] = min(low[d], along - radius), max(high[d], along + radius)
    upright, bottom, top = np.zeros((n, 2)), np.empty(1), np.empty(1)
    for i in range(n):
        upright[i, 0] = heights[i]
    reach(upright, weights, np.array([[1.0, 0.0]]), fraction, bottom, top)
    # An object that lies completely below the plane rests on something else.
    if bottom[0] + offset < REST_M and top[0] + offset > 0.0:
        bottom[0] = -offset
    side, trust, sides = np.empty((n, 2)), np.empty(n), 0
    for i in range(n):
        if heights[i] < top[0] - JUMP_M:
            side[sides, 0], side[sides, 1], trust[sides] = plan[i, 0], plan[i, 1], weights[i]
            sides += 1
    around(low, high, bottom[0], top[0], axes, directions, side[:sides], trust[:sides], box)


@kernel
def around(low, high, bottom, top, axes, directions, side, trust, box):
    """Find the box of minimal footprint around the extents from `low` to `high` in each direction.

    If a carton shows two sides and not its top, its footprint is a triangle, and the box along its long side is as
    small as the true box. Then the box whose sides fit the points is taken (Zhang et al., "Efficient L-Shape Fitting",
    IV 2017, for cars in laser scans).

    Parameters
    ----------
    low, high : (2 Q,) float64
        In the axes of the plane, metres.
    bottom, top : float
        Along the normal, metres.
    axes : (3, 3) float64
        See `plane_axes`.
    directions, box
        As for `fit`.
    side : (M, 2) float64
        Points of the sides, not of the top, in the axes of the plane; may be empty.
    trust : (M,) float64
        Weight of each of these points.
    """
    turn = best_turn(side, trust, directions, low, high, RIVAL_AREA, BETTER_SIDES)
    turned(low, high, turn, bottom, top, axes, directions, box)


@kernel
def turned(low, high, turn, bottom, top, axes, directions, box):
    """Write the box with the direction of index `turn` (0..Q-1); see `around`."""
    a, b = turn, turn + directions.shape[0] // 2
    length, width = high[a] - low[a], high[b] - low[b]
    x, y = (low[a] + high[a]) / 2.0, (low[b] + high[b]) / 2.0
    ux, uy, vx, vy = directions[a, 0], directions[a, 1], directions[b, 0], directions[b, 1]
    if length < width - SAME_LENGTH_M:
        # A rotation by 90 degrees keeps the axes right-handed: (v, -u).
        length, width, x, y = width, length, y, -x
        ux, uy, vx, vy = vx, vy, -ux, -uy
    z = (top + bottom) / 2.0
    box[3], box[4], box[5] = max(length, width, MIN_M), max(min(length, width), MIN_M), max(top - bottom, MIN_M)
    for k in range(3):
        u, v = ux * axes[0, k] + uy * axes[1, k], vx * axes[0, k] + vy * axes[1, k]
        box[6 + 3 * k], box[7 + 3 * k], box[8 + 3 * k] = u, v, axes[2, k]
        box[k] = u * x + v * y + axes[2, k] * z


@kernel
def disc(low, high, directions, solvers):
    """Return centre and radius of the disc of which the footprint is a part; a radius of 0 if there is none.

    A can, a bottle, a ball or a bowl that was seen from one side shows only half a disc. The extent of a disc in
    direction u is c.u + r: where this holds over an arc of 130 degrees, centre and radius follow by least squares. The
    extent of a rectangle deviates from any such law by a sixth of its side.

    Parameters
    ----------
    low, high : (2 Q,) float64
        Extents of all points along each direction, metres.
    directions : (2 Q, 2) float64
        Uniformly over half a turn.
    solvers : (K, 3, L) float64
        For each of K arcs, uniformly over the full turn, the matrix that maps its L <= 2 Q extents to centre and
        radius.
    """
    half, (arcs, _, long) = directions.shape[0], solvers.shape
    extent = high - low
    narrow, wide = extent.min(), extent.max()
    x = y = radius = 0.0
    if narrow > wide - MISSING_M:
        return x, y, radius
    # In the second half of the turn, the directions and extents are the negative ones of the first half. The arrays
    # hold one and a half turns, so that no arc wraps around.
    reached, turned = np.concatenate((high, -low, high)), np.concatenate((directions, -directions, directions))
    best_residual = np.inf
    for k in range(arcs):
        first = k * 2 * half // arcs
        a = b = r = 0.0
        for j in range(long):
            value = reached[first + j]
            a, b, r = a + solvers[k, 0, j] * value, b + solvers[k, 1, j] * value, r + solvers[k, 2, j] * value
        if not (narrow < 2.0 * r - MISSING_M and r <= ROUND_RADIUS * wide):
            continue
        off = 0.0
        for d in range(first, first + long):
            off = max(off, abs(reached[d] - (a * turned[d, 0] + b * turned[d, 1] + r)))
        if off < best_residual * r:
            best_residual, x, y, radius = off / r, a, b, r
    return (x, y, radius) if best_residual <= ROUND_RESIDUAL else (0.0, 0.0, 0.0)
