from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from cuboid.geometry import se3
from cuboid.heatmap.carrying import average, moved_with, oldest
from cuboid.heatmap.voxel_map import VoxelMap
from cuboid.working import WorkingImage
from made_scenes import CAMERA, cast, look_at, upright

SCENE = [upright((0, 0), (2, 2, 0.02), z=-0.02), upright((0.1, 0.1), (0.2, 0.3, 0.2), 0.3)]
POSE = look_at((0.9, -0.8, 0.9), (0.1, 0.1, 0.0))


def image() -> WorkingImage:
    depth, hit = cast(SCENE, POSE)
    color = np.repeat(((hit + 2) * 60)[..., None], 3, 2).astype(np.uint8)
    return WorkingImage(depth.astype(np.float32), color, CAMERA, 1, (0, 0))


def fused(shifts_m: list[float]) -> VoxelMap:
    """The same view from keyframes 1, 2, .. whose poses are wrong by so much along x."""
    voxels = VoxelMap(0.01, 1.4e-3, 3.0)
    for k, shift in enumerate(shifts_m):
        T = se3.exp([shift, 0, 0, 0, 0, 0]) @ POSE
        voxels.fuse(image(), np.ones((240, 320), np.float32), T, k, anchor=k + 1)
    return voxels


def test_points_move_with_their_own_keyframe() -> None:
    points = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], np.float32)
    moved = moved_with(points, np.array([3, 0], np.int32), {3: se3.compose((1, 0, 0, 0), (0.5, 0, 0))})
    np.testing.assert_allclose(moved, [[1.5, 2, 3], [4, 5, 6]])


def test_the_oldest_object_keeps_what_meets() -> None:
    owner = np.array([0, 7, 3, 4, 0, 0, 0], np.int32)
    np.testing.assert_array_equal(oldest(owner, np.array([0, 3, 5])), [3, 4, 0])


def test_what_meets_is_averaged_by_weight() -> None:
    values = np.array([[1.0, 0, 0, 10, 20, 30, 1.0, 1.0], [5.0, 0, 0, 40, 50, 60, 0.0, 3.0]])
    mean = average(values, np.array([0]))
    np.testing.assert_allclose(mean, [[4.0, 0, 0, 32.5, 42.5, 52.5, 0.25, 4.0]])


def test_a_map_that_was_doubled_by_drift_is_single_again() -> None:
    single, double = fused([0.0]), fused([0.0, 0.05])
    before = double.count
    assert before > 1.2 * single.count
    rows = double.living()
    second = (double.anchor[rows] == 2) & (double.hits[rows] == 1)  # the others are averages of both
    double.owner[rows[second]] = 2
    double.owner[rows[~second]] = 1
    younger = int(np.count_nonzero(second))
    double.carry({2: se3.exp([-0.05, 0, 0, 0, 0, 0])})
    assert double.count < 1.06 * single.count  # what both views had averaged lies between
    # much of the second view fell onto the first, whose object is the older one
    assert np.count_nonzero(double.owner[double.living()] == 2) < 0.6 * younger
    there = double.holds(single.xyz(single.living()).astype(np.float64))
    assert there.mean() > 0.97


def test_the_moved_map_goes_on_as_one_that_was_never_wrong() -> None:
    voxels = fused([0.3])
    voxels.carry({1: se3.exp([-0.3, 0, 0, 0, 0, 0])})
    assert (voxels.rows_at(voxels.xyz(voxels.living()).astype(np.float64)) >= 0).mean() > 0.999
    count = voxels.count
    voxels.fuse(image(), np.ones((240, 320), np.float32), POSE, 1, anchor=1)
    assert voxels.count < 1.1 * count


def test_what_hangs_on_no_moved_keyframe_stays() -> None:
    voxels = fused([0.0])
    before = voxels.xyz(voxels.living())
    voxels.carry({5: se3.exp([1.0, 0, 0, 0, 0, 0])})
    after = voxels.xyz(voxels.living())
    # a mean that lies on its voxel's border may round into the next one
    assert len(before) * 0.999 < len(after) <= len(before)
    away = cKDTree(after).query(before)[0]
    assert np.quantile(away, 0.999) < 1e-6
    empty = VoxelMap(0.01, 1.4e-3, 3.0)
    empty.carry({1: np.eye(4)})
    assert empty.count == 0


def test_each_object_has_its_own_living_rows() -> None:
    voxels = fused([0.0])
    assert voxels.owned() == {}
    rows = voxels.living()
    slots = rows.astype(np.int32)[None]
    claim = (np.arange(len(rows), dtype=np.int32) % 3)[None]
    free = np.ones((3, 1), np.uint8)
    voxels.vote(claim, np.array([0, 1, 2], np.int32), np.zeros(9, np.int64), free, np.ones_like(claim, np.uint8), slots)
    owned = voxels.owned()
    assert list(owned) == [1, 2]
    for number, own in owned.items():
        np.testing.assert_array_equal(own, rows[number::3])
