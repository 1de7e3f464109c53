"""The rows of each object, found by blocks, against a search through all rows."""

from __future__ import annotations

import numpy as np

from cuboid.frame import Intrinsics
from cuboid.heatmap.row_blocks import BLOCK_ROWS
from cuboid.heatmap.voxel_map import VoxelMap
from cuboid.working import WorkingImage

CAMERA = Intrinsics(60.0, 60.0, 31.5, 23.5, 64, 48)


def wall(voxels: VoxelMap, x: float, frame: int) -> np.ndarray:
    T = np.eye(4)
    T[0, 3] = x
    image = WorkingImage(np.full((48, 64), 1.0, np.float32), np.zeros((48, 64, 3), np.uint8), CAMERA, 1, (0, 0))
    return voxels.fuse(image, np.ones((48, 64), np.float32), T, frame)


def give(voxels: VoxelMap, rows: np.ndarray, number: int) -> None:
    """Let rows that no one has, or that have one vote, belong to an object."""
    slots = np.asarray(rows, np.int32)[None]
    claim, all_of = np.zeros(slots.shape, np.int32), np.zeros(64, np.int64)
    voxels.vote(
        claim, np.array([number], np.int32), all_of, np.ones((1, 1), np.uint8), np.ones(slots.shape, np.uint8), slots
    )


def test_the_rows_of_an_object_are_found_whatever_becomes_of_them() -> None:
    rng = np.random.default_rng(0)
    voxels = VoxelMap(0.01, 1e-3, 3.0)
    for frame in range(12):
        wall(voxels, 2.0 * frame, frame)
    assert voxels.count > 20 * BLOCK_ROWS
    for step in range(60):
        first = int(rng.integers(0, voxels.count - 900))
        give(voxels, np.arange(first, first + 900), int(rng.integers(1, 6)))
        if step % 7 == 0:
            voxels.pass_on(3, 2)
        if step % 11 == 0:
            voxels.release([5])
    for number in range(1, 6):
        assert voxels.rows_of(number).tolist() == np.flatnonzero(voxels.owner == number).tolist()
    assert len(voxels.rows_of(1)) > 0
    assert len(voxels.rows_of(3)) + len(voxels.rows_of(5)) < voxels.count


def test_the_rows_of_an_object_are_found_after_the_map_was_packed() -> None:
    voxels = VoxelMap(0.01, 1e-3, 3.0)
    wall(voxels, 0.0, 0)
    count = voxels.count
    give(voxels, np.arange(100, 300), 4)
    place = voxels.xyz(np.arange(150, 300))
    voxels.values[:150, 7] = 0.0  # these are gone, 50 of the object's among them
    capacity = len(voxels.keys)
    for frame in range(1, 60):
        wall(voxels, 2.0 * frame, frame)
    assert len(voxels.keys) > capacity
    assert voxels.alive == voxels.count == 60 * count - 150
    np.testing.assert_array_equal(voxels.xyz(voxels.rows_of(4)), place)


def test_what_an_object_has_is_no_ones_after_it_was_released() -> None:
    voxels = VoxelMap(0.01, 1e-3, 3.0)
    wall(voxels, 0.0, 0)
    for _ in range(5):
        give(voxels, np.arange(100, 300), 4)
    voxels.release([4])
    assert len(voxels.rows_of(4)) == 0
    give(voxels, np.arange(100, 300), 7)
    assert voxels.rows_of(7).tolist() == list(range(100, 300)), "votes of who is no more count for nothing"
