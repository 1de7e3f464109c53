"""Objects that only regions of color show: a sheet on a wall, which no depth parts from it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from cuboid import Frame, FrameResult, Intrinsics, TrackerConfig
from cuboid.ground.core.observation import Observation
from cuboid.ground.core.working import WorkingImage, thin
from cuboid.method.objects import object_map
from cuboid.method.objects.by_regions import region_views
from cuboid.method.proposals.region_maps import ReducedFrame
from cuboid.method.proposals.types import Proposals
from cuboid.runs.tracking import posed_tracker
from cuboid.runs.tracking.posed_tracker import PosedTracker

CAMERA = Intrinsics(300.0, 300.0, 159.5, 119.5, 320, 240)
WALL_M = 1.5
# The sheet on the wall, metres: x0, y0, x1, y1.
SHEET_M = np.array([-0.15, -0.12, 0.15, 0.1])


def frame(index: int, x_m: float, *, sheet: bool = True) -> Frame:
    """A gray wall with a red sheet on it, before a camera that moves sideways."""
    rng = np.random.default_rng(index)
    v, u = np.mgrid[:240, :320]
    x, y = x_m + (u - CAMERA.cx) * WALL_M / CAMERA.fx, (v - CAMERA.cy) * WALL_M / CAMERA.fy
    color = np.full((240, 320, 3), 150.0)
    if sheet:
        x0, y0, x1, y1 = SHEET_M
        color[(x >= x0) & (x < x1) & (y >= y0) & (y < y1)] = (190.0, 40.0, 40.0)
    color += rng.normal(0.0, 3.0, color.shape)
    depth_m = (WALL_M + rng.normal(0.0, 0.002, (240, 320))).astype(np.float32)
    T_world_camera = np.eye(4)
    T_world_camera[0, 3] = x_m
    return Frame(index, index / 30.0, np.clip(color, 0, 255).astype(np.uint8), depth_m, T_world_camera)


def walk(tracker: PosedTracker, first: int, count: int, *, sheet: bool = True) -> list[FrameResult]:
    places_m = 0.12 * np.sin(np.arange(first, first + count) / 12.0)
    return [tracker.update(frame(first + k, x_m, sheet=sheet)) for k, x_m in enumerate(places_m.tolist())]


def sheet_rect(x_m: float) -> np.ndarray:
    """The rectangle of the sheet in a picture, pixels."""
    shifted = SHEET_M - [x_m, 0.0, x_m, 0.0]
    return shifted * CAMERA.fx / WALL_M + [CAMERA.cx, CAMERA.cy, CAMERA.cx, CAMERA.cy]


class RedRegions:
    """The region of the red pixels, four in five probable: as the source `regions`, with its choice known."""

    def __init__(self, config: TrackerConfig) -> None:
        pass

    def choose(self, reduced: ReducedFrame, by_depth: Proposals | None = None) -> Proposals:
        seen = reduced.frame
        red = (seen.color[..., 0].astype(int) - seen.color[..., 1]) > 60
        if not red.any():
            return Proposals(np.zeros((0, 4), np.int32), np.zeros(0, np.float32), [])
        v, u = np.nonzero(red)
        rect = np.array([[u.min(), v.min(), u.max() + 1, v.max() + 1]], np.int32)
        mask = red[rect[0, 1] : rect[0, 3], rect[0, 0] : rect[0, 2]].astype(np.uint8)
        return Proposals(rect, np.full(1, 0.8, np.float32), [mask])


@pytest.fixture(autouse=True, scope="module")
def red_regions() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(posed_tracker, "RegionSource", RedRegions)
        yield


@pytest.fixture(scope="module")
def tracked() -> tuple[PosedTracker, list[FrameResult]]:
    tracker = PosedTracker(CAMERA)
    return tracker, walk(tracker, 0, 60)


def test_a_sheet_on_a_wall_gets_one_label_and_its_place(tracked: tuple[PosedTracker, list[FrameResult]]) -> None:
    tracker, results = tracked
    (found,) = tracker.objects
    assert np.abs(found.box.center - [0.0, -0.01, WALL_M]).max() < 0.02
    assert sorted(found.box.size)[1:] == pytest.approx([0.22, 0.30], abs=0.03)
    assert found.score >= TrackerConfig().region_probability
    assert {s.label for result in results for s in result.sightings} == {found.label}
    late = results[-1]
    (sighting,) = late.sightings
    assert np.abs(sighting.rect_xyxy - sheet_rect(float(late.T_world_camera[0, 3]))).max() < 8.0


def test_one_view_is_not_enough_for_a_label(tracked: tuple[PosedTracker, list[FrameResult]]) -> None:
    _, results = tracked
    assert not results[0].sightings


def test_a_sheet_that_is_taken_away_is_no_object_any_more() -> None:
    tracker = PosedTracker(CAMERA)
    walk(tracker, 0, 60)
    assert len(tracker.objects) == 1
    late = walk(tracker, 60, 120, sheet=False)
    assert not tracker.objects
    assert not late[-1].sightings


def test_objects_of_regions_can_be_switched_off() -> None:
    tracker = PosedTracker(CAMERA, TrackerConfig(region_probability=1.0))
    walk(tracker, 0, 60)
    assert not tracker.objects


def test_a_tracker_that_continues_from_a_state_keeps_the_label() -> None:
    whole = PosedTracker(CAMERA)
    walk(whole, 0, 60)
    (before,) = whole.objects
    saved = whole.state().unread
    (kept,) = [entry for entry in saved if entry.label]
    assert (kept.label, kept.by_regions, kept.score) == (before.label, True, before.score)


def observed(owner_pixels: int) -> tuple[Observation, np.ndarray]:
    """A frame of the wall, and an owner of the left `owner_pixels` columns of a region of 80 x 60."""
    image: WorkingImage = thin(frame(0, 0.0), CAMERA, 320, 0)
    seen = Observation(0, image, image, np.eye(4), None, 0, new_viewpoint=True, weight=1.0)
    owner = np.zeros((240, 320), np.int32)
    owner[60:120, 100 : 100 + owner_pixels] = 7
    return seen, owner


def test_the_owner_of_half_of_the_pixels_of_a_region_is_its_rival() -> None:
    found = Proposals(np.array([[100, 60, 180, 120]], np.int32), np.ones(1, np.float32), [np.ones((60, 80), np.uint8)])
    seen, owner = observed(60)
    up = np.array([0.0, -1.0, 0.0])
    views = region_views(found, owner, seen, [7], up)
    assert views.rivals == [(7,)]  # all of the object lies in the region
    assert views.depth_m == pytest.approx([WALL_M], abs=0.002)
    owner[:, :] = np.where(owner == 7, 9, 0)
    assert region_views(found, owner, seen, [7], up).rivals == [()]  # its owner has no label
    owner[:, :] = 0
    owner[:, 140:] = 7
    assert region_views(found, owner, seen, [7], up).rivals == [(7,)]  # half of the region
    owner[:, 140:150] = 0
    assert region_views(found, owner, seen, [7], up).rivals == [()]


def two_boxes(index: int, x_m: float) -> Frame:
    """A red and a gray box side by side, without a gap, before a wall: depth shows one body."""
    rng = np.random.default_rng(index)
    v, u = np.mgrid[:240, :320]
    near_m = WALL_M - 0.15
    x, y = x_m + (u - CAMERA.cx) * near_m / CAMERA.fx, (v - CAMERA.cy) * near_m / CAMERA.fy
    body = (np.abs(x) < 0.16) & (np.abs(y) < 0.08)
    color = np.full((240, 320, 3), 150.0)
    color[body] = (90.0, 90.0, 90.0)
    color[body & (x < 0.0)] = (190.0, 40.0, 40.0)
    color += rng.normal(0.0, 3.0, color.shape)
    depth_m = np.where(body, near_m, WALL_M) + rng.normal(0.0, 0.002, (240, 320))
    T_world_camera = np.eye(4)
    T_world_camera[0, 3] = x_m
    return Frame(
        index, index / 30.0, np.clip(color, 0, 255).astype(np.uint8), depth_m.astype(np.float32), T_world_camera
    )


def walk_by_two_boxes(judged: float) -> tuple[PosedTracker, FrameResult]:
    """Track the two boxes, where the score of each object of the map is `judged`."""
    tracker = PosedTracker(CAMERA)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(object_map, "probability", lambda _: judged)
        results = [tracker.update(two_boxes(k, 0.12 * float(np.sin(k / 12.0)))) for k in range(60)]
    return tracker, results[-1]


def test_a_more_probable_region_replaces_the_object_that_owns_its_pixels() -> None:
    tracker, last = walk_by_two_boxes(0.6)
    (found,) = tracker.objects
    assert sorted(found.box.size)[1:] == pytest.approx([0.16, 0.16], abs=0.03)  # the red box alone
    (sighting,) = last.sightings
    assert sighting.label == found.label
    (body,) = tracker.ever_labelled()  # not reported
    assert body.label != found.label


def test_a_region_that_is_not_clearly_more_probable_changes_nothing() -> None:
    tracker, last = walk_by_two_boxes(0.75)
    (found,) = tracker.objects
    assert max(found.box.size) > 0.28  # both boxes
    assert [s.label for s in last.sightings] == [found.label]
