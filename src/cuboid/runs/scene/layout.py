"""Place recognition by the layout of objects, for other light or another viewpoint.

Most objects stand where they stood before. Two objects that are similar to two objects of the scene, at the same
distance from each other, give a hypothesis for the motion of a part of the scene, because both maps are level. A
hypothesis is accepted if many other objects then coincide with similar ones of the scene, if no other hypothesis is
nearly as good, and if the points of both maps coincide.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.geometry.se3 import inverse, level_rotation, transform
from cuboid.method.objects.entry import MapObject
from cuboid.method.objects.similarity import MIN_SIMILARITY, color_profile_of, similarity

# Number of objects of the part that are used, those seen most often; number of objects of the scene with which each is
# compared.
MAX_SEEN, CANDIDATES = 16, 20
# Tolerances, metres: APART_M for the distance within two pairs, MEET_M for objects that coincide. Two objects nearer to
# each other than MIN_APART_M give no reliable direction.
APART_M, MEET_M, MIN_APART_M = 0.03, 0.04, 0.1
# Minimum number of objects that coincide: in rooms full of objects, three or four coincide by chance.
MIN_MET = 5
# The best hypothesis must score CLEARER times as high as any hypothesis that differs from it by more than OTHER_M
# metres or OTHER_RAD radians.
OTHER_M, OTHER_RAD, CLEARER = 0.1, 0.2, 1.5
# At least SAME_FRACTION of the part's points within AROUND_M metres of a place must have a point of the scene within
# MATCHED_POINT_M metres.
AROUND_M, MATCHED_POINT_M, SAME_FRACTION = 1.0, 0.03, 0.5
# Maximum number of hypotheses, those of the most similar pairs.
MAX_HYPOTHESES = 500

Numbers = npt.NDArray[np.int64]


def find_layout(scene_objects: Sequence[MapObject], seen: Sequence[MapObject], up: Float64Array) -> Float64Array | None:
    """Return the motion T_scene_seen (4, 4) about up that aligns objects with the scene's; None if ambiguous."""
    seen = sorted(seen, key=lambda o: (-o.frames_seen, o.label))[:MAX_SEEN]
    if len(scene_objects) < MIN_MET or len(seen) < MIN_MET:
        return None
    level = np.eye(4)
    level[:3, :3] = level_rotation(up)
    profiles = [color_profile_of(o) for o in scene_objects]
    similarities = np.array(
        [
            [similarity(a, o.box, color_profile_of(s), s.box) for a, o in zip(profiles, scene_objects, strict=True)]
            for s in seen
        ]
    )
    k, s = (np.array([o.box.center for o in objects]) @ level[:3, :3].T for objects in (scene_objects, seen))
    motions = _hypotheses(similarities, k, s)
    if not len(motions):
        return None
    scores = _scores(motions, similarities, k, s)
    best = int(np.argmax(scores))
    middles = _moved(motions, s.mean(0)[None])[:, 0]
    turn = np.abs((motions[:, 0] - motions[best, 0] + np.pi) % (2 * np.pi) - np.pi)
    others = (np.linalg.norm(middles - middles[best], axis=1) > OTHER_M) | (turn > OTHER_RAD)
    matched, partners = _met(motions[best], similarities, k, s)
    if len(np.unique(partners)) < MIN_MET or scores[best] < CLEARER * scores[others].max(initial=0.0):
        return None
    return np.asarray(inverse(level) @ _fitted(k[partners], s[matched]) @ level)


def same_place(
    scene_points: Float32Array, seen: Float32Array, T_scene_seen: Float64Array, center: Float64Array
) -> bool:
    """Return whether points of a part (N, 3) around a center in it coincide with points of the scene (M, 3)."""
    from scipy.spatial import cKDTree

    near = seen[np.linalg.norm(seen - center, axis=1) < AROUND_M].astype(np.float64)
    moved = transform(T_scene_seen, near)
    scene_points = scene_points[np.linalg.norm(scene_points - transform(T_scene_seen, center), axis=1) < 1.5 * AROUND_M]
    if not len(near) or not len(scene_points):
        return False
    distance, _ = cKDTree(scene_points).query(moved, distance_upper_bound=MATCHED_POINT_M)
    return bool(np.isfinite(distance).mean() >= SAME_FRACTION)


def _hypotheses(similarities: Float64Array, scene_centers: Float64Array, seen: Float64Array) -> Float64Array:
    """Return motions (A, 4), yaw and translation in the level frame, from two pairs of similar objects."""
    best = np.argsort(-similarities, axis=1, kind="stable")[:, :CANDIDATES]
    i = np.repeat(np.arange(len(seen)), best.shape[1])
    j = best.reshape(-1)
    alike_enough = similarities[i, j] >= MIN_SIMILARITY
    i, j = i[alike_enough], j[alike_enough]
    a, b = np.triu_indices(len(i), 1)
    scene_step, seen_step = scene_centers[j[b]] - scene_centers[j[a]], seen[i[b]] - seen[i[a]]
    fits = (i[a] != i[b]) & (j[a] != j[b]) & (np.linalg.norm(seen_step[:, :2], axis=1) >= MIN_APART_M)
    fits &= np.abs(np.linalg.norm(scene_step[:, :2], axis=1) - np.linalg.norm(seen_step[:, :2], axis=1)) < APART_M
    fits &= np.abs(scene_step[:, 2] - seen_step[:, 2]) < APART_M
    fits[fits] = _most(similarities[i[a[fits]], j[a[fits]]] * similarities[i[b[fits]], j[b[fits]]])
    a, b, scene_step, seen_step = a[fits], b[fits], scene_step[fits], seen_step[fits]
    yaw = np.arctan2(scene_step[:, 1], scene_step[:, 0]) - np.arctan2(seen_step[:, 1], seen_step[:, 0])
    turned = _moved(np.column_stack([yaw, np.zeros((len(yaw), 3))]), seen)
    rows = np.arange(len(yaw))
    shift = 0.5 * (scene_centers[j[a]] + scene_centers[j[b]] - turned[rows, i[a]] - turned[rows, i[b]])
    return np.column_stack([yaw, shift])


def _most(values: Float64Array) -> npt.NDArray[np.bool_]:
    chosen = np.zeros(len(values), bool)
    chosen[np.argsort(-values, kind="stable")[:MAX_HYPOTHESES]] = True
    return chosen


def _moved(motions: Float64Array, points: Float64Array) -> Float64Array:
    """Return points (N, 3) after each motion, (A, N, 3)."""
    c, s = np.cos(motions[:, :1]), np.sin(motions[:, :1])
    x, y, z = points.T
    return np.stack([c * x - s * y + motions[:, 1:2], s * x + c * y + motions[:, 2:3], z + motions[:, 3:4]], -1)


def _scores(
    motions: Float64Array, similarities: Float64Array, scene_centers: Float64Array, seen: Float64Array
) -> Float64Array:
    """Return the score of each motion (A,): the summed similarity of objects that coincide."""
    distance, nearest = _nearest(scene_centers, _moved(motions, seen))
    meets = np.isfinite(distance)
    found = np.where(meets, similarities[np.arange(len(seen)), np.where(meets, nearest, 0)], 0.0)
    return np.asarray(np.where(found < MIN_SIMILARITY, 0.0, found).sum(1))


def _met(
    motion: Float64Array, similarities: Float64Array, scene_centers: Float64Array, seen: Float64Array
) -> tuple[Numbers, Numbers]:
    """Return indices of objects that coincide with similar ones of the scene under a motion, and of these."""
    distance, nearest = _nearest(scene_centers, _moved(motion[None], seen)[0])
    met = np.flatnonzero(np.isfinite(distance))
    met = met[similarities[met, nearest[met]] >= MIN_SIMILARITY]
    return met, nearest[met]


def _nearest(scene_centers: Float64Array, points: Float64Array) -> tuple[Float64Array, Numbers]:
    """Return distance (infinite if beyond MEET_M) and index of the scene's centre nearest to points (..., 3)."""
    from scipy.spatial import cKDTree

    distance, nearest = cKDTree(scene_centers).query(points, distance_upper_bound=MEET_M)
    return np.asarray(distance, np.float64), np.asarray(nearest, np.int64)


def _fitted(scene_centers: Float64Array, seen: Float64Array) -> Float64Array:
    """Return the motion (4, 4) about the third axis that best aligns points (N, 3) with the scene's."""
    x, y = scene_centers - scene_centers.mean(0), seen - seen.mean(0)
    yaw = np.arctan2((y[:, 0] * x[:, 1] - y[:, 1] * x[:, 0]).sum(), (x[:, :2] * y[:, :2]).sum())
    T = np.eye(4)
    T[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    T[:3, 3] = scene_centers.mean(0) - T[:3, :3] @ seen.mean(0)
    return T
