"""Hot loop: the box that rests on a plane, around a weighted cloud of points."""

from __future__ import annotations

import math

import numpy as np

from cuboid.boxes.kernels.extents import best_turn, reach
from cuboid.core.compiled import kernel
from cuboid.core.tolerances import DRIFT_M, JUMP_M

# A cluster whose lowest point is within this of the plane rests on it, metres: the foot of an object is lost to the
# noise floor of the plane, and the part below a bowl's belly is seldom seen.
REST_M = 2.0 * DRIFT_M
# A box whose footprint is at most this much larger replaces the smallest one where that takes away half of the
# variance by which points of the sides, a jump below the top, depart from these.
RIVAL_AREA, BETTER_SIDES = 1.2, math.sqrt(0.5)
# A round footprint follows the law of the disc to this fraction of its radius, and is at most this fraction of what was
# seen of it wide, per side: half a disc shows its whole width, but for what is lost at its edges.
ROUND_RESIDUAL, ROUND_RADIUS = 0.03, 0.6
# A disc of which no more than this is missing, metres, is whole: drift and noise widen what was seen all round by a
# centimetre in one direction.
MISSING_M = JUMP_M
# Length and width are alike within this, metres: of a round footprint the first direction counts, and not what the
# last bit of a sum favours.
ALIKE_M = 1e-9
# No side is shorter, metres: points that lie exactly level, or in one place, still have a box.
MIN_M = 1e-3


@kernel
def fit_each(points, first, normals, offsets, fraction, directions, solvers, boxes):
    """Fit a box to each of several clouds of points that are believed alike.

    Parameters
    ----------
    points : (N, 3) float64
        One cloud after the other.
    first : (K + 1,) int64
        Where each begins, and the end of the last one.
    normals : (K, 3) float64
    offsets : (K,) float64
    boxes : (K, 15) float64, output
        For each cloud what `fit` takes and gives.
    """
    trust = np.ones(points.shape[0])
    for k in range(first.size - 1):
        own = slice(first[k], first[k + 1])
        fit(points[own], trust[own], normals[k], offsets[k], fraction, directions, solvers, boxes[k])


@kernel
def plane_axes(normal, axes):
    """Write two axes that make a right-handed frame with a unit normal (3,), and the normal: (3, 3), row by row."""
    x, y, z = normal[0], normal[1], normal[2]
    least = min(abs(x), abs(y), abs(z))
    a, b, c = (0.0, -z, y) if abs(x) == least else (z, 0.0, -x) if abs(y) == least else (-y, x, 0.0)
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
        The plane is normal.p + offset = 0; NaN: the cluster stands on nothing known and ends at its lowest point.
    fraction : float
        Fraction of the weight that may stick out at each side.
    directions : (2 Q, 2) float64
        Evenly over half a turn, in the plane's axes.
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
    upright[:, 0] = heights
    reach(upright, weights, np.array([[1.0, 0.0]]), fraction, bottom, top)
    # An object that lies wholly below the plane rests on something else.
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
    """Find the box of least footprint around what reaches from `low` to `high` in each direction.

    Of a carton that shows two sides and not its top the footprint is a triangle, and the box along its long side is
    as small as the carton's own: then the box is taken whose sides fit the points (Zhang et al., "Efficient L-Shape
    Fitting", IV 2017, on cars in laser scans).

    Parameters
    ----------
    low, high : (2 Q,) float64
        In the plane's axes, metres.
    bottom, top : float
        Along the normal, metres.
    axes : (3, 3) float64
        See `plane_axes`.
    directions, box
        As for `fit`.
    side : (M, 2) float64
        Points of the sides, not of the top, in the plane's axes; there may be none.
    trust : (M,) float64
        How far each of them is to be believed.
    """
    turn = best_turn(side, trust, directions, low, high, RIVAL_AREA, BETTER_SIDES)
    turned(low, high, turn, bottom, top, axes, directions, box)


@kernel
def turned(low, high, turn, bottom, top, axes, directions, box):
    """Write the box that is turned as direction number `turn` (0..Q-1) is; see `around`."""
    a, b = turn, turn + directions.shape[0] // 2
    length, width = high[a] - low[a], high[b] - low[b]
    x, y = (low[a] + high[a]) / 2.0, (low[b] + high[b]) / 2.0
    ux, uy, vx, vy = directions[a, 0], directions[a, 1], directions[b, 0], directions[b, 1]
    if length < width - ALIKE_M:
        # A turn by 90 degrees keeps the axes right-handed: (v, -u).
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
    """Return centre and radius of the disc that a footprint shows a part of; a radius of 0 where it shows none.

    A can, a bottle, a ball or a bowl that was seen from one side only shows half a disc. How far a disc reaches in
    direction u is c.u + r: where that holds over an arc of 130 degrees, centre and radius follow by least squares.
    The reach of a rectangle departs from any such law by a sixth of its side.

    Parameters
    ----------
    low, high : (2 Q,) float64
        How far everything reaches along each direction, metres.
    directions : (2 Q, 2) float64
        Evenly over half a turn.
    solvers : (K, 3, L) float64
        For each of K arcs, evenly over the full turn, what its L <= 2 Q reaches are multiplied with to give centre and
        radius.
    """
    half, (arcs, _, long) = directions.shape[0], solvers.shape
    extent = high - low
    narrow, wide = extent.min(), extent.max()
    x = y = radius = 0.0
    if narrow > wide - MISSING_M:
        return x, y, radius
    # Behind half a turn the directions, and what is reached along them, are those before it the other way round. It is
    # laid out one and a half times round, so that no arc has to begin anew.
    reached, turned = np.concatenate((high, -low, high)), np.concatenate((directions, -directions, directions))
    least = np.inf
    for k in range(arcs):
        first = k * 2 * half // arcs
        a = b = r = 0.0
        for j in range(long):
            here = reached[first + j]
            a, b, r = a + solvers[k, 0, j] * here, b + solvers[k, 1, j] * here, r + solvers[k, 2, j] * here
        if not (narrow < 2.0 * r - MISSING_M and r <= ROUND_RADIUS * wide):
            continue
        off = 0.0
        for d in range(first, first + long):
            off = max(off, abs(reached[d] - (a * turned[d, 0] + b * turned[d, 1] + r)))
        if off < least * r:
            least, x, y, radius = off / r, a, b, r
    return (x, y, radius) if least <= ROUND_RESIDUAL else (0.0, 0.0, 0.0)
