"""First poses of two still views that see the same plane, from the heights above it, and how well they agree.

The same supporting plane in two views leaves a turn about its normal and a shift along it. These follow from the maps
of heights above the plane, which are correlated for each turn.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.geometry.se3 import assembled, inverse, transform
from cuboid.inputs.calibration.rig_alignment import in_view
from cuboid.inputs.calibration.still_view import StillView

# Planes of a view that may be the one that another view shows too; points within this distance lie on it, metres.
PLANES_PER_VIEW, VIEW_PLANE_M, SAME_NORMAL_COS = 3, 0.012, 0.95
PLANE_TRIALS, MIN_PLANE_POINTS = 200, 400
# Map of heights: edge of a cell and largest height, metres; half its side, cells; what an empty cell counts, metres.
HEIGHT_CELL_M, HIGHEST_M, HALF_CELLS, EMPTY_M = 0.02, 0.5, 96, -0.03
# Step between the tried turns, radians; candidates of each pair of planes, and those of two views that are aligned.
TURN_RAD, TURNS, MAX_ALIGNED = np.radians(4.0), 5, 6
# Points of a view that are used for maps of heights.
MAP_POINTS = 15_000
# A reading confirms a point within this distance; one that is farther away by more than this contradicts it, metres.
CONFIRMED_M, CONTRADICTED_M = 0.015, 0.04
# A contradicted point counts more than a confirmed one, since large planes confirm points in wrong places too: in made
# rigs .1 % of the points contradict the right place, and 10 % the best wrong one.
CONTRADICTION = 20.0


def candidates(one: StillView, other: StillView) -> list[Float64Array]:
    """Return the likeliest T_one_other (4, 4), from the planes of both views."""
    planes_one, planes_other = _planes(one), _planes(other)
    found = [
        inverse(T_plane_one) @ T_plane_turned @ T_plane_other
        for T_plane_one in planes_one
        for T_plane_other in planes_other
        for T_plane_turned in _turns(one, other, T_plane_one, T_plane_other)
    ]
    return sorted(found, key=lambda T: -score(one, other, T))[:MAX_ALIGNED]


def _planes(view: StillView) -> list[Float64Array]:
    """Return T_plane_camera (4, 4) of the widest planes of a view: z is the normal towards the camera."""
    rng, left, found = np.random.default_rng(0), np.ones(len(view.points), bool), []
    for _ in range(PLANES_PER_VIEW):
        index = np.flatnonzero(left)
        if len(index) < MIN_PLANE_POINTS:
            break
        best = np.zeros(len(view.points), bool)
        for k in rng.choice(index, PLANE_TRIALS):
            on = left & _on_plane(view, view.normals[k], view.points[k])
            best = on if on.sum() > best.sum() else best
        for _ in range(2):  # with the plane through all of its points
            center = view.points[best].mean(0)
            normal = np.linalg.eigh(np.cov((view.points[best] - center).T))[1][:, 0]
            normal = -normal if normal @ center > 0 else normal
            best = left & _on_plane(view, normal, center)
        if best.sum() < MIN_PLANE_POINTS:
            break
        found.append(_frame_of(normal, center))
        left &= ~best
    return found


def _on_plane(view: StillView, normal: Float64Array, center: Float64Array) -> npt.NDArray[np.bool_]:
    near = np.abs((view.points - center) @ normal) < VIEW_PLANE_M
    return np.asarray(near & (view.normals @ normal > SAME_NORMAL_COS))


def _frame_of(normal: Float64Array, center: Float64Array) -> Float64Array:
    """Return T_plane_camera (4, 4) of a plane: its origin is at the center."""
    across = np.cross(normal, (0.0, 1.0, 0.0) if abs(normal[1]) < 0.9 else (1.0, 0.0, 0.0))
    across /= np.linalg.norm(across)
    rotation = np.stack([across, np.cross(normal, across), normal])
    return assembled(rotation, -rotation @ center)


def _turns(
    one: StillView, other: StillView, T_plane_one: Float64Array, T_plane_other: Float64Array
) -> list[Float64Array]:
    """Return the likeliest motions (4, 4) along the plane from the other view's plane to that of one view."""
    of_one, of_other = (view.points[:: 1 + len(view.points) // MAP_POINTS] for view in (one, other))
    fixed = np.fft.rfft2(_heights(transform(T_plane_one, of_one)))
    points, found = transform(T_plane_other, of_other), []
    for turn in np.arange(0.0, 2 * np.pi, TURN_RAD):
        T = np.eye(4)
        T[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
        scores = np.fft.irfft2(fixed * np.conj(np.fft.rfft2(_heights(transform(T, points)))))
        row, column = np.unravel_index(np.argmax(scores), scores.shape)
        shift = [(int(k) + HALF_CELLS) % (2 * HALF_CELLS) - HALF_CELLS for k in (column, row)]
        T[:2, 3] = np.array(shift) * HEIGHT_CELL_M
        found.append((float(scores[row, column]), T))
    found.sort(key=lambda item: -item[0])
    return [T for _, T in found[:TURNS]]


def _heights(points: Float64Array) -> Float64Array:
    """Return the map of heights above a plane: positive on objects, negative where the plane is empty, else 0."""
    cells = np.floor(points[:, :2] / HEIGHT_CELL_M).astype(np.int64) + HALF_CELLS
    inside = ((cells >= 0) & (cells < 2 * HALF_CELLS)).all(1) & (points[:, 2] < HIGHEST_M)
    (x, y), z = cells[inside].T, points[inside, 2]
    heights = np.zeros((2 * HALF_CELLS, 2 * HALF_CELLS))
    flat, high = np.abs(z) < VIEW_PLANE_M, z >= VIEW_PLANE_M
    heights[y[flat], x[flat]] = EMPTY_M
    np.maximum.at(heights, (y[high], x[high]), z[high])
    return heights


def score(one: StillView, other: StillView, T_one_other: Float64Array) -> float:
    """Return how well two views agree at a pose (4, 4): points that are confirmed, less those that are contradicted."""
    confirmed, contradicted = np.add(agreement(one, other, T_one_other), agreement(other, one, inverse(T_one_other)))
    return float(confirmed - CONTRADICTION * contradicted)


def agreement(one: StillView, other: StillView, T_one_other: Float64Array) -> tuple[int, int]:
    """Return how many points of another view, at a pose (4, 4), a view confirms, and how many it contradicts."""
    points, seen_m = in_view(one, transform(T_one_other, other.points))
    z = points[:, 2]
    confirmed = (seen_m > 0) & (np.abs(seen_m - z) < CONFIRMED_M)
    contradicted = (seen_m > 0) & (seen_m > z + CONTRADICTED_M)
    return int(confirmed.sum()), int(contradicted.sum())
