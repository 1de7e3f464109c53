"""The rows of each object, found by blocks, against a search through all rows."""

from __future__ import annotations

import numpy as np

from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.working import WorkingImage
from cuboid.method.heatmap.kernels.cubes import BLOCK_ROWS
from cuboid.method.heatmap.voxel_map import MAX_VOTES, VOTES_RATIO, VoxelMap

CAMERA = Intrinsics(60.0, 60.0, 31.5, 23.5, 64, 48)


def wall(voxels: VoxelMap, x: float, frame: int) -> np.ndarray:
    T = np.eye(4)
    T[0, 3] = x
    image = WorkingImage(np.full((48, 64), 1.0, np.float32), np.zeros((48, 64, 3), np.uint8), CAMERA, 1, (0, 0))
    return voxels.fuse(image, np.ones((48, 64), np.float32), T, frame)


def add(voxels: VoxelMap, rows: np.ndarray, number: int) -> None:
    """Let rows that no one has, or that have one vote, belong to an object."""
    slots = np.asarray(rows, np.int32)[None]
    claim, all_of = np.zeros(slots.shape, np.int32), np.zeros(64, np.int64)
    voxels.vote_owners(
        claim, np.array([number], np.int32), all_of, np.ones((1, 1), np.uint8), np.ones(slots.shape, np.uint8), slots
    )


def test_the_rows_of_an_object_are_found_whatever_becomes_of_them() -> None:
    rng = np.random.default_rng(0)
    voxels = VoxelMap(0.01, 1e-3, 3.0)
    for frame in range(12):
        wall(voxels, 2.0 * frame, frame)
    rows = voxels.stored.living()
    assert len(rows) > 20 * BLOCK_ROWS
    for step in range(60):
        first = int(rng.integers(0, len(rows) - 900))
        add(voxels, rows[first : first + 900], int(rng.integers(1, 6)))
        if step % 7 == 0:
            voxels.stored.transfer(3, 2)
        if step % 11 == 0:
            voxels.stored.release([5])
    for number in range(1, 6):
        assert voxels.stored.rows_of(number).tolist() == rows[voxels.stored.owner[rows] == number].tolist()
    assert len(voxels.stored.rows_of(1)) > 0
    assert len(voxels.stored.rows_of(3)) + len(voxels.stored.rows_of(5)) < voxels.stored.count


def test_the_rows_of_an_object_are_found_after_its_cube_was_packed() -> None:
    voxels = VoxelMap(0.01, 1e-3, 3.0)
    wall(voxels, 0.0, 0)
    rows = voxels.stored.living()
    right = rows[voxels.stored.xyz(rows)[:, 0] > 0.1]
    add(voxels, right, 4)
    place = voxels.stored.xyz(right)
    behind = WorkingImage(np.full((48, 64), 2.0, np.float32), np.zeros((48, 64, 3), np.uint8), CAMERA, 1, (0, 0))
    behind.depth_m[:, 40:] = 1.0  # what lies left of there is seen through
    for _ in range(4):
        voxels.carve_free_space(behind, np.eye(4))
    dead = voxels.stored.count - voxels.stored.alive
    assert dead > 500
    wall(voxels, 30.0, 1)  # far away: nothing is packed that is out of view
    assert voxels.stored.count - voxels.stored.alive == dead
    voxels.fuse(behind, np.zeros((48, 64), np.float32), np.eye(4), 2)
    assert voxels.stored.count - voxels.stored.alive < 0.3 * dead
    kept = voxels.stored.xyz(voxels.stored.rows_of(4))
    assert 0.5 * len(place) < len(kept) <= len(place)
    assert (voxels.stored.owner[voxels.rows_at(kept.astype(np.float64))] == 4).all()


def test_what_an_object_has_is_no_ones_after_it_was_released() -> None:
    voxels = VoxelMap(0.01, 1e-3, 3.0)
    wall(voxels, 0.0, 0)
    some = voxels.stored.living()[100:300]
    for _ in range(5):
        add(voxels, some, 4)
    voxels.stored.release([4])
    assert len(voxels.stored.rows_of(4)) == 0
    add(voxels, some, 7)
    assert voxels.stored.rows_of(7).tolist() == some.tolist(), "votes of who is no more count for nothing"


def test_the_solid_rows_of_an_object_are_hot_and_borne_out_by_votes() -> None:
    rng = np.random.default_rng(1)
    voxels = VoxelMap(0.01, 1e-3, 3.0)
    slots = wall(voxels, 0.0, 0)
    for frame in range(1, 9):
        wall(voxels, 0.0, frame)
    rows, points = voxels.stored.living(), voxels.stored.points
    add(voxels, slots[slots >= 0], 3)
    points.confidence[rows] = rng.integers(1, 9, len(rows))
    points.heat[rows] = rng.integers(0, 65536, len(rows))
    points.hits[rows] = rng.integers(1, 30, len(rows))
    for hot, votes in ((0.5, 2), (0.2, 1), (0.0, 5)):
        told = points.confidence[rows].astype(int)
        solid = (told >= votes) & (VOTES_RATIO * told >= np.minimum(voxels.stored.hits[rows], MAX_VOTES))
        expected = rows[(voxels.stored.owner[rows] == 3) & solid & (voxels.stored.heat(rows) >= hot)]
        assert 0 < len(expected) < len(rows)
        assert voxels.solid_rows_of(3, hot, votes).tolist() == expected.tolist()
