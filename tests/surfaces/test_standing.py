"""What stands on the flat areas of a frame."""

from __future__ import annotations

import numpy as np
import pytest

from cuboid.ground.arrays import Float32Array
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.depth import DepthImage
from cuboid.ground.geometry.box import Box
from cuboid.method.surfaces.standing import FlatAreas, find_flat_areas
from made_scenes import CAMERA, cast, look_at, upright

TABLE = upright((0, 0), (1.4, 1.0, 0.05), z=-0.05)
THING = upright((0.1, 0.1), (0.2, 0.15, 0.12), 0.3)
POSE = look_at((0.0, -0.9, 0.7), (0, 0, 0))


def depth_of(*boxes: Box) -> Float32Array:
    return cast(boxes, POSE)[0].astype(np.float32)


def areas(depth_m: Float32Array) -> FlatAreas:
    return find_flat_areas(DepthImage(depth_m, CAMERA), TrackerConfig())


def test_a_thing_on_a_table_is_evidence_for_the_table() -> None:
    found = areas(depth_of(TABLE, THING))
    k = int(np.argmax(found.evidence))
    assert found.normal[k] @ POSE[:3, :3].T @ [0, 0, 1] > 0.999
    assert found.evidence[k] > 0.4
    assert found.evidence.sum() == pytest.approx(found.evidence[k], abs=0.05)
    assert 0.8 < found.area_m2[k] < 1.4


def test_what_hangs_before_a_surface_does_not_stand_on_it() -> None:
    above = Box(THING.center + np.array([0, 0, 0.25]), THING.size, THING.rotation)
    assert areas(depth_of(TABLE, above)).evidence.sum() < 0.02


def test_what_goes_on_beyond_the_size_of_an_object_stands_on_nothing() -> None:
    assert (
        areas(depth_of(upright((0, 0), (4, 4, 0.05), z=-0.05), upright((0, 0.5), (3, 0.2, 0.3)))).evidence.sum() < 0.02
    )


def test_an_image_without_depth_has_no_flat_areas() -> None:
    found = areas(np.zeros((CAMERA.height, CAMERA.width), np.float32))
    assert found.normal.shape == (0, 3)
    assert len(found.area_m2) == len(found.evidence) == 0


def test_from_above_things_stand_on_the_area_that_surrounds_them() -> None:
    pose = look_at((0.0, 1e-3, 1.0), (0, 0, 0))
    table = upright((0, 0), (4.0, 4.0, 0.05), z=-0.05)
    cap, body = upright((0.0, 0.0), (0.04, 0.04, 0.25)), upright((0.0, 0.0), (0.08, 0.08, 0.2))
    depth_m = cast([table, cap, body], pose)[0].astype(np.float32)
    found = areas(depth_m)
    k = int(np.argmax(found.evidence))
    assert found.normal[k] @ pose[:3, :3].T @ [0, 0, 1] > 0.999
    assert found.evidence[k] > 0.1
    # A thing that the image border cuts off may be held there.
    beside = upright((0.0, 0.0), (0.2, 6.0, 0.2))
    assert areas(cast([table, beside], pose)[0].astype(np.float32)).evidence.sum() == 0.0


def test_from_above_things_in_contact_are_surrounded_together() -> None:
    pose = look_at((0.0, 1e-3, 1.0), (0, 0, 0))
    table = upright((0, 0), (4.0, 4.0, 0.05), z=-0.05)
    left, right = upright((-0.061, 0.0), (0.12, 0.2, 0.1)), upright((0.061, 0.0), (0.12, 0.2, 0.1))
    depth_m, hit = cast([table, left, right], pose)
    # the edges have no readings, as with stereo or time of flight
    depth_m[:, 1:][hit[:, 1:] != hit[:, :-1]] = 0.0
    depth_m[:, :-1][hit[:, 1:] != hit[:, :-1]] = 0.0
    found = areas(depth_m.astype(np.float32))
    assert found.evidence.max() > 0.5
