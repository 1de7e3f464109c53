"""The rows of each object, found by blocks, against a search through all rows."""

from __future__ import annotations

import numpy as np

from cuboid.frame import Intrinsics
from cuboid.heatmap.row_blocks import BLOCK_ROWS, RowBlocks
from cuboid.heatmap.voxel_map import VoxelMap
from cuboid.working import WorkingImage

CAMERA = Intrinsics(60.0, 60.0, 31.5, 23.5, 64, 48)


def wall(voxels: VoxelMap, x: float, frame: int) -> np.ndarray:
    T = np.eye(4)
    T[0, 3] = x
    image = WorkingImage(np.full((48, 64), 1.0, np.float32), np.zeros((48, 64, 3), np.uint8), CAMERA, 1, (0, 0))
    return voxels.fuse(image, np.ones((48, 64), np.float32), T, frame)


def test_the_rows_of_an_object_are_found_whatever_becomes_of_them() -> None:
    rng = np.random.default_rng(0)
    voxels = VoxelMap(0.01, 1e-3, 3.0)
    for frame in range(12):
        wall(voxels, 2.0 * frame, frame)
    assert voxels.count > 20 * BLOCK_ROWS
    for step in range(60):
        first = int(rng.integers(0, voxels.count - 900))
        voxels.give(np.arange(first, first + 900), int(rng.integers(-1, 6)))
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
    voxels.give(np.arange(100, 300), 4)
    place = voxels.xyz(np.arange(150, 300))
    voxels.values[:150, 7] = 0.0  # these are gone, 50 of the object's among them
    capacity = len(voxels.keys)
    for frame in range(1, 60):
        wall(voxels, 2.0 * frame, frame)
    assert len(voxels.keys) > capacity
    assert voxels.alive == voxels.count == 60 * count - 150
    np.testing.assert_array_equal(voxels.xyz(voxels.rows_of(4)), place)
    _, touched = voxels.solid_hot_rows(0.3, 0, np.zeros(5, np.uint8))
    assert touched.tolist() == [0, 0, 0, 0, 1]


def test_blocks_remember_when_they_were_seen() -> None:
    blocks = RowBlocks(4 * BLOCK_ROWS)
    blocks.see(np.array([[0, 5], [-1, 3 * BLOCK_ROWS]], np.int32), 7)
    blocks.see(np.array([[-1, 2 * BLOCK_ROWS - 1]], np.int32), 9)
    assert blocks.seen_since(0).tolist() == [0, 1, 3]
    assert blocks.seen_since(8).tolist() == [1]
    blocks.rebuild(np.zeros(BLOCK_ROWS + 1, np.int32), np.arange(BLOCK_ROWS + 1, dtype=np.int32))
    assert blocks.seen_since(BLOCK_ROWS).tolist() == [1]
