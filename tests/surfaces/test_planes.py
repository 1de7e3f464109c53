"""Supporting planes: those in view are tracked as if there were no others."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.results import FrameResult
from cuboid.ground.core.tolerances import MIN_READINGS
from cuboid.ground.geometry import se3
from cuboid.ground.geometry.box import Box
from cuboid.method.surfaces.cells import Cells
from cuboid.method.surfaces.grid import GroundPlan, cells_of
from cuboid.method.surfaces.plane import Plane
from cuboid.method.surfaces.planes import PlaneTracker
from cuboid.method.surfaces.standing import FlatAreas
from cuboid.runs.tracking.posed_tracker import PosedTracker
from made_scenes import CAMERA, frame_of, look_at, upright

SCENE = [
    upright((0, 0), (8, 8, 0.1), z=-0.85),
    upright((0, 0), (1.4, 1.0, 0.05), z=-0.05),
    upright((-0.25, 0.1), (0.12, 0.08, 0.15), 0.4),
    upright((0.2, -0.1), (0.1, 0.1, 0.1), 0.2),
]
# A camera that is held upright and looks along y.
LEVEL = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


def level_cells(x: float, y: float, z: float = 0.0, side: int = 20) -> Cells:
    """A square of flat cells, 6 cm wide each."""
    i, j = (a.ravel() for a in np.mgrid[:side, :side])
    count = side * side
    return Cells(
        places=np.tile(np.arange(count)[:, None], (1, 4)),
        normal=np.tile([0.0, 0.0, 1.0], (count, 1)),
        center=np.column_stack([x + 0.06 * i, y + 0.06 * j, np.full(count, z)]),
        area_m2=np.full(count, 0.0036),
        sigma_m=np.full(count, 0.002),
        image_shape=(side, side),
    )


def facing(*normal: float) -> FlatAreas:
    """A flat area that faces some way in the world, on which half of all stands that a frame of `LEVEL` shows."""
    return FlatAreas(np.array([normal]) @ LEVEL[:3, :3], np.ones(1), np.full(1, 0.5))


def with_planes_elsewhere(count: int) -> PosedTracker:
    """A tracker that has seen planes at the table's own height, 40 m away and more, each 4 m from the next."""
    tracker = PosedTracker(CAMERA)
    tracker._T_world_map = np.eye(4)  # the planes below are those of the world
    for k in range(count):
        cells = level_cells(40.0 + 4.0 * (k % 12), 4.0 * (k // 12))
        tracker._planes.vote_up(facing(0, 0, 1), LEVEL)
        tracker._planes.update(0, cells)
    assert len(tracker.planes) == count
    return tracker


def follow(tracker: PosedTracker) -> list[FrameResult]:
    angles = np.linspace(-0.6, 0.6, 24) - np.pi / 2
    poses = [look_at((1.3 * np.cos(a), 1.3 * np.sin(a), 0.8), (0, 0, 0.05)) for a in angles]
    return [tracker.update(frame_of(SCENE, T, k)) for k, T in enumerate(poses)]


def test_planes_elsewhere_change_nothing_however_many_there_are() -> None:
    few, many = with_planes_elsewhere(1), with_planes_elsewhere(137)
    far = [(plane.weight, plane.frames, plane.plan.seen.copy()) for plane in many._planes.planes]
    for one, other in zip(follow(few), follow(many), strict=True):
        np.testing.assert_array_equal(one.heat, other.heat)
        assert [s.label for s in one.sightings] == [s.label for s in other.sightings]
        assert all(
            np.array_equal(a.box.corners(), b.box.corners())
            for a, b in zip(one.proposals, other.proposals, strict=True)
        )
    assert [o.label for o in few.objects] == [1, 2]
    for one, other in zip(few.objects, many.objects, strict=True):
        np.testing.assert_array_equal(one.box.corners(), other.box.corners())
        assert one.score == other.score
        assert one.plane is not None
        assert other.plane == one.plane + 136 > 127
    for one, other in zip(few.planes[1:], many.planes[137:], strict=True):
        np.testing.assert_array_equal(one.extent, other.extent)
        assert one.offset == other.offset
    for plane, (weight, frames, seen) in zip(many._planes.planes, far, strict=False):
        assert (plane.weight, plane.frames) == (weight, frames)
        np.testing.assert_array_equal(plane.plan.seen, seen)


def test_a_frame_has_to_do_with_the_planes_in_view_alone() -> None:
    tracker = with_planes_elsewhere(40)
    follow(tracker)
    pose = look_at((0, -1.3, 0.8), (0, 0, 0.05))
    view = tracker._planes.planes_in_frustum(CAMERA, 3.0, pose)
    assert [plane.index for plane in view.planes] == view.numbers.tolist()
    assert min(view.numbers) >= 40
    assert view.ground.shape[1] * view.ground.shape[2] < 200 * 200


def test_two_planes_that_prove_to_be_one_are_merged_and_others_keep_their_places() -> None:
    planes = PlaneTracker(TrackerConfig())
    places = [(0.0, 0.0), (20.0, 0.0), (2.2, 0.0), (40.0, 0.0)]
    for frame, (x, y) in enumerate(places):
        planes.vote_up(facing(0, 0, 1), LEVEL)
        planes.update(frame, level_cells(x, y))
    assert [p.index for p in planes.planes] == [0, 1, 2, 3]
    first, gone = planes.planes[0], planes.planes[2]
    assert planes.planes[1].in_use
    # A frame between the two shows that the first one goes on as far as the third.
    view = planes.planes_in_frustum(CAMERA, 3.0, look_at((1.7, -1.0, 1.2), (1.7, 0.6, 0.0)))
    assert view.numbers.tolist() == [0, 2]
    cells = cells_of(planes.to_plan(level_cells(1.1, 0.0).center)) - view.window[:2]
    view.seen[0, cells[:, 0], cells[:, 1]] = MIN_READINGS
    planes.add_readings(view)
    weight = first.weight + gone.weight
    for frame in range(4, 20):
        planes.update(frame, level_cells(20.0, 0.0))
    assert [p.index for p in planes.planes] == [0, 1, 2]
    assert gone.index == -1
    assert planes.planes[0] is first
    assert first.weight == pytest.approx(weight)
    assert planes.planes[0].plan.covers(planes.to_plan(np.array([[0.5, 0.5, 0.0], [3.0, 0.5, 0.0]]))).all()
    assert planes.planes[2].plan.covers(planes.to_plan(np.array([[40.5, 0.5, 0.0]]))).all()


def test_what_was_seen_once_and_is_too_small_is_forgotten_and_a_table_is_not() -> None:
    planes = PlaneTracker(TrackerConfig())
    planes.vote_up(facing(0, 0, 1), LEVEL)
    planes.update(0, level_cells(0, 0))
    planes.update(1, level_cells(10, 0, side=4))
    for frame in range(2, 80):
        planes.update(frame, level_cells(20, 0))
        if frame == 60:
            assert len(planes.planes) == 3
    assert len(planes.planes) == 2
    assert all(plane.in_use for plane in planes.planes)


def test_identities_are_never_given_twice_and_lead_to_the_plane_that_took_one_in() -> None:
    planes = PlaneTracker(TrackerConfig())
    for frame, (x, y) in enumerate([(0.0, 0.0), (20.0, 0.0), (2.2, 0.0)]):
        planes.vote_up(facing(0, 0, 1), LEVEL)
        planes.update(frame, level_cells(x, y))
    first, far, gone = planes.planes
    assert len({p.identity for p in planes.planes}) == 3
    view = planes.planes_in_frustum(CAMERA, 3.0, look_at((1.7, -1.0, 1.2), (1.7, 0.6, 0.0)))
    assert view.identities.tolist() == [first.identity, gone.identity]
    cells = cells_of(planes.to_plan(level_cells(1.1, 0.0).center)) - view.window[:2]
    view.seen[0, cells[:, 0], cells[:, 1]] = MIN_READINGS
    planes.add_readings(view)
    for frame in range(3, 20):
        planes.update(frame, level_cells(20.0, 0.0))
    assert planes.find(gone.identity) is first
    assert planes.find(first.identity) is first
    assert planes.planes[1] is far, "its place has changed"
    assert planes.find(far.identity) is far
    assert planes.find(-1) is None
    assert {id(plane) for plane in planes._of.values()} == {id(plane) for plane in planes.planes}, "none is kept beside"
    for frame in range(20, 24):
        planes.update(frame, level_cells(60.0, 0.0))
    assert planes.planes[-1].identity not in {first.identity, far.identity, gone.identity}


def test_no_plane_outlives_a_change_of_up() -> None:
    planes = PlaneTracker(TrackerConfig())
    cells = level_cells(0.0, 0.0)
    assert planes.vote_up(facing(0, 0, 1), LEVEL)
    planes.update(0, cells)
    old = planes.planes[0].identity
    assert planes.find(old) is not None
    turned = Cells(
        cells.places,
        np.tile([0.0, -1.0, 0.0], (len(cells.normal), 1)),
        cells.center[:, [0, 2, 1]],
        cells.area_m2,
        cells.sigma_m,
        cells.image_shape,
    )
    assert any(planes.vote_up(facing(0, -1, 0), LEVEL) for _ in range(30)), "as much stands on what faces -y"
    assert planes.planes == []
    assert planes.find(old) is None
    planes.update(1, turned)
    assert planes.planes[0].identity != old


def test_planes_move_with_the_keyframes_that_saw_them_and_no_others() -> None:
    """A plane of which two keyframes saw a half each lies, once both have moved apart, between them."""
    tracker = PlaneTracker(TrackerConfig())
    tracker.T_plan_world = se3.exp(np.array([0, 0, 0, 0, 0, 0.3]))
    turn = tracker.T_plan_world[:3, :3]
    for frame, (keyframe, x, z) in enumerate([(1, 0.0, 0.0), (2, 0.3, 0.0), (3, 9.0, 0.5)]):
        cells = level_cells(x, 0.0, z)
        tracker.update(frame, dataclasses.replace(cells, center=cells.center @ turn), keyframe)
    one, other = tracker.planes
    assert one.keyframes.tolist() == [1, 2]
    still, readings = other.mean.copy(), other.plan.seen.copy()
    before, area_m2 = one.mean.copy(), one.plan.area_m2()
    tracker.apply_correction({1: se3.exp(np.array([0, 0, 0.1, 0, 0, 0])), 2: se3.exp(np.array([0, 0, 0.14, 0, 0, 0]))})
    np.testing.assert_allclose(one.mean - before, [0, 0, 0.12], atol=1e-9)
    assert one.normal[0] == pytest.approx(-0.021, rel=0.05)  # it tilts, as least squares have it
    assert one.plan.area_m2() == area_m2
    np.testing.assert_array_equal(other.mean, still)
    np.testing.assert_array_equal(other.plan.seen, readings)
    back = {k: se3.exp(np.array([0, 0, -z, 0, 0, 0])) for k, z in ((1, 0.1), (2, 0.14))}
    scatter = one.scatter.copy()
    tracker.apply_correction(back)
    np.testing.assert_allclose(one.mean, before, atol=1e-9)
    assert np.abs(one.normal - [0, 0, 1]).max() < 1e-6
    assert abs(one.scatter[2, 2]) < 1e-3 * scatter[2, 2]


def test_a_correction_finds_nothing_anew_of_what_many_wide_planes_cover(monkeypatch: pytest.MonkeyPatch) -> None:
    """35 planes over one another with windows of 3,500 cells a side, as a sensor gone mad sees them."""
    rng = np.random.default_rng(11)
    tracker = PlaneTracker(TrackerConfig())
    tracker.T_plan_world = np.eye(4)
    for k in range(35):
        plane = Plane(index=k, identity=k, in_use=True)
        ground = np.column_stack([rng.uniform(-80, 80, (90, 2)), rng.normal(k, 0.01, 90)])
        plane.add(ground, np.ones(len(ground)), 1 + k % 8)
        plane.fit()
        plane.plan.begin(ground, np.full(len(ground), 0.02), 1 + k % 8)
        tracker.planes.append(plane)
        tracker._windows.update(plane)
    before = [plane.plan.places.copy() for plane in tracker.planes]
    refreshed: list[GroundPlan] = []
    monkeypatch.setattr(GroundPlan, "refresh", lambda plan, *_: refreshed.append(plan))
    for _ in range(3):
        tracker.apply_correction({k: se3.exp(rng.normal(0, 0.02, 6)) for k in range(1, 9)})
    assert refreshed == []
    assert all(plane.plan.wide and plane.plan.late for plane in tracker.planes), "what they cover comes in its turn"
    moved = [not np.array_equal(plane.plan.places, old) for plane, old in zip(tracker.planes, before, strict=True)]
    assert all(moved)


def test_what_reaches_up_to_a_plane_carries_it_and_what_stands_on_it_or_below_does_not() -> None:
    planes, cells = PlaneTracker(TrackerConfig()), level_cells(0.0, 0.0, z=0.7)
    planes.vote_up(facing(0, 0, 1), LEVEL)
    planes.update(0, cells)
    assert planes.T_plan_world is not None
    R = planes.T_plan_world[:3, :3]

    def has_plane_on_top(bottom_m: float, top_m: float, x: float = 0.6) -> bool:
        center = np.array([x, 0.6, 0.7 + (bottom_m + top_m) / 2])
        return planes.has_plane_on_top(Box(center, np.array([0.06, 0.06, top_m - bottom_m]), R.T))

    assert has_plane_on_top(-0.7, -0.1), "a leg, the upper end of which the board hides"
    assert has_plane_on_top(-0.7, 0.02), "the side of a shelf"
    assert not has_plane_on_top(0.0, 0.05), "a book"
    assert not has_plane_on_top(-0.7, -0.3), "a bin beneath"
    assert not has_plane_on_top(-0.7, 0.4), "a lamp"
    assert not has_plane_on_top(-0.7, -0.1, x=3.0)

    def is_extended_by_plane(top_m: float, width_m: float) -> bool:
        size = np.array([width_m, width_m, 0.7 + top_m])
        return planes.is_extended_by_plane(Box(np.array([0.6, 0.6, size[2] / 2]), size, R.T))

    assert is_extended_by_plane(0.02, 0.06), "the side of a shelf"
    assert not is_extended_by_plane(-0.1, 0.06), "a bin beneath"
    assert not is_extended_by_plane(0.0, 1.2), "a crate, the lid of which is the plane"


def test_planes_that_are_known_well_are_looked_at_anew_when_the_camera_has_moved() -> None:
    tracker, looks = PosedTracker(CAMERA), []
    ways_m = np.concatenate([np.zeros(12), np.linspace(0.0, 0.09, 19)])
    for k, way_m in enumerate(ways_m):
        result = tracker.update(frame_of(SCENE, look_at((way_m, -1.3, 0.8), (way_m, 0, 0.05)), k))
        looks.append(max(plane.frames for plane in tracker._planes.planes))
    # Each frame until a plane is known well, then one in 30 mm: three in 90.
    assert looks[:8] == list(range(1, 9))
    assert looks[11] == 8
    assert looks[-1] in {10, 11}
    assert len(tracker.planes) >= 1
    assert len(result.sightings) >= 1


def test_what_a_frame_shows_of_a_plane_is_told_as_the_planes_from_the_next_one_on() -> None:
    """However many frames have seen it: in a recording of few frames a table's other end is seen in two or three."""
    planes = PlaneTracker(TrackerConfig())
    for frame in range(18):
        planes.vote_up(facing(0, 0, 1), LEVEL)
        planes.update(frame, level_cells(0.0, 0.0))
    end = planes.to_plan(np.array([[1.5, 0.6, 0.0]]))
    assert not planes.planes[0].plan.covers(end)[0]
    view = planes.planes_in_frustum(CAMERA, 3.0, look_at((1.7, -1.0, 1.2), (1.7, 0.6, 0.0)))
    cells = cells_of(planes.to_plan(level_cells(1.1, 0.0).center)) - view.window[:2]
    view.seen[0, cells[:, 0], cells[:, 1]] = MIN_READINGS
    planes.add_readings(view)
    planes.update(18, level_cells(0.0, 0.0))
    assert planes.planes[0].plan.covers(end)[0]
