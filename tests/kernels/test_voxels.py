"""The voxel hash against a dictionary that does the same in plain Python."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
import pytest

from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.working import WorkingImage
from cuboid.method.heatmap.voxel_map import VoxelMap

CAMERA = Intrinsics(60.0, 60.0, 31.5, 23.5, 64, 48)
VOXEL = 0.05


def image_of(depth: np.ndarray, seed: int = 0) -> WorkingImage:
    color = np.random.default_rng(seed).integers(0, 256, (*depth.shape, 3), dtype=np.uint8)
    return WorkingImage(depth.astype(np.float32), color, CAMERA, 1, (0, 0))


def turned(angle: float, shift: tuple[float, float, float]) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    T = np.eye(4)
    T[:3, :3] = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
    T[:3, 3] = shift
    return T


def points_of(image: WorkingImage, T: np.ndarray) -> np.ndarray:
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    z = image.depth_m.astype(np.float64)
    p = np.stack([(u - CAMERA.cx) / CAMERA.fx * z, (v - CAMERA.cy) / CAMERA.fy * z, z], -1)
    return p @ T[:3, :3].T + T[:3, 3]


@pytest.mark.parametrize("voxel_m", [VOXEL, VOXEL / 10.0], ids=["few cubes", "many cubes"])
def test_fuse_is_the_weighted_mean_of_all_sightings(voxel_m: float) -> None:
    rng = np.random.default_rng(1)
    voxels = VoxelMap(voxel_m, 1e-3, 3.5)
    truth: dict[tuple[int, int, int], list[tuple[float, ...]]] = defaultdict(list)
    frames: dict[tuple[int, int, int], set[int]] = defaultdict(set)
    for frame in range(3):
        depth = rng.uniform(0.8, 4.0, (48, 64))
        depth[rng.random(depth.shape) < 0.2] = 0
        image = image_of(depth, frame)
        heat = np.where(rng.random(depth.shape) < 0.5, rng.uniform(0.2, 1, depth.shape), 0.05).astype(np.float32)
        T = turned(0.2 * frame, (0.1 * frame, 0.0, -0.2))
        voxels.stored.carving_passes = frame  # of earlier frames: selects half of the far pixels
        slots = voxels.fuse(image, heat, T, frame)
        points = points_of(image, T)
        for v in range(48):
            for u in range(64):
                z = float(image.depth_m[v, u])
                near = (u % 2) + 2 * (v % 2) == frame % 4
                far = near and (u // 2 % 2) + 2 * (v // 2 % 2) == frame // 4 % 4
                hot = heat[v, u] > 0.1
                speaks = (z <= 2 or (u + v + frame) % 2 == 0) if hot else (near if z <= 2 else far)
                if not 0 < z <= 3.5 or not speaks:
                    assert slots[v, u] == -1
                    continue
                key = tuple(np.floor(points[v, u] / voxel_m).astype(int))
                weight = ((1.0 if z <= 2 else 2.0) if hot else 4.0 if z <= 2 else 16.0) / max(z, 0.5) ** 4
                truth[key].append((weight, *points[v, u], *image.color[v, u], float(heat[v, u])))
                frames[key].add(frame)
                assert slots[v, u] >= 0
    assert voxels.stored.count == len(truth)
    rows = voxels.stored.living()
    for row, xyz, rgb, heat, weight in zip(
        rows,
        voxels.stored.xyz(rows),
        voxels.stored.rgb(rows),
        voxels.stored.heat(rows),
        voxels.stored.weight(rows),
        strict=True,
    ):
        key = tuple(np.floor(xyz.astype(np.float64) / voxel_m).astype(int))
        if key not in truth:  # the mean of points on a voxel's face may round into the next one
            continue
        samples = np.array(truth[key])
        mean = samples[:, 0] @ samples[:, 1:] / samples[:, 0].sum()
        np.testing.assert_allclose(xyz, mean[:3], atol=2e-5)
        np.testing.assert_allclose(rgb, mean[3:6], atol=0.6)
        np.testing.assert_allclose(heat, mean[6], atol=1e-3)
        np.testing.assert_allclose(weight, samples[:, 0].sum(), rtol=1e-4)
        assert voxels.stored.hits[row] == len(frames[key])


def test_a_point_that_is_seen_through_goes_and_the_surface_behind_stays() -> None:
    voxels = VoxelMap(VOXEL, 1e-3, 5.0)
    near, far = np.full((48, 64), 1.0), np.full((48, 64), 2.0)
    hot = np.ones((48, 64), np.float32)
    voxels.fuse(image_of(near), hot, np.eye(4), 0)
    in_front = voxels.stored.count
    for frame in range(1, 5):
        image = image_of(far)
        voxels.fuse(image, hot, np.eye(4), frame)
        voxels.carve_free_space(image, np.eye(4))
    z = voxels.stored.xyz(voxels.stored.living())[:, 2]
    inner = np.abs(voxels.stored.xyz(voxels.stored.living())[:, :2]).max(1) < 0.35
    assert in_front > 100
    assert (z[inner] > 1.5).all()
    assert (z > 1.5).sum() > 100


def test_frames_from_one_place_leave_out_what_is_cold_and_look_through_once_for_all() -> None:
    voxels = VoxelMap(VOXEL, 1e-3, 5.0)
    near, far = np.full((48, 64), 1.0), np.full((48, 64), 2.0)
    half = np.zeros((48, 64), np.float32)
    half[:, :32] = 1.0
    slots = [voxels.fuse(image_of(near), half, np.eye(4), frame, new_viewpoint=frame == 0) for frame in range(3)]
    assert (slots[0][:, 32:] >= 0).mean() == 0.25
    for some in slots[1:]:
        assert (some[:, :32] >= 0).all()
        assert (some[:, 32:] < 0).all()
    for _ in range(5):
        voxels.carve_free_space(image_of(far), np.eye(4), new_viewpoint=False)
    assert voxels.stored.alive == voxels.stored.count
    voxels.carve_free_space(image_of(far), np.eye(4))
    assert voxels.stored.alive < voxels.stored.count / 2
    assert voxels.stored.carving_passes == 6


def test_stray_points_go_also_while_the_map_grows(monkeypatch: pytest.MonkeyPatch) -> None:
    """A large map is looked through in turns; new points at its end must not keep the turn from coming round."""
    monkeypatch.setattr("cuboid.method.heatmap.voxel_map.MAX_CARVED_POINTS", 100)
    voxels = VoxelMap(VOXEL, 1e-3, 30.0)
    hot = np.ones((48, 64), np.float32)
    voxels.fuse(image_of(np.full((48, 64), 1.0)), hot, np.eye(4), 0)
    stray = voxels.stored.living()
    inner = stray[np.abs(voxels.stored.xyz(stray)[:, :2]).max(1) < 0.3]
    rng = np.random.default_rng(0)
    for frame in range(1, 250):
        image = image_of(rng.uniform(5, 25, (48, 64)))
        voxels.fuse(image, hot, np.eye(4), frame)
        voxels.carve_free_space(image, np.eye(4))
    assert len(inner) > 50
    assert (voxels.stored.xyz(voxels.stored.living())[:, 2] > 1.5).all()


def test_a_point_that_was_removed_and_is_seen_again_counts_as_new() -> None:
    voxels = VoxelMap(VOXEL, 1e-3, 5.0)
    near, far, hot = np.full((48, 64), 1.0), np.full((48, 64), 2.0), np.ones((48, 64), np.float32)
    voxels.fuse(image_of(near), hot, np.eye(4), 3)
    before = voxels.stored.living()
    for _ in range(4):
        voxels.carve_free_space(image_of(far), np.eye(4))
    gone = np.setdiff1d(before, voxels.stored.living())
    assert len(gone) > 50
    voxels.fuse(image_of(near), hot, np.eye(4), 3)  # the same number, as after a recording began anew
    assert voxels.stored.alive == len(before)
    assert (voxels.stored.hits[voxels.stored.living()] == 1).all()
    np.testing.assert_allclose(voxels.stored.xyz(voxels.stored.living())[:, 2], 1.0, atol=1e-6)


def test_a_surface_that_is_hit_as_often_stays() -> None:
    voxels = VoxelMap(VOXEL, 1e-3, 5.0)
    hot = np.ones((48, 64), np.float32)
    for frame in range(8):
        image = image_of(np.full((48, 64), 1.0))
        voxels.fuse(image, hot, np.eye(4), frame)
    count = len(voxels.stored.living())
    for _ in range(4):
        voxels.carve_free_space(image_of(np.full((48, 64), 2.0)), np.eye(4))
    assert len(voxels.stored.living()) == count


def test_memory_follows_the_surface_and_not_the_frames() -> None:
    voxels = VoxelMap(VOXEL, 1e-3, 5.0)
    hot = np.ones((48, 64), np.float32)
    image = image_of(np.full((48, 64), 1.5))
    voxels.fuse(image, hot, np.eye(4), 0)
    count, held = voxels.stored.count, voxels.stored.nbytes
    for frame in range(1, 100):
        voxels.fuse(image, hot, np.eye(4), frame)
    assert (voxels.stored.count, voxels.stored.nbytes) == (count, held)


def test_points_survive_the_growth_of_the_map() -> None:
    voxels = VoxelMap(0.01, 1e-3, 50.0)
    rng = np.random.default_rng(0)
    hot = np.ones((48, 64), np.float32)
    seen: set[tuple[int, ...]] = set()
    for frame in range(60):
        image = image_of(rng.uniform(0.5, 1.9, (48, 64)))
        T = turned(0.1 * frame, (frame, 0, 0))
        voxels.fuse(image, hot, T, frame)
        seen |= {tuple(k) for k in np.floor(points_of(image, T).reshape(-1, 3) / 0.01).astype(int)}
    assert voxels.stored.count > 1 << 17
    assert voxels.stored.count == pytest.approx(len(seen), rel=1e-3)
    places = np.floor(voxels.stored.xyz(voxels.stored.living()).astype(np.float64) / 0.01).astype(int)
    assert len(np.unique(places, axis=0)) > 0.99 * voxels.stored.count, "a voxel has one row"
