"""Frames in one roll: what is turned, and turned back."""

from __future__ import annotations

import numpy as np
import pytest

from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.results import FrameResult, Proposal3D, Sighting
from cuboid.ground.geometry.box import Box
from cuboid.method.proposals.types import Proposals
from cuboid.runs.tracking.rolling import Roll, farther_up
from made_scenes import frame_of, look_at, upright

CAMERA = Intrinsics(50.0, 60.0, 30.5, 21.0, 64, 40)
BOX = Box(np.zeros(3), np.ones(3), np.eye(3))


def frame() -> Frame:
    rng = np.random.default_rng(0)
    depth = rng.uniform(0.5, 3.0, (40, 64)).astype(np.float32)
    return Frame(3, 0.1, rng.integers(0, 255, (40, 64, 3), dtype=np.uint8), depth, look_at((1, 2, 3), (0, 0, 0)))


def points(one: Frame, camera: Intrinsics) -> np.ndarray:
    """World points of all pixels, in a fixed order."""
    assert one.T_world_camera is not None
    v, u = np.mgrid[: camera.height, : camera.width]
    xyz = camera.points(u, v, one.depth_m).reshape(-1, 3)
    world = xyz @ one.T_world_camera[:3, :3].T + one.T_world_camera[:3, 3]
    return world[np.lexsort(np.round(world, 6).T)]


@pytest.mark.parametrize("turns", [0, 1, 2, 3])
def test_turned_images_show_the_same_points(turns: int) -> None:
    roll = Roll(CAMERA, turns)
    turned = roll.frame(frame())
    assert turned.depth_m.shape == (roll.camera.height, roll.camera.width)
    np.testing.assert_allclose(points(turned, roll.camera), points(frame(), CAMERA), atol=1e-5)


@pytest.mark.parametrize("turns", [0, 1, 2, 3])
def test_the_farther_side_is_turned_up(turns: int) -> None:
    floor = upright((0, 0), (6, 6, 0.1), z=-0.1)
    seen = frame_of([floor], look_at((0, -1, 1), (0, 0, 0)), 0).depth_m
    assert farther_up(seen) == 0
    assert farther_up(np.rot90(seen, -turns)) == (-turns) % 4
    assert farther_up(np.zeros_like(seen)) is None


@pytest.mark.parametrize("turns", [0, 1, 2, 3])
def test_proposals_are_turned_and_results_are_turned_back(turns: int) -> None:
    roll, mask = Roll(CAMERA, turns), np.arange(12, dtype=np.uint8).reshape(3, 4) % 2
    found = Proposals(np.array([[10, 5, 14, 8]], np.int32), np.ones(1, np.float32), (mask,))
    turned = roll.proposals(found)
    picture = np.zeros((CAMERA.height, CAMERA.width), np.uint8)
    picture[5:8, 10:14] = mask
    x0, y0, x1, y1 = turned.boxes_xyxy[0]
    assert turned.masks is not None
    np.testing.assert_array_equal(np.rot90(picture, -turns)[y0:y1, x0:x1], turned.masks[0])
    rect = turned.boxes_xyxy[0].astype(float)
    sightings, own = (Sighting(1, BOX, None, 1.0, rect),), (Proposal3D(1, BOX, 1.0, rect),)
    T_world_camera, heat = roll.frame(frame()).T_world_camera, np.rot90(picture, -turns).astype(np.float32)
    back = roll.result(FrameResult(3, 0.1, T_world_camera, sightings, own, 1, heat, {}))
    np.testing.assert_array_equal(back.sightings[0].rect_xyxy, [10, 5, 14, 8])
    np.testing.assert_array_equal(back.proposals[0].rect_xyxy, [10, 5, 14, 8])
    np.testing.assert_array_equal(back.heat, picture)
    np.testing.assert_allclose(back.T_world_camera, frame().T_world_camera)
