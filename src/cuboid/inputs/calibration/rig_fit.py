"""Extrinsics of fixed cameras from the scene that they see: planes and heights for the start, depth for the rest.

Each camera gives one still view: the median of some of its frames, without pixels whose depth changes. In two views the
same supporting plane leaves a turn about its normal and a shift along it. These follow from the maps of heights above
the plane, which are correlated for each turn. Of several candidates, the one counts that most readings of the other
camera confirm and that fewest contradict. Point-to-plane alignment (Chen and Medioni 1992) of all views together gives
the final poses.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.depth import without_mixed
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.tolerances import DEPTH_NOISE_PER_M
from cuboid.ground.geometry.se3 import angle, exp, inverse, tidied, transform

# A pixel is still if this fraction of its readings lies within STILL_SIGMAS standard deviations and STILL_M, metres, of
# their median.
STILL_FRACTION, STILL_SIGMAS, STILL_M = 0.8, 4.0, 0.01
# Readings farther than this are left out, metres: their noise is larger than what they contribute.
FARTHEST_M = 2.5
# Points nearer to a camera than this are not projected into its image, metres.
NEAREST_M = 0.05
# A normal is computed from points this number of pixels away on both sides: the first number at which they lie on one
# flat surface, on which depth changes by less than this fraction, and the point is near their middle: within BENT_M,
# metres, and noise. Far points give accurate normals, near ones reach to the edges of small sides.
NORMAL_PX, SAME_SURFACE, BENT_M = (6, 3, 2, 1), 0.04, 0.002
# Cloud of a view: one point per cube of this edge, metres.
CLOUD_M = 0.006
# Planes of a view that may be the one that another view shows too; points within this distance lie on it, metres.
PLANES, ON_PLANE_M, SAME_COS = 3, 0.012, 0.95
PLANE_TRIALS, MIN_PLANE_POINTS = 200, 400
# Step between the pixels of points up to the edges, pixels.
SOLID_STEP = 2
# A point that another camera sees through, by this distance or more and noise, is drawn to the nearest surface of this
# camera: so edges meet edges, which planes alone leave free to slide. Standard deviation of an edge, metres: edges are
# a pixel wide and biased, so they decide only what flat sides leave open.
SEEN_THROUGH_M, EDGE_SIGMA_M = 0.015, 0.02
# Map of heights: edge of a cell and largest height, metres; half its side, cells; what an empty cell counts, metres.
CELL_M, HIGHEST_M, HALF_CELLS, EMPTY_M = 0.02, 0.5, 96, -0.03
# Step between the tried turns, radians; candidates of each pair of planes, and those of two views that are aligned.
TURN_RAD, TURNS, CANDIDATES = np.radians(4.0), 5, 6
# Points of a view that are used for maps of heights, paired for candidates, and paired for the result.
MAP_POINTS, FEW_POINTS, MANY_POINTS = 15_000, 3_000, 40_000
# Distances, metres, up to which points are paired, one after the other; iterations at each.
REACHES_M, ITERATIONS = (0.06, 0.03, 0.015, 0.01), 8
# Normals of paired points agree at least by this cosine.
NORMAL_COS = 0.9
# A reading confirms a point within this distance; one that is farther away by more than this contradicts it, metres.
CONFIRMED_M, CONTRADICTED_M = 0.015, 0.04
# Two cameras see the same scene if this number of points is confirmed. A contradicted point counts more than a
# confirmed one, since large planes confirm points in wrong places too: in made rigs .1 % of the points contradict the
# right place, and 10 % the best wrong one.
MIN_CONFIRMED, CONTRADICTION = 300, 20.0
# Points in one cube of this edge have the same systematic error, metres.
PATCH_M = 0.1


@dataclass(frozen=True, slots=True)
class StillView:
    """The still view of a fixed camera: depth without the noise of single frames, and without moving things.

    Attributes
    ----------
    depth_m : (H, W) float32
        0 where there is no reading, or none that is still.
    color : (H, W, 3) uint8
    camera : Intrinsics
    points, normals : (N, 3) float64
        The thinned cloud of flat surfaces in the camera frame; normals face the camera.
    solid : (M, 3) float64
        Points up to the edges of all surfaces.
    """

    depth_m: Float32Array
    color: UInt8Array
    camera: Intrinsics
    points: Float64Array
    normals: Float64Array
    solid: Float64Array


@dataclass(frozen=True, slots=True)
class RigFit:
    """The poses of the cameras.

    Attributes
    ----------
    T_rig_camera : (N, 4, 4) float64
        The first camera is the rig.
    error_m, error_rad : (N,) float64
        Standard errors of position and direction, from two halves of the scene; 0 for the first camera.
    confirmed : (N,) int64
        Number of points of other cameras that each camera confirms.
    """

    T_rig_camera: Float64Array
    error_m: Float64Array
    error_rad: Float64Array
    confirmed: npt.NDArray[np.int64]


def still_view(frames: Iterable[Frame], camera: Intrinsics) -> StillView:
    """Return the still view of a fixed camera from some of its frames.

    Raises
    ------
    InputError
        There is no frame, or nothing in them stands still.
    """
    taken = list(frames)
    if not taken:
        raise InputError("no frame can be used")
    depths = np.stack([frame.depth_m for frame in taken])
    depths[depths == 0] = np.nan
    known = np.count_nonzero(np.isfinite(depths), axis=0)
    median = np.zeros(depths.shape[1:], np.float32)
    enough = known > len(taken) // 2
    median[enough] = np.nanmedian(depths[:, enough], axis=0)
    limit_m = STILL_M + STILL_SIGMAS * DEPTH_NOISE_PER_M * median**2
    still = np.abs(depths - median) <= limit_m
    near = np.count_nonzero(still, axis=0)
    # Sensors round depth to steps: the mean of noisy readings lies between two steps.
    mean = np.where(still, depths, 0).sum(0) / np.maximum(near, 1)
    kept = (median > 0) & (near >= STILL_FRACTION * known) & (median <= FARTHEST_M)
    median = np.where(kept, mean, 0).astype(np.float32)
    points, normals = _cloud(median, camera)
    if len(points) < MIN_CONFIRMED:
        raise InputError("too little in view stands still")
    solid_m = without_mixed(median)[::SOLID_STEP, ::SOLID_STEP]
    rows, columns = np.nonzero(solid_m)
    solid = camera.points(columns * SOLID_STEP, rows * SOLID_STEP, solid_m[rows, columns])
    return StillView(median, taken[len(taken) // 2].color, camera, points, normals, solid)


def _cloud(depth_m: Float32Array, camera: Intrinsics) -> tuple[Float64Array, Float64Array]:
    """Return thinned points (N, 3) of the flat surfaces in a depth image with their normals."""
    rows, columns = np.indices(depth_m.shape)
    points = camera.points(columns, rows, depth_m)
    normals = np.zeros_like(points)
    for apart in NORMAL_PX:
        inner = slice(apart, -apart)
        found = _normals(points, apart)
        missing = ~normals[inner, inner].any(-1)
        normals[inner, inner][missing] = found[missing]
    flat = normals.any(-1)
    inside, facing = points[flat], normals[flat]
    _, chosen = np.unique(np.floor(inside / CLOUD_M).astype(np.int64), axis=0, return_index=True)
    return inside[chosen], facing[chosen]


def _normals(points: Float64Array, apart: int) -> Float64Array:
    """Return the normals (H - 2n, W - 2n, 3) of the inner points, from points n pixels away; 0 where it is not flat."""
    k, z = apart, points[..., 2]
    middle_m = z[k:-k, k:-k]
    right, left = points[k:-k, 2 * k :], points[k:-k, : -2 * k]
    down, up = points[2 * k :, k:-k], points[: -2 * k, k:-k]
    flat = middle_m > 0
    for first, second in ((right[..., 2], left[..., 2]), (down[..., 2], up[..., 2])):
        flat &= (first > 0) & (second > 0) & (np.abs(first - second) < 2 * SAME_SURFACE * middle_m)
        bent_m = np.abs(first + second - 2 * middle_m) / 2
        flat &= bent_m < BENT_M + STILL_SIGMAS / 2 * DEPTH_NOISE_PER_M * middle_m**2
    normals = np.cross(down - up, right - left)
    normals /= np.maximum(np.linalg.norm(normals, axis=-1), 1e-12)[..., None]
    away = (normals * points[k:-k, k:-k]).sum(-1) > 0
    normals[away] *= -1
    normals[~flat] = 0
    return normals


def fit_rig(views: Sequence[StillView], names: Sequence[str]) -> RigFit:
    """Find the poses of fixed cameras that look at one scene.

    Parameters
    ----------
    views : sequence of StillView
    names : sequence of str
        Names of the cameras, for messages.

    Raises
    ------
    InputError
        A camera sees nothing that another one sees as well.
    """
    T_rig_camera: dict[int, Float64Array] = {0: np.eye(4)}
    while len(T_rig_camera) < len(views):
        found = [
            (score, a, b, T)
            for a in T_rig_camera
            for b in range(len(views))
            if b not in T_rig_camera
            for score, T in (_place(views[a], views[b]),)
            if T is not None
        ]
        if not found:
            missing = ", ".join(names[k] for k in range(len(views)) if k not in T_rig_camera)
            raise InputError(
                f"camera {missing}: no other camera sees the same surfaces; "
                "put some objects of different heights where two cameras see them"
            )
        _, a, b, T = max(found, key=lambda one: one[0])
        T_rig_camera[b] = T_rig_camera[a] @ T
    start = np.array([T_rig_camera[k] for k in range(len(views))])
    poses = align(views, start, REACHES_M, MANY_POINTS)
    halves = [align(views, poses, REACHES_M[-2:], MANY_POINTS, half) for half in (0, 1)]
    apart = [inverse(one) @ other for one, other in zip(*halves, strict=True)]
    return RigFit(
        poses,
        np.array([np.linalg.norm(T[:3, 3]) / 2 for T in apart]),
        np.array([angle(T) / 2 for T in apart]),
        np.array([_confirmations(views, poses, k) for k in range(len(views))]),
    )


def _place(one: StillView, other: StillView) -> tuple[float, Float64Array | None]:
    """Return T_one_other (4, 4) with its score; None if the views do not show the same."""
    best: tuple[float, Float64Array | None] = (0.0, None)
    for start in _candidates(one, other):
        T = align([one, other], np.array([np.eye(4), start]), REACHES_M[:2], FEW_POINTS)[1]
        score = _score(one, other, T)
        if score > max(best[0], MIN_CONFIRMED):
            best = score, T
    return best


def _score(one: StillView, other: StillView, T_one_other: Float64Array) -> float:
    """Return how well two views agree: points that are confirmed, less those that are contradicted."""
    confirmed, contradicted = np.add(agreement(one, other, T_one_other), agreement(other, one, inverse(T_one_other)))
    return float(confirmed - CONTRADICTION * contradicted)


def _candidates(one: StillView, other: StillView) -> list[Float64Array]:
    """Return the likeliest T_one_other (4, 4), from the planes of both views."""
    planes_one, planes_other = _planes(one), _planes(other)
    found = [
        inverse(T_plane_one) @ T_plane_turned @ T_plane_other
        for T_plane_one in planes_one
        for T_plane_other in planes_other
        for T_plane_turned in _turns(one, other, T_plane_one, T_plane_other)
    ]
    return sorted(found, key=lambda T: -_score(one, other, T))[:CANDIDATES]


def _planes(view: StillView) -> list[Float64Array]:
    """Return T_plane_camera (4, 4) of the widest planes of a view: z is the normal towards the camera."""
    rng, left, found = np.random.default_rng(0), np.ones(len(view.points), bool), []
    for _ in range(PLANES):
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
    near = np.abs((view.points - center) @ normal) < ON_PLANE_M
    return np.asarray(near & (view.normals @ normal > SAME_COS))


def _frame_of(normal: Float64Array, center: Float64Array) -> Float64Array:
    """Return T_plane_camera (4, 4) of a plane: its origin is at the center."""
    across = np.cross(normal, (0.0, 1.0, 0.0) if abs(normal[1]) < 0.9 else (1.0, 0.0, 0.0))
    across /= np.linalg.norm(across)
    T = np.eye(4)
    T[:3, :3] = np.stack([across, np.cross(normal, across), normal])
    T[:3, 3] = -T[:3, :3] @ center
    return T


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
        T[:2, 3] = np.array(shift) * CELL_M
        found.append((float(scores[row, column]), T))
    found.sort(key=lambda item: -item[0])
    return [T for _, T in found[:TURNS]]


def _heights(points: Float64Array) -> Float64Array:
    """Return the map of heights above a plane: positive on objects, negative where the plane is empty, else 0."""
    cells = np.floor(points[:, :2] / CELL_M).astype(np.int64) + HALF_CELLS
    inside = ((cells >= 0) & (cells < 2 * HALF_CELLS)).all(1) & (points[:, 2] < HIGHEST_M)
    (x, y), z = cells[inside].T, points[inside, 2]
    heights = np.zeros((2 * HALF_CELLS, 2 * HALF_CELLS))
    flat, high = np.abs(z) < ON_PLANE_M, z >= ON_PLANE_M
    heights[y[flat], x[flat]] = EMPTY_M
    np.maximum.at(heights, (y[high], x[high]), z[high])
    return heights


def align(
    views: Sequence[StillView],
    T_rig_camera: Float64Array,
    reaches_m: Sequence[float],
    count: int,
    half: int | None = None,
) -> Float64Array:
    """Return the poses (N, 4, 4) for which all views agree best; the first one stays.

    Parameters
    ----------
    views : sequence of StillView
    T_rig_camera : (N, 4, 4) float64
        The start.
    reaches_m : sequence of float
        Distances up to which points are paired.
    count : int
        Number of points of each view that are paired with points of the others.
    half : int, optional
        Use only every other patch of the scene, from patch 0 or 1 on.
    """
    poses = T_rig_camera.copy()
    trees = [(cKDTree(view.points), cKDTree(view.solid)) for view in views]
    for reach_m in reaches_m:
        for _ in range(ITERATIONS):
            A, g = np.zeros((6 * len(views), 6 * len(views))), np.zeros(6 * len(views))
            for a, b in permutations(range(len(views)), 2):
                _add_pairs(views, trees, poses, (a, b), reach_m, count, half, A, g)
            step = np.linalg.lstsq(A[6:, 6:], -g[6:], rcond=1e-9)[0].reshape(-1, 6)
            poses[1:] = [tidied(exp(motion) @ T) for motion, T in zip(step, poses[1:], strict=True)]
    return poses


def _add_pairs(
    views: Sequence[StillView],
    trees: Sequence[tuple[cKDTree, cKDTree]],
    poses: Float64Array,
    pair: tuple[int, int],
    reach_m: float,
    count: int,
    half: int | None,
    A: Float64Array,
    g: Float64Array,
) -> None:
    """Add the distances of the points of view b from the surfaces of view a to the normal equations."""
    a, b = pair
    T_a_b = inverse(poses[a]) @ poses[b]
    every = slice(None, None, 1 + len(views[b].points) // count)
    of_b, normals_b = views[b].points[every], views[b].normals[every]
    points = transform(T_a_b, of_b)
    away_m, nearest = trees[a][0].query(points, distance_upper_bound=reach_m)
    index = np.asarray(nearest, np.int64)
    paired = np.flatnonzero(np.isfinite(away_m))
    normals = views[a].normals[index[paired]]
    paired_normals = normals_b[paired] @ T_a_b[:3, :3].T
    agree = (normals * paired_normals).sum(1) > NORMAL_COS
    agree &= _in_half(transform(poses[b], of_b[paired]), half)
    paired, normals = paired[agree], normals[agree]
    if not len(paired):
        return
    at, to = points[paired], views[a].points[index[paired]]
    sigma_m = DEPTH_NOISE_PER_M * (at[:, 2] ** 2 + of_b[paired, 2] ** 2)
    distance = ((at - to) * normals).sum(1)
    weight = 1.0 / (sigma_m**2 * (1.0 + (distance / reach_m * 3.0) ** 2) ** 2)
    in_rig, n = transform(poses[b], of_b[paired]), normals @ poses[a][:3, :3].T
    seen_through = _seen_through(views, trees, poses, pair, reach_m, count, half)
    in_rig, n, distance, weight = (
        np.concatenate(both) for both in zip((in_rig, n, distance, weight), seen_through, strict=True)
    )
    J = np.concatenate([n, np.cross(in_rig, n)], axis=1)
    H, r = (J * weight[:, None]).T @ J, (J * weight[:, None]).T @ distance
    i, j = slice(6 * a, 6 * a + 6), slice(6 * b, 6 * b + 6)
    A[j, j] += H
    A[i, i] += H
    A[i, j] -= H
    A[j, i] -= H
    g[j] += r
    g[i] -= r


def _seen_through(
    views: Sequence[StillView],
    trees: Sequence[tuple[cKDTree, cKDTree]],
    poses: Float64Array,
    pair: tuple[int, int],
    reach_m: float,
    count: int,
    half: int | None,
) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
    """Return the points of view b that view a sees through and that have a surface of a near.

    In the rig, each with a unit vector towards that surface, the distance along it, and its weight.
    """
    a, b = pair
    T_a_b = inverse(poses[a]) @ poses[b]
    thinned = views[b].solid[:: 1 + len(views[b].solid) // (2 * count)]
    points, seen_m = _in_view(views[a], transform(T_a_b, thinned))
    limit_m = SEEN_THROUGH_M + STILL_SIGMAS * DEPTH_NOISE_PER_M * seen_m**2
    points = points[seen_m > points[:, 2] + limit_m]
    distance_m, nearest = trees[a][1].query(points, distance_upper_bound=reach_m)
    away_m, index = np.asarray(distance_m, np.float64), np.asarray(nearest, np.int64)
    near = np.isfinite(away_m) & (away_m > 0)
    points, away_m, index = points[near], away_m[near], index[near]
    direction = (points - views[a].solid[index]) / away_m[:, None]
    in_rig = transform(poses[a], points)
    used = _in_half(in_rig, half)
    weight = np.full(int(used.sum()), EDGE_SIGMA_M**-2)
    return in_rig[used], direction[used] @ poses[a][:3, :3].T, away_m[used], weight


def _in_view(view: StillView, points: Float64Array) -> tuple[Float64Array, Float32Array]:
    """Return the points (N, 3), in the camera frame of a view, that lie in its image, and the depth (N,) there."""
    camera, points = view.camera, points[points[:, 2] > NEAREST_M]
    u, v = np.rint(camera.pixels(points)).astype(np.int64).T
    inside = (u >= 0) & (v >= 0) & (u < camera.width) & (v < camera.height)
    return points[inside], view.depth_m[v[inside], u[inside]]


def _in_half(in_rig: Float64Array, half: int | None) -> npt.NDArray[np.bool_]:
    """Return which points (N, 3) lie in a half of the scene; all without one."""
    if half is None:
        return np.ones(len(in_rig), bool)
    patch = np.floor(in_rig / PATCH_M).astype(np.int64).sum(1)
    return np.asarray(patch % 2 == half)


def agreement(one: StillView, other: StillView, T_one_other: Float64Array) -> tuple[int, int]:
    """Return how many points of another view a view confirms, and how many it contradicts."""
    points, seen_m = _in_view(one, transform(T_one_other, other.points))
    z = points[:, 2]
    confirmed = (seen_m > 0) & (np.abs(seen_m - z) < CONFIRMED_M)
    contradicted = (seen_m > 0) & (seen_m > z + CONTRADICTED_M)
    return int(confirmed.sum()), int(contradicted.sum())


def _confirmations(views: Sequence[StillView], poses: Float64Array, k: int) -> int:
    return sum(agreement(views[k], views[j], inverse(poses[k]) @ poses[j])[0] for j in range(len(views)) if j != k)
