"""What belongs to small objects is kept in voxels of half the edge as well, and no decision knows of it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.depth import resolves_m
from cuboid.ground.core.observation import Observation
from cuboid.ground.core.working import WorkingImage
from cuboid.ground.geometry import se3
from cuboid.method.heatmap.kernels import owners
from cuboid.method.heatmap.voxel_map import VoxelMap
from cuboid.runs.tracking.posed_tracker import PosedTracker
from made_scenes import CAMERA, cast, look_at, upright
from worlds import CAMERA as SMALL
from worlds import Proposer, World

FLOOR, THING = upright((0, 0), (2, 2, 0.02), z=-0.02), upright((0.1, 0.1), (0.08, 0.1, 0.12), 0.3)
POSE = look_at((0.45, -0.3, 0.4), (0.1, 0.1, 0.05))
AWAY = se3.compose((1, 0, 0, 0), (20.0, 0, 0))
NUMBERS = np.array([False, False, False, True])


def image(boxes: tuple = (FLOOR, THING), T: np.ndarray = POSE) -> WorkingImage:
    """A thing with level stripes, 5 mm of each color."""
    depth, hit = cast(boxes, T, CAMERA)
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    height = se3.transform(T, CAMERA.points(u, v, depth))[..., 2]
    gray = np.where((hit == 1) & (np.floor(height / 0.005) % 2 == 0), 220, 20)
    return WorkingImage(depth.astype(np.float32), np.repeat(gray[..., None], 3, 2).astype(np.uint8), CAMERA, 1, (0, 0))


def fuse(voxels: VoxelMap, frame: int, shown: WorkingImage, T: np.ndarray = POSE, *, finely: bool = True) -> None:
    """Fuse a frame; what is above the floor is object 3's."""
    hot = np.ones(shown.depth_m.shape, np.float32)
    slots = voxels.fuse(shown, hot, T, frame, anchor=1)
    voxels.carve_free_space(shown, se3.inverse(T))
    rows = voxels.stored.living()
    mine = rows[(voxels.stored.xyz(rows)[:, 2] > 0.005) & (voxels.stored.owner[rows] == 0)]
    voxels.stored.owner[mine] = 3
    voxels.stored.owned_blocks.add_rows(voxels.stored.owner[mine], mine >> 10)
    if finely:
        seen_here = Observation(frame, shown, shown, T, None, 1, True, 0.0)
        voxels.fine.refine(seen_here, hot, slots, NUMBERS, 1.0)


def seen(frames: int = 4, *, finely: bool = True) -> VoxelMap:
    voxels = VoxelMap(0.01, 1.4e-3, 3.0)
    for k in range(frames):
        fuse(voxels, k, image(), finely=finely)
    return voxels


def fine_of(voxels: VoxelMap) -> tuple[np.ndarray, np.ndarray]:
    """Return the fine points that are the object's, and the points of the map that they are."""
    rows = voxels.stored.rows_of(3)
    fine, whole = voxels.fine.fine_replacements(voxels.stored.xyz(rows), np.ones(len(rows), bool))
    return fine, rows[whole]


def test_small_things_have_their_shape_and_colors_at_half_a_voxel() -> None:
    voxels = seen()
    coarse, (fine, whole) = voxels.stored.rows_of(3), fine_of(voxels)
    assert len(fine) > 3 * len(coarse)
    assert set(whole.tolist()) == set(coarse.tolist()), "all of it was near"
    shown = image()
    v, u = np.nonzero(shown.depth_m > 0)
    true = se3.transform(POSE, CAMERA.points(u, v, shown.depth_m[v, u]))
    true = true[true[:, 2] > 0.011]
    reach = [cKDTree(voxels.stored.xyz(rows)).query(true)[0] for rows in (coarse, fine)]
    assert (reach[1] < 0.004).mean() > 0.99
    assert (reach[0] < 0.004).mean() < 0.7
    side = true[(true[:, 2] > 0.01) & (true[:, 2] < 0.11)]
    stripe = np.where(np.floor(side[:, 2] / 0.005) % 2 == 0, 220, 20)
    off = [
        np.abs(
            voxels.stored.rgb(rows)[cKDTree(voxels.stored.xyz(rows)).query(side)[1]][:, 0] - stripe.astype(float)
        ).mean()
        for rows in (coarse, fine)
    ]
    assert off[1] < 0.4 * off[0]


def test_no_decision_knows_of_fine_points() -> None:
    """Rows of the map's voxels are the same, byte for byte, whatever becomes of them."""
    moved = {1: se3.exp(np.array([0.012, 0.03, -0.02, 0.01, 0.0, 0.02]))}
    told = []
    for finely in (False, True):
        voxels = seen(finely=finely)
        voxels.moving.apply_correction(moved)
        fuse(voxels, 4, image(T=AWAY @ POSE), AWAY @ POSE, finely=finely)
        for k in range(5, 9):
            fuse(voxels, k, image((FLOOR,)), finely=finely)
        voxels.levels.thin_all()
        rows = voxels.stored.living()
        told.append(
            (
                voxels.stored.memory.rows[rows].tobytes(),
                voxels.stored.xyz(rows).tobytes(),
                voxels.stored.rows_of(3).size,
            )
        )
        assert (voxels.stored.alive > len(rows)) == finely
    assert told[0] == told[1]


def test_they_move_with_their_keyframe() -> None:
    voxels = seen()
    fine, _ = fine_of(voxels)
    before = voxels.stored.xyz(fine).astype(np.float64)
    T = se3.exp(np.array([0.12, -0.31, 0.007, 0.02, 0.01, 0.3]))
    voxels.moving.apply_correction({1: T})
    expected = se3.transform(T, before)
    np.testing.assert_allclose(voxels.stored.xyz(fine), expected, atol=1e-6)
    voxels.moving.relocate_around(np.array([[-9.0, -9.0, -9.0], [9.0, 9.0, 9.0]]), 0.0)
    fine = voxels.stored.living(fine=True)
    far = cKDTree(voxels.stored.xyz(fine)).query(expected)[0]
    assert np.quantile(far, 0.9) < 0.0025, "those that meet in a voxel are one"
    assert len(fine_of(voxels)[0]) > 0.8 * len(fine), "the object's still"


def test_they_go_with_what_they_are() -> None:
    voxels = seen()
    assert len(fine_of(voxels)[0])
    voxels.stored.transfer(3, 2)
    assert not len(fine_of(voxels)[0]), "whom they belong to is what the voxels of the map say"
    voxels.stored.transfer(2, 3)
    for k in range(4, 12):
        fuse(voxels, k, image((FLOOR,)))
    for rows in (voxels.stored.rows_of(3), voxels.stored.living(fine=True)):
        assert not (voxels.stored.xyz(rows)[:, 2] > 0.03).any(), "seen through: the floor lies behind"


def test_they_leave_memory_and_come_back() -> None:
    voxels = seen()
    fine, whole = fine_of(voxels)
    points, colors, size = voxels.stored.xyz(fine), voxels.stored.rgb(fine), voxels.stored.nbytes
    voxels.stored.memory_mb = 1.0
    voxels.stored.evict()
    assert voxels.stored.nbytes < 0.2 * size
    again, same = fine_of(voxels)
    np.testing.assert_array_equal(again, fine)
    np.testing.assert_array_equal(same, whole)
    np.testing.assert_array_equal(voxels.stored.xyz(fine), points)
    np.testing.assert_array_equal(voxels.stored.rgb(fine), colors)


def test_what_is_chosen_of_a_picture() -> None:
    rng = np.random.default_rng(1)
    slots = rng.integers(-1, 40, (12, 17)).astype(np.int32)
    owner, depth = rng.integers(0, 6, 40).astype(np.int32), rng.uniform(0, 2, (12, 17)).astype(np.float32)
    slots[:2], slots[:, 14:] = -1, -1
    chosen = np.empty_like(depth)
    bounds = owners.choose(slots, owner, NUMBERS, depth, 1.5, chosen)
    mine = (slots >= 0) & (owner[slots] == 3) & (depth <= 1.5)
    np.testing.assert_array_equal(chosen, np.where(mine, depth, 0))
    v, u = np.nonzero(mine)
    assert bounds == (v.min(), v.max() + 1, u.min(), u.max() + 1)
    top, bottom, *_ = owners.choose(slots, owner, np.zeros(9, bool), depth, 1.5, chosen)
    assert bottom <= top
    assert not chosen.any()


@pytest.mark.parametrize(("noise_per_m", "focal_px"), [(1.4e-3, 525.0), (1.4e-3, 200.0), (5e-3, 525.0)])
def test_a_sensor_resolves_no_more_than_its_noise_and_its_pixels(noise_per_m: float, focal_px: float) -> None:
    far_m = resolves_m(0.005, noise_per_m, focal_px)
    assert max(noise_per_m * far_m**2, far_m / focal_px) == pytest.approx(0.005)


def test_results_are_the_same_and_the_map_has_more_points(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    world, proposer = World(rng), Proposer(rng, strays=0)
    world.room = [FLOOR]
    world.things = [upright((0.0, 0.0), (0.2, 0.2, 0.25), 0.2), upright((0.5, 0.2), (0.6, 0.3, 0.3), 0.0)]
    proposer.first = len(world.room)
    frames = []
    for k in range(20):
        frame, proposer.hit = world.frame(world.pose("on"), k)
        frames.append((frame, proposer(frame, SMALL)))
    told, points = [], []
    for far_m in (0.0, 3.0):
        monkeypatch.setattr("cuboid.runs.tracking.posed_tracker.resolves_m", lambda *_, far_m=far_m: far_m)
        tracker = PosedTracker(SMALL, TrackerConfig(min_probability=0.1), lambda frame, _: frames[frame.index][1])
        results = [tracker.update(frame) for frame, _ in frames]
        told.append([[(s.label, s.box.center.tobytes(), s.rect_xyxy.tobytes()) for s in r.sightings] for r in results])
        points.append(tracker.map_points())
        seen = [s for r in results for s in r.sightings]
        labels = {o.label: o.box.size.max() for o in tracker.objects}
        ever_small = {s.label for s in seen if s.box.size.max() < 0.32}
    assert told[0] == told[1]
    small = [label for label, size in labels.items() if size < 0.32]
    large = [label for label in labels if label not in ever_small]
    assert small
    assert large
    before, after = (np.bincount(p.label, minlength=9) for p in points)
    assert (after[small] > 1.3 * before[small]).all(), "its pixels are few"
    np.testing.assert_allclose(after[[0, *large]], before[[0, *large]], rtol=0.02, err_msg="others have none")
