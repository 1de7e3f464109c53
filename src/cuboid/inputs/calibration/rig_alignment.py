"""Alignment of the still views of several cameras: point-to-plane (Chen and Medioni 1992), all views together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.tolerances import DEPTH_NOISE_PER_M
from cuboid.ground.geometry.se3 import exp, inverse, tidied, transform
from cuboid.inputs.calibration.still_view import STILL_SIGMAS, StillView

# Points nearer to a camera than this are not projected into its image, metres.
NEAREST_PROJECTED_M = 0.05
# A point that another camera sees through, by this distance or more and noise, is drawn to the nearest surface of this
# camera: so edges meet edges, which planes alone leave free to slide. Standard deviation of an edge, metres: edges are
# a pixel wide and biased, so they decide only what flat sides leave open.
SEEN_THROUGH_M, EDGE_SIGMA_M = 0.015, 0.02
# Distances, metres, up to which points are paired, one after the other; iterations at each.
REACHES_M, ITERATIONS_PER_REACH = (0.06, 0.03, 0.015, 0.01), 8
# Normals of paired points agree at least by this cosine.
NORMAL_COS = 0.9
# Points of a view that are paired where speed counts more than the last tenth of a millimetre.
FEW_POINTS = 3_000
# Points in one cube of this edge have the same systematic error, metres.
ERROR_PATCH_M = 0.1


# Points with the unit vectors (N, 3) along which their distances (N,) are measured, and the weights (N,): in the rig.
Distances = tuple[Float64Array, Float64Array, Float64Array, Float64Array]


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
    trees = tuple((cKDTree(view.points), cKDTree(view.solid)) for view in views)
    for reach_m in reaches_m:
        for _ in range(ITERATIONS_PER_REACH):
            step = _Pairing(views, trees, poses, reach_m, count, half).step()
            poses[1:] = [tidied(exp(motion) @ T) for motion, T in zip(step, poses[1:], strict=True)]
    return poses


@dataclass(frozen=True, slots=True)
class _Pairing:
    """The views at their present poses, and which of their points are paired.

    Attributes
    ----------
    views : sequence of StillView
    trees : sequence of (cKDTree, cKDTree)
        Of the points of each view, and of its points up to the edges.
    poses : (N, 4, 4) float64
        T_rig_camera.
    reach_m, count, half
        As in `align`.
    """

    views: Sequence[StillView]
    trees: Sequence[tuple[cKDTree, cKDTree]]
    poses: Float64Array
    reach_m: float
    count: int
    half: int | None

    def step(self) -> Float64Array:
        """Return the motions (N - 1, 6) of the cameras after the first one that reduce the distances most."""
        size = 6 * len(self.views)
        A, g = np.zeros((size, size)), np.zeros(size)
        for a, b in permutations(range(len(self.views)), 2):
            in_rig, n, distance, weight = map(
                np.concatenate, zip(self.from_surfaces(a, b), self.seen_through(a, b), strict=True)
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
        return np.asarray(np.linalg.lstsq(A[6:, 6:], -g[6:], rcond=1e-9)[0].reshape(-1, 6))

    def from_surfaces(self, a: int, b: int) -> Distances:
        """Return the distances of the points of view b from the surfaces of view a; none if no point is near."""
        T_a_b, of_a, of_b = inverse(self.poses[a]) @ self.poses[b], self.views[a], self.views[b]
        every = slice(None, None, 1 + len(of_b.points) // self.count)
        thinned = of_b.points[every]
        points = transform(T_a_b, thinned)
        away_m, nearest = self.trees[a][0].query(points, distance_upper_bound=self.reach_m)
        index = np.asarray(nearest, np.int64)
        paired = np.flatnonzero(np.isfinite(away_m))
        normals = of_a.normals[index[paired]]
        agree = (normals * (of_b.normals[every][paired] @ T_a_b[:3, :3].T)).sum(1) > NORMAL_COS
        agree &= _in_half(transform(self.poses[b], thinned[paired]), self.half)
        paired, normals = paired[agree], normals[agree]
        at, to = points[paired], of_a.points[index[paired]]
        sigma_m = DEPTH_NOISE_PER_M * (at[:, 2] ** 2 + thinned[paired, 2] ** 2)
        distance = ((at - to) * normals).sum(1)
        weight = 1.0 / (sigma_m**2 * (1.0 + (distance / self.reach_m * 3.0) ** 2) ** 2)
        return transform(self.poses[b], thinned[paired]), normals @ self.poses[a][:3, :3].T, distance, weight

    def seen_through(self, a: int, b: int) -> Distances:
        """Return the distances of the points of view b that view a sees through from the nearest surface of view a."""
        T_a_b = inverse(self.poses[a]) @ self.poses[b]
        thinned = self.views[b].solid[:: 1 + len(self.views[b].solid) // (2 * self.count)]
        points, seen_m = in_view(self.views[a], transform(T_a_b, thinned))
        limit_m = SEEN_THROUGH_M + STILL_SIGMAS * DEPTH_NOISE_PER_M * seen_m**2
        points = points[seen_m > points[:, 2] + limit_m]
        distance_m, nearest = self.trees[a][1].query(points, distance_upper_bound=self.reach_m)
        away_m, index = np.asarray(distance_m, np.float64), np.asarray(nearest, np.int64)
        near = np.isfinite(away_m) & (away_m > 0)
        points, away_m, index = points[near], away_m[near], index[near]
        direction = (points - self.views[a].solid[index]) / away_m[:, None]
        in_rig = transform(self.poses[a], points)
        used = _in_half(in_rig, self.half)
        weight = np.full(int(used.sum()), EDGE_SIGMA_M**-2)
        return in_rig[used], direction[used] @ self.poses[a][:3, :3].T, away_m[used], weight


def in_view(view: StillView, points: Float64Array) -> tuple[Float64Array, Float32Array]:
    """Return the points (N, 3), in the camera frame of a view, that lie in its image, and the depth (N,) there."""
    camera, points = view.camera, points[points[:, 2] > NEAREST_PROJECTED_M]
    u, v = np.rint(camera.pixels(points)).astype(np.int64).T
    inside = (u >= 0) & (v >= 0) & (u < camera.width) & (v < camera.height)
    return points[inside], view.depth_m[v[inside], u[inside]]


def _in_half(in_rig: Float64Array, half: int | None) -> npt.NDArray[np.bool_]:
    """Return which points (N, 3) lie in a half of the scene; all without one."""
    if half is None:
        return np.ones(len(in_rig), bool)
    patch = np.floor(in_rig / ERROR_PATCH_M).astype(np.int64).sum(1)
    return np.asarray(patch % 2 == half)
