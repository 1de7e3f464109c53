"""Where things end at the top: what stands free, and what goes on behind something nearer."""

from __future__ import annotations

import numpy as np
import pytest

from cuboid.geometry.se3 import inverse
from cuboid.surfaces.clusters import FrameCluster, top_is_seen
from cuboid.working import WorkingImage
from made_scenes import CAMERA, cast, look_at, upright

FLOOR = upright((0, 0), (8, 8, 0.1), z=-0.1)
UP = np.array([0.0, 0.0, 1.0])


def seen(things: list, which: int, eye: tuple[float, float, float], at: tuple[float, float, float]) -> bool:
    """Whether a frame shows the top of one of these things on a floor."""
    T = look_at(eye, at)
    depth, hit = cast([FLOOR, *things], T)
    image = WorkingImage(depth, np.zeros((*depth.shape, 3), np.uint8), CAMERA, 1, (0, 0))
    pixels = np.flatnonzero(hit.ravel() == which + 1)
    v, u = np.divmod(pixels, CAMERA.width)
    z = depth.ravel()[pixels].astype(np.float64)
    points = np.column_stack([(u - CAMERA.cx) / CAMERA.fx * z, (v - CAMERA.cy) / CAMERA.fy * z, z])
    cluster = FrameCluster(pixels, points @ T[:3, :3].T + T[:3, 3], None, 1.0, np.zeros(4), False)
    return top_is_seen(cluster, image, UP, inverse(T))


@pytest.mark.parametrize("size", [(0.07, 0.07, 0.12), (0.25, 0.18, 0.04), (0.05, 0.05, 0.5)])
@pytest.mark.parametrize("height", [0.6, 1.2])
def test_the_top_of_what_stands_free_is_seen(size: tuple[float, float, float], height: float) -> None:
    assert seen([upright((0.0, 0.0), size, 0.3)], 0, (0.3, -1.3, height), (0, 0, 0.1))


def test_the_leg_of_a_table_goes_on_behind_its_edge() -> None:
    leg, top = upright((-0.45, -0.35), (0.05, 0.05, 0.7)), upright((0, 0), (1.2, 0.9, 0.04), z=0.7)
    assert not seen([leg, top], 0, (0.4, -1.8, 1.4), (-0.2, 0, 0.5))


def test_a_thing_behind_a_lower_one_shows_its_top() -> None:
    behind, before = upright((0.0, 0.2), (0.1, 0.1, 0.25)), upright((0.0, 0.0), (0.3, 0.05, 0.12))
    assert seen([behind, before], 0, (0.0, -1.2, 0.5), (0, 0, 0.1))
