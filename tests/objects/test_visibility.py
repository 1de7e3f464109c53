"""What a frame sees of an object: the rectangle reaches over all that nothing nearer hides, down to the foot."""

from __future__ import annotations

import numpy as np
import pytest

from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.observation import Observation
from cuboid.ground.core.working import WorkingImage
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.overlap import pack
from cuboid.method.objects.entry import MapObject
from cuboid.method.objects.visibility import Visibility, blended_rectangle, measure_visibility, places_in_view

CAMERA = Intrinsics(100.0, 100.0, 79.5, 59.5, 160, 120)
# A box of 20 x 20 x 20 cm, 1 m ahead, seen from the side; up is against the image's second axis.
UP = Box(np.array([0.0, 0.0, 1.0]), np.full(3, 0.2), np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]))
ROWS = {"top": 49.5, "middle": 59.5, "bottom": 69.5}


def seen(depth_m: np.ndarray, lowest_m: float) -> Visibility:
    """Return how the box is seen by a depth image when the map knows its front down to some height."""
    x, y = np.meshgrid(np.linspace(-0.1, 0.1, 21), np.linspace(-0.1, 0.1 - lowest_m, 21))
    points = np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)]).astype(np.float32)
    entry = MapObject(1, 0, 0, UP, points=points, colors=np.full((len(points), 3), 200, np.uint8))
    color = np.full((*depth_m.shape, 3), 90, np.uint8)
    image = WorkingImage(depth_m.astype(np.float32), color, CAMERA, 1, (0, 0))
    slots = np.full(depth_m.shape, -1, np.int32)
    observed = Observation(0, image, image, np.eye(4), None, 0, True, 0.0)
    return measure_visibility([entry], pack([entry.box]), observed, slots, np.zeros(1, np.int32), 0.0014)[0]


def test_what_stands_before_an_object_cuts_its_rectangle() -> None:
    depth_m = np.ones((120, 160))
    assert seen(depth_m, 0.0).rect_xyxy == pytest.approx([69.5, ROWS["top"], 90.5, ROWS["bottom"] + 1], abs=0.6)
    depth_m[60:] = 0.6
    hidden = seen(depth_m, 0.0)
    assert hidden.rect_xyxy == pytest.approx([69.5, ROWS["top"], 90.5, ROWS["middle"] + 1], abs=1.1)
    assert hidden.visible == pytest.approx(0.5, abs=0.06)


def test_a_foot_without_depth_belongs_to_the_rectangle_unless_it_is_hidden() -> None:
    depth_m = np.ones((120, 160))
    depth_m[60:] = 0.0
    assert seen(depth_m, 0.1).rect_xyxy[3] == pytest.approx(ROWS["bottom"] + 1, abs=1.1)
    depth_m[60:] = 0.6
    assert seen(depth_m, 0.1).rect_xyxy[3] == pytest.approx(ROWS["middle"] + 1, abs=1.1)


def test_what_the_frame_itself_shows_of_an_object_moves_its_rectangle_unless_it_is_another_one() -> None:
    rect = np.array([10.0, 10.0, 50.0, 40.0])
    assert blended_rectangle(rect, np.array([15.0, 10.0, 60.0, 50.0])) == pytest.approx([11.0, 10.0, 52.0, 42.0])
    assert blended_rectangle(rect, np.array([45.0, 10.0, 90.0, 40.0])) == pytest.approx(rect)
    assert blended_rectangle(rect, None) == pytest.approx(rect)


@pytest.mark.parametrize(
    ("reading_m", "in_view"),
    [(2.0, True), (1.0, True), (0.5, False), (0.0, False)],
    ids=["behind", "at", "before", "none"],
)
def test_the_place_of_an_object_is_in_view_unless_something_hides_it(reading_m: float, in_view: bool) -> None:
    image = WorkingImage(
        np.full((120, 160), reading_m, np.float32), np.zeros((120, 160, 3), np.uint8), CAMERA, 1, (0, 0)
    )
    beside = Box(UP.center + np.array([3.0, 0.0, 0.0]), UP.size, UP.rotation)
    behind = Box(-UP.center, UP.size, UP.rotation)
    entries = [MapObject(k, 0, 0, box) for k, box in enumerate((UP, beside, behind), 1)]
    observed = Observation(0, image, image, np.eye(4), None, 0, True, 0.0)
    found = places_in_view(entries, pack([entry.box for entry in entries]), observed)
    assert found == (entries[:1] if in_view else [])
    assert places_in_view([], np.empty((0, 15)), observed) == []
