"""What nobody looks at, and no object owns, is kept in cells of two voxels a side, and comes back where it was."""

from __future__ import annotations

import numpy as np
import pytest

from cuboid.ground.core.working import WorkingImage
from cuboid.ground.geometry import se3
from cuboid.method.heatmap import levels
from cuboid.method.heatmap.voxel_map import VoxelMap
from made_scenes import CAMERA, cast, look_at, upright

# A floor, and a wall that is tilted so that it goes through voxels at all heights.
SCENE = [upright((0, 0), (2, 2, 0.02), z=-0.017), upright((0.1, 0.5), (1.0, 0.1, 0.6), 0.3, z=0.0)]
POSE = look_at((0.9, -0.8, 0.9), (0.1, 0.1, 0.0))
ELSEWHERE = se3.compose((1, 0, 0, 0), (20.0, 0, 0))
COLD = np.zeros((240, 320), np.float32)


def image() -> WorkingImage:
    depth, hit = cast(SCENE, POSE)
    color = np.repeat((hit[..., None] + 2) * 60, 3, 2).astype(np.uint8)
    return WorkingImage(depth.astype(np.float32), color, CAMERA, 1, (0, 0))


def seen(frames: int = 4) -> VoxelMap:
    voxels = VoxelMap(0.01, 1.4e-3, 3.0)
    for k in range(frames):
        voxels.fuse(image(), COLD, POSE, k)
        voxels.carve_free_space(image(), se3.inverse(POSE))
    return voxels


def look_elsewhere(voxels: VoxelMap, frames: int, stays: int = 0) -> None:
    """Look at another place, and after each frame so many times from where that was taken."""
    for _ in range(frames):
        for k in range(1 + stays):
            voxels.fuse(image(), COLD, ELSEWHERE @ POSE, 100, new_viewpoint=k == 0)
            voxels.carve_free_space(image(), se3.inverse(ELSEWHERE @ POSE), new_viewpoint=k == 0)


def here(voxels: VoxelMap) -> np.ndarray:
    """Return the points of the first place, in an order of their own."""
    points, _ = voxels.stored.spread(voxels.stored.living())
    points = points[points[:, 0] < 10].astype(np.float64)
    return points[np.lexsort(np.floor(points / 0.01).T)]


def rows_here(voxels: VoxelMap) -> int:
    """Return how many rows the first place takes."""
    rows = voxels.stored.living()
    return int(np.count_nonzero(voxels.stored.xyz(rows)[:, 0] < 10))


def test_structure_out_of_view_takes_fewer_rows_and_keeps_each_voxel(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(levels, "MAX_UNVIEWED_MOMENTS", 8)
    voxels = seen()
    before, rows, size = here(voxels), voxels.stored.alive, voxels.stored.nbytes
    owner = voxels.owner_at(before)
    voxels.levels.thin_all()
    assert voxels.stored.alive < 0.45 * rows
    assert voxels.stored.nbytes < 0.45 * size
    after = here(voxels)
    np.testing.assert_array_equal(np.floor(after / 0.01), np.floor(before / 0.01), "the same voxels hold a point")
    off = np.linalg.norm(after - before, axis=1)
    assert np.median(off) < 0.003
    # Of the floor, which lies level, the height is kept as it was.
    floor = np.abs(before[:, 2] - 0.003) < 1e-4
    assert floor.sum() > 1000
    assert np.quantile(np.abs(after[floor, 2] - before[floor, 2]), 0.98) < 1e-4, "but at the wall's foot"
    np.testing.assert_array_equal(voxels.owner_at(before), owner, "what is asked is told as before")
    assert voxels.stored.alive == rows, "what somebody asks for has rows of its own again"


def test_voxels_of_objects_and_those_seen_once_stay_apart() -> None:
    voxels = seen(1)
    rows = voxels.stored.living()
    mine = rows[voxels.stored.xyz(rows)[:, 2] > 0.3]
    voxels.stored.owner[mine] = 3
    voxels.stored.owned_blocks.add_rows(voxels.stored.owner[mine], mine >> 10)
    points = voxels.stored.xyz(voxels.stored.rows_of(3))
    voxels.levels.thin_all()
    assert voxels.stored.alive < 0.6 * len(rows)
    np.testing.assert_array_equal(voxels.stored.xyz(voxels.stored.rows_of(3)), points)
    own = voxels.stored.rows_of(3)
    voxels.fuse(image(), COLD, POSE, 9)
    np.testing.assert_array_equal(voxels.stored.rows_of(3), own, "their rows keep their numbers when others are parted")
    assert np.count_nonzero(voxels.stored.hits[voxels.stored.living()] == 2) > 1000, "some were seen again"


def test_a_place_that_is_out_of_view_for_long_is_thinned_whatever_memory_there_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(levels, "MAX_UNVIEWED_MOMENTS", 8)
    rich, poor = seen(), seen()
    poor.stored.memory_mb = 1.0
    for voxels in (rich, poor):
        rows = rows_here(voxels)
        look_elsewhere(voxels, 8)
        assert rows_here(voxels) == rows, "not yet"
        look_elsewhere(voxels, 60)
        assert rows_here(voxels) < 0.6 * rows
    np.testing.assert_array_equal(here(rich), here(poor))
    for voxels in (rich, poor):
        voxels.fuse(image(), COLD, POSE, 200)
        voxels.carve_free_space(image(), se3.inverse(POSE))
    np.testing.assert_array_equal(here(rich), here(poor))
    np.testing.assert_array_equal(rich.stored.hits[rich.stored.living()], poor.stored.hits[poor.stored.living()])


def test_how_long_is_long_does_not_depend_on_frames_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    """Away is what the camera has turned from, not what it has stood beside for many frames."""
    monkeypatch.setattr(levels, "MAX_UNVIEWED_MOMENTS", 8)
    slow, fast = seen(), seen()
    rows = rows_here(slow)
    look_elsewhere(slow, 8)
    look_elsewhere(fast, 8, stays=9)
    assert rows_here(slow) == rows_here(fast) == rows
    look_elsewhere(slow, 60)
    look_elsewhere(fast, 60, stays=3)
    assert rows_here(slow) == rows_here(fast) < 0.6 * rows
    np.testing.assert_array_equal(here(slow), here(fast))


def test_rows_of_a_file_are_parted_as_those_of_the_map() -> None:
    voxels = seen()
    voxels.levels.thin_all()
    rows = voxels.stored.living()
    shared = rows[voxels.stored.cubes.cube_of[rows >> 10] == 0]
    parted, (points, _) = levels.split_rows(voxels.stored.memory.rows[shared]), voxels.stored.spread(shared)
    assert len(parted) == len(points) > len(shared)
    corner = np.floor(points / 0.32).astype(int)[0] * 32
    voxel = np.stack([parted["voxel"] >> 10, (parted["voxel"] >> 5) & 31, parted["voxel"] & 31], 1)
    np.testing.assert_allclose((corner + voxel + (parted["place"] + 0.5) / 65536) * 0.01, points, atol=1e-6)
