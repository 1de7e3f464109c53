from __future__ import annotations

import numpy as np
import pytest

from cuboid.heatmap.voxel_map import VoxelMap
from cuboid.objects.ownership import bends_around, gap_m, share_out
from cuboid.surfaces.clusters import MapCluster

UP = np.array([0.0, 0.0, 1.0])


def test_a_bar_is_shared_by_the_owners_of_its_ends() -> None:
    voxels = VoxelMap(0.01, 1e-3, 4.0)
    rows = np.arange(11)
    voxels.owner[[0, 10]] = [5, 3]
    edges = np.column_stack([rows[:-1], rows[1:]]).astype(np.int32)
    shares, touch = share_out(MapCluster(rows, lambda: edges, None, False), [5, 3], voxels)
    assert shares[0].tolist() == [
        0,
        1,
        2,
        3,
        4,
        5,
    ]  # the middle one is as near to both: the first owner takes it
    assert shares[1].tolist() == [6, 7, 8, 9, 10]
    assert touch[0, 1] == touch[1, 0] == pytest.approx(1 / 5)


def test_gap_is_the_least_distance_within_the_limit() -> None:
    rng = np.random.default_rng(0)
    a = rng.random((200, 3)).astype(np.float32)
    b = (rng.random((300, 3)) + np.array([1.05, 0, 0])).astype(np.float32)
    true = np.linalg.norm(a[:, None] - b[None], axis=-1).min()
    assert gap_m(a, b, 0.5) == pytest.approx(true, rel=1e-5)
    assert gap_m(a, b, 0.5 * true) == float("inf")


def arc(
    radius: float, start: float, end: float, center: tuple[float, float] = (0, 0), slope: float = 0.0
) -> np.ndarray:
    """A wall along an arc; it leans out by `slope` times its height, the more the higher, as a bowl's does."""
    angle, z = np.meshgrid(np.linspace(start, end, 40), np.linspace(0.0, 0.08, 9))
    r = radius + slope * np.sqrt(z * 0.08)
    return (
        np.stack([center[0] + r * np.cos(angle), center[1] + r * np.sin(angle), z], -1)
        .reshape(-1, 3)
        .astype(np.float32)
    )


def test_the_far_wall_of_a_bowl_bends_around_the_near_one_and_is_hollow() -> None:
    near, far = arc(0.05, np.pi + 0.4, 2 * np.pi - 0.4, slope=0.6), arc(0.045, 0.6, np.pi - 0.6, slope=0.6)
    bends, sag = bends_around(far, near, UP)
    assert bends
    assert sag < -0.004


def test_a_can_behind_a_bowl_does_not_bend_around_it() -> None:
    bowl = arc(0.08, np.pi + 0.2, 2 * np.pi - 0.2)
    can = arc(0.033, np.pi + 0.2, 2 * np.pi - 0.2, center=(0.0, 0.06))
    assert not bends_around(can, bowl, UP)[0]


def test_a_wider_thing_behind_does_not_bend_around() -> None:
    near, far = arc(0.05, np.pi + 0.2, 2 * np.pi - 0.2), arc(0.2, 0.4, np.pi - 0.4)
    assert not bends_around(far, near, UP)[0]


def test_the_front_and_top_of_a_box_are_not_hollow() -> None:
    x, z = np.meshgrid(np.linspace(-0.05, 0.05, 11), np.linspace(0, 0.1, 11))
    front = np.stack([x, np.full_like(x, 0.2), z], -1).reshape(-1, 3)
    u, v = np.meshgrid(np.linspace(-0.05, 0.05, 11), np.linspace(0.2, 0.3, 11))
    top = np.stack([u, v, np.full_like(u, 0.1)], -1).reshape(-1, 3)
    main = arc(0.08, 0, 2 * np.pi)
    assert bends_around(np.concatenate([front, top]).astype(np.float32), main, UP)[1] > 0
