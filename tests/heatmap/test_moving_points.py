from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from cuboid.ground.core.working import WorkingImage
from cuboid.ground.geometry import se3
from cuboid.method.heatmap.kernels.cubes import ANCHORS, BLOCK_BITS, PLACES, ROW
from cuboid.method.heatmap.voxel_map import VoxelMap
from made_scenes import CAMERA, cast, look_at, upright
from worlds import cubes_of, voxels_of

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


def settle(voxels: VoxelMap, low: float = -99.0, high: float = 99.0) -> None:
    """Look at a part of the map, from `low` to `high` along x, m: points that lie or belong there move as they owe."""
    voxels.moving.relocate_around(np.array([[low, -99.0, -99.0], [high, 99.0, 99.0]]), 0.0)


def points_of(voxels: VoxelMap) -> list[tuple[np.ndarray, np.void]]:
    """Voxel of the world (3,) and row of each point."""
    rows = voxels.stored.living()
    keys = voxels.stored.cubes.key[voxels.stored.cubes.cube_of[rows >> BLOCK_BITS]]
    return list(zip(voxels_of(keys, voxels.stored.points.voxel[rows]), voxels.stored.memory.rows[rows], strict=True))


def carried_slowly(voxels: VoxelMap, moved: dict[int, np.ndarray]) -> dict[tuple[int, ...], dict[str, Any]]:
    """What `apply_correction` makes of a map, point by point: values of each voxel of the world."""
    groups: dict[tuple[int, ...], list[tuple[np.ndarray, np.void]]] = {}
    for voxel, row in points_of(voxels):
        place = voxel + (row["place"] + 0.5) / PLACES
        keyframe = int(voxels.anchors.keyframes(row["anchor"][None])[0])
        if keyframe in moved:
            place = se3.transform(moved[keyframe], place[None] * voxels.voxel_m)[0] / voxels.voxel_m
        groups.setdefault(tuple(int(k) for k in np.floor(place)), []).append((place, row, keyframe))
    return {voxel: _one_of(group) for voxel, group in groups.items()}


def _one_of(group: list[tuple[np.ndarray, np.void, int]]) -> dict[str, Any]:
    rows, keyframes = np.array([row for _, row, _ in group], ROW), np.array([keyframe for _, _, keyframe in group])
    weight = rows["weight"].astype(np.float64)
    owners = rows["owner"][rows["owner"] > 0]
    return {
        "place": np.average([place for place, _, _ in group], axis=0, weights=weight),
        "color": np.average(rows["color"].astype(np.float64), axis=0, weights=weight),
        "heat": np.average(rows["heat"].astype(np.float64), weights=weight),
        "weight": weight.sum(),
        "hits": rows["hits"].sum(dtype=np.int64),
        "passes": rows["passes"].sum(dtype=np.int64),
        "owner": owners.min() if len(owners) else np.int32(0),
        "anchors": {int(k) for k in keyframes[rows["last_frame"] == rows["last_frame"].max()]},
        "last_frame": rows["last_frame"].max(),
        "confidence": rows["confidence"].max(),
    }


def mottled(seed: int, keyframes: int = 6) -> VoxelMap:
    """A map of some hundred points of which each hangs on a keyframe and some belong to objects."""
    rng = np.random.default_rng(seed)
    voxels = VoxelMap(0.01, 1.4e-3, 3.0)
    number = np.unique(rng.integers(-25, 25, (800, 3)), axis=0)
    rows = np.zeros(len(number), ROW)
    rows["place"], rows["color"] = rng.integers(0, 1 << 16, (2, len(rows), 3))
    rows["heat"], rows["weight"] = rng.integers(0, 1 << 16, len(rows)), rng.uniform(0.1, 16, len(rows))
    rows["hits"], rows["passes"] = rng.integers(1, 99, len(rows)), rng.integers(0, 99, len(rows))
    rows["owner"], rows["confidence"] = rng.integers(0, 4, len(rows)), rng.integers(0, 9, len(rows))
    rows["anchor"], rows["last_frame"] = rng.integers(0, keyframes, len(rows)), rng.integers(0, 999, len(rows))
    keys, rows["voxel"] = cubes_of(number)
    voxels.refill(keys, rows)
    return voxels


@pytest.mark.parametrize("moving", [[1], [1, 2], [0, 1, 2, 3, 4, 5], [9]])
def test_a_map_moves_as_its_points_do_one_by_one(moving: list[int]) -> None:
    """Whether a few move or all do; what meets is averaged by weight, and the oldest object keeps it."""
    rng = np.random.default_rng(len(moving))
    for seed, size in ((1, 0.003), (2, 0.05), (3, 1.0)):
        voxels = mottled(seed)
        for _ in range(2):
            moved = {k: se3.exp(rng.normal(size=6) * size) for k in moving}
            expected = carried_slowly(voxels, moved)
            voxels.moving.apply_correction(moved)
            settle(voxels)
            rows, points = voxels.stored.living(), points_of(voxels)
            assert {tuple(voxel.tolist()) for voxel, _ in points} == set(expected)
            assert voxels.stored.alive == len(rows) == len(expected)
            for voxel, row in points:
                one = expected[tuple(voxel.tolist())]
                # two that meet are rounded once, and a third one once more
                assert np.abs(voxel + (row["place"] + 0.5) / PLACES - one["place"]).max() < 2.1 / PLACES
                assert np.abs(row["color"] - one["color"]).max() <= 1.01
                assert abs(row["heat"] - one["heat"]) <= 1.01
                assert row["weight"] == pytest.approx(one["weight"], rel=1e-6)
                for name in ("hits", "passes", "owner", "last_frame", "confidence"):
                    assert row[name] == one[name], name
                assert voxels.anchors.keyframes(row["anchor"][None])[0] in one["anchors"]
            places = voxels.stored.xyz(rows).astype(np.float64)
            assert (voxels.rows_at(places) == rows).mean() > 0.999  # each is found where it lies
            owned = voxels.stored.owned()
            assert sorted(owned) == np.unique(voxels.stored.owner[rows][voxels.stored.owner[rows] > 0]).tolist()
            for who, its in owned.items():
                np.testing.assert_array_equal(its, rows[voxels.stored.owner[rows] == who])


def test_a_part_that_moves_away_again_and_again_leaves_nothing_behind() -> None:
    voxels, first = mottled(4), mottled(4).stored.blocks
    for k in range(300):
        voxels.moving.apply_correction({1: se3.exp([1.0 if k % 2 else -1.0, 0.1 * k, 0, 0, 0, 0])})
        settle(voxels)
    assert voxels.stored.blocks < 20 * first


def wide(seed: int, points: int = 100_000) -> VoxelMap:
    """A map 20 m long, of which each metre hangs on a keyframe of its own, from 1."""
    rng = np.random.default_rng(seed)
    voxels = VoxelMap(0.01, 1.4e-3, 3.0)
    number = np.unique(rng.integers((0, 0, 0), (2000, 60, 20), (points, 3)), axis=0)
    rows = np.zeros(len(number), ROW)
    rows["weight"], rows["hits"], rows["anchor"] = 1.0, 1, 1 + number[:, 0] // 100
    rows["place"] = rng.integers(0, PLACES, (len(rows), 3))
    rows["owner"] = number[:, 0] // 500
    keys, rows["voxel"] = cubes_of(number)
    voxels.refill(keys, rows)
    return voxels


def moved_by(rng: np.random.Generator, size: float) -> dict[int, np.ndarray]:
    return {k: se3.exp(np.append(rng.normal(0, size, 3), rng.normal(0, size / 20, 3))) for k in range(1, 21)}


def test_a_correction_touches_no_point_and_a_look_only_those_that_lie_or_belong_there() -> None:
    voxels, rng = wide(5), np.random.default_rng(5)
    before = [np.array(rows) for _, _, rows in voxels.stored.copies(np.arange(1, voxels.stored.blocks))]
    xyz, keyframe = voxels.stored.xyz(voxels.stored.living()), voxels.stored.keyframe(voxels.stored.living())
    voxels.stored.take_changed()
    moved = moved_by(rng, 0.02)
    voxels.moving.apply_correction(moved)
    assert not len(voxels.stored.take_changed())
    for old, (_, _, new) in zip(before, voxels.stored.copies(np.arange(1, voxels.stored.blocks)), strict=True):
        np.testing.assert_array_equal(old, new)
    # whoever asks where points are is told all the same
    expected = np.empty_like(xyz)
    for k, T in moved.items():
        expected[keyframe == k] = se3.transform(T, xyz[keyframe == k])
    np.testing.assert_allclose(voxels.stored.xyz(voxels.stored.living()), expected, atol=1e-5)
    settle(voxels, 4.0, 4.5)
    changed = voxels.stored.take_changed()
    x = (voxels_of(voxels.stored.cubes.key[voxels.stored.cubes.cube_of[changed]], np.zeros(len(changed), np.uint16)))[
        :, 0
    ] * 0.01
    assert len(changed) > 0
    assert x.min() > 3.0
    assert x.max() < 5.2
    assert (
        voxels.rows_at(expected[(expected[:, 0] > 4.0) & (expected[:, 0] < 4.5)].astype(np.float64)) >= 0
    ).mean() > 0.99


def test_looks_here_and_there_between_corrections_leave_the_map_that_looks_everywhere_do() -> None:
    rng, at = np.random.default_rng(6), np.random.default_rng(7)
    lazy, eager = wide(6), wide(6)
    owners: dict[int, np.ndarray] = {}
    for _ in range(8):
        moved = moved_by(rng, 0.03)
        lazy.moving.apply_correction(moved)
        eager.moving.apply_correction(moved)
        settle(eager)
        assert not len(eager.anchors.pending_cubes[0])
        low = float(at.uniform(-1, 20))
        settle(lazy, low, low + 2.0)
        assert len(lazy.anchors.pending_cubes[0])
        owners = {number: lazy.stored.xyz(rows) for number, rows in lazy.stored.owned().items()}
    for one, other in ((lazy, eager), (eager, lazy)):
        near, _ = cKDTree(other.stored.xyz(other.stored.living())).query(one.stored.xyz(one.stored.living()))
        assert np.quantile(near, 0.9) < 0.01  # which points meet differs
        assert abs(len(one.stored.living()) / len(other.stored.living()) - 1) < 0.1
    for number, rows in eager.stored.owned().items():
        assert np.abs(owners[number].mean(0) - eager.stored.xyz(rows).mean(0)).max() < 0.03
    settle(lazy)
    rows = lazy.stored.living()
    assert not len(lazy.anchors.pending_cubes[0])
    assert (lazy.rows_at(lazy.stored.xyz(rows).astype(np.float64)) == rows).mean() > 0.999
    assert lazy.stored.alive == len(rows)


def test_numbers_of_anchors_do_not_run_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cuboid.method.heatmap.anchors.LAST_KEYFRAME", ANCHORS - 50)
    voxels, rng = wide(8, 5_000), np.random.default_rng(8)
    count = len(voxels.stored.living())
    for k in range(30):
        voxels.moving.apply_correction(moved_by(rng, 0.001))
        settle(voxels, k / 2, k / 2 + 1)
        slots = voxels.fuse(image(), np.ones((240, 320), np.float32), POSE, k, anchor=1 + k % 20)
        assert (voxels.stored.keyframe(slots[slots >= 0]) == 1 + k % 20).all()
    assert len(voxels.stored.living()) > 0.8 * count


def test_a_correction_moves_no_point_until_its_region_is_accessed(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(8)
    voxels = wide(9, 36_000)
    relocated: list[int] = []
    relocate = voxels.moving._relocate
    monkeypatch.setattr(voxels.moving, "_relocate", lambda cubes: relocated.append(len(cubes)) or relocate(cubes))
    for _ in range(6):
        voxels.moving.apply_correction(moved_by(rng, 0.01))
    assert relocated == []
    settle(voxels)
    assert sum(relocated) > 0


def test_a_map_that_was_doubled_by_drift_is_single_again() -> None:
    single, double = fused([0.0]), fused([0.0, 0.05])
    before = double.stored.count
    assert before > 1.2 * single.stored.count
    rows = double.stored.living()
    second = (double.stored.keyframe(rows) == 2) & (double.stored.hits[rows] == 1)  # the others are averages of both
    double.stored.owner[rows[second]] = 2
    double.stored.owner[rows[~second]] = 1
    younger = int(np.count_nonzero(second))
    double.moving.apply_correction({2: se3.exp([-0.05, 0, 0, 0, 0, 0])})
    settle(double)
    assert double.stored.count < 1.06 * single.stored.count  # what both views had averaged lies between
    # much of the second view fell onto the first, whose object is the older one
    assert np.count_nonzero(double.stored.owner[double.stored.living()] == 2) < 0.6 * younger
    there = double.rows_at(single.stored.xyz(single.stored.living()).astype(np.float64)) >= 0
    assert there.mean() > 0.97


def test_the_moved_map_goes_on_as_one_that_was_never_wrong() -> None:
    voxels = fused([0.3])
    voxels.moving.apply_correction({1: se3.exp([-0.3, 0, 0, 0, 0, 0])})
    assert (voxels.rows_at(voxels.stored.xyz(voxels.stored.living()).astype(np.float64)) >= 0).mean() > 0.999
    count = voxels.stored.count
    voxels.fuse(image(), np.ones((240, 320), np.float32), POSE, 1, anchor=1)
    assert voxels.stored.count < 1.1 * count


def test_what_hangs_on_no_moved_keyframe_stays() -> None:
    voxels = fused([0.0])
    before = voxels.stored.xyz(voxels.stored.living())
    voxels.moving.apply_correction({5: se3.exp([1.0, 0, 0, 0, 0, 0])})
    after = voxels.stored.xyz(voxels.stored.living())
    np.testing.assert_array_equal(before, after)
    empty = VoxelMap(0.01, 1.4e-3, 3.0)
    empty.moving.apply_correction({1: np.eye(4)})
    assert empty.stored.count == 0


def test_each_object_has_its_own_living_rows() -> None:
    voxels = fused([0.0])
    assert voxels.stored.owned() == {}
    rows = voxels.stored.living()
    slots = rows.astype(np.int32)[None]
    claim = (np.arange(len(rows), dtype=np.int32) % 3)[None]
    free = np.ones((3, 1), np.uint8)
    voxels.vote_owners(
        claim, np.array([0, 1, 2], np.int32), np.zeros(9, np.int64), free, np.ones_like(claim, np.uint8), slots
    )
    owned = voxels.stored.owned()
    assert list(owned) == [1, 2]
    for number, own in owned.items():
        np.testing.assert_array_equal(own, rows[number::3])
