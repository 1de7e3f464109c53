"""What changed between two visits: told from free space seen, and never from what was hidden."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_scene import CAMERA, Shown, record

from browser import OpenPage
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.frame import Frame
from cuboid.method.proposals.types import Proposals
from cuboid.results.files import Results
from cuboid.results.views.report import summarise, write_report
from cuboid.runs.scene import RecordingInfo, Scene
from made_scenes import CAMERA as TABLE_CAMERA
from made_scenes import frame_of, look_at, upright

ONE = ((-0.25, 0.05), (0.16, 0.12, 0.14))
TWO = ((0.2, 0.2), (0.12, 0.12, 0.2))
THREE = ((0.05, -0.12), (0.1, 0.1, 0.1))


def thing(
    place: tuple[tuple[float, float], tuple[float, float, float]], at: tuple[float, float] | None = None
) -> object:
    return upright(at or place[0], place[1], 0.2, z=0.48)


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "first.cuboid"
    record(path, Shown((thing(ONE), thing(TWO), thing(THREE)), frames=40))
    with Scene.open(path) as scene:
        assert [item.label for item in scene.objects] == [1, 2, 3]
        assert scene.changes() == []
    return path


def label_at(scene: Scene, place: tuple[float, float]) -> int:
    return scene.near([*place, 0.53], 0.1)[0].label


def told(scene: Scene) -> dict[int, str]:
    """Return the change of each object since the visit before."""
    return {change.label: change.change for change in scene.changes()}


def visited(first: Path, path: Path, shown: Shown) -> Scene:
    shutil.copy(first, path)
    record(path, shown, "again")
    return Scene.open(path)


def test_nothing_changed(first: Path, tmp_path: Path) -> None:
    shown = Shown((thing(ONE), thing(TWO), thing(THREE)), frames=30, begin=1.0)
    with visited(first, tmp_path / "s.cuboid", shown) as scene:
        assert [(one.label, one.change) for one in scene.changes()] == [(k, "unchanged") for k in (1, 2, 3)]


@pytest.fixture(scope="module")
def moved(first: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One is moved, two is gone, something tall is new."""
    path = tmp_path_factory.mktemp("scene") / "moved.cuboid"
    tall = upright((-0.3, 0.4), (0.07, 0.07, 0.3), 0.0, z=0.48)
    visited(first, path, Shown((thing(ONE, (0.45, -0.1)), tall, thing(THREE)), frames=60, begin=0.4)).close()
    return path


def label_at_begin(scene: Scene, place: tuple[float, float]) -> int:
    return next(one.label for one in scene.changes(2) if one.from_m is not None and near(one.from_m, place))


def near(point: np.ndarray, place: tuple[float, float]) -> bool:
    return bool(np.linalg.norm(point[:2] - place) < 0.1)


def test_moved_gone_and_new(first: Path, moved: Path) -> None:
    with Scene.open(first) as scene:
        one, two, three = (label_at(scene, place[0]) for place in (ONE, TWO, THREE))
    with Scene.open(moved) as scene:
        changes = {change.label: change for change in scene.changes()}
        assert changes[three].change == "unchanged"
        assert changes[two].change == "gone"
        assert changes[two].to_m is None
        assert (changes[one].change, changes[one].sure > 0.2) == ("moved", True)
        assert changes[one].metres == pytest.approx(np.hypot(0.7, 0.15), abs=0.05)
        assert np.allclose(changes[one].to_m[:2], [0.45, -0.1], atol=0.05)
        assert changes[one].before[:2] == changes[one].after[:2] == b"\xff\xd8"
        (new,) = (change for change in changes.values() if change.change == "new")
        assert new.label > 3
        assert {item.label: item.state for item in scene.all_objects}[two] == "gone"
        assert label_at(scene, (0.45, -0.1)) == one
        assert {past.recording for past in scene.history(one)} == {1, 2}
        assert len(scene.changes(2)) == len(scene.changes("2020-01-01")) == len(changes)
        assert scene.changes("2999-01-01") == []
        with pytest.raises(InputError, match="expected a date"):
            scene.changes("yesterday")


def test_results_of_an_earlier_recording_do_not_tell_how_sure_later_boxes_are(moved: Path, tmp_path: Path) -> None:
    with Scene.open(moved) as scene:
        for number in (1, 2):
            scene.write_results(tmp_path / str(number), number)
    earlier, last = (Results(tmp_path / name).found.objects for name in "12")
    for item in earlier:
        assert (item.size_sigma_m, item.center_sigma_m, item.sides_seen) == ((), (), ())
    assert all(len(item.size_sigma_m) == 3 and item.sides_seen for item in last)


def test_the_page_shows_what_changed(open_page: OpenPage, moved: Path, tmp_path: Path) -> None:
    with Scene.open(moved) as scene:
        one, two = (label_at_begin(scene, place[0]) for place in (ONE, TWO))
        (new,) = (change.label for change in scene.changes() if change.change == "new")
        scene.write_results(tmp_path / "out")
        write_report(tmp_path / "page.html", summarise(Results(tmp_path / "out"), None, scene.shown_changes(2)))
    assert two not in [item.label for item in Results(tmp_path / "out").found.objects], "it is gone"
    page = open_page(tmp_path / "page.html")
    rows = page.locator("#changes .change")
    shown = [row.split("\n")[:2] for row in rows.all_inner_texts()]
    assert shown[1:] == [[f"#{two}", "gone"], [f"#{new}", "new"]]
    assert shown[0][0] == f"#{one}"
    assert shown[0][1].startswith("moved 7")
    rows.first.click()
    assert page.locator("#card h2").inner_text() == f"Object {one}"


def test_what_is_hidden_is_not_gone(first: Path, tmp_path: Path) -> None:
    screen = upright((0.75, 0.15), (0.05, 1.4, 1.6), 0.0, z=0.0)
    shown = Shown((thing(TWO), screen), frames=12)
    with visited(first, tmp_path / "s.cuboid", shown) as scene:
        changes = told(scene)
        assert "gone" not in changes.values()
        assert "not looked at" in changes.values()


def test_another_thing_in_its_place_is_another(first: Path, tmp_path: Path) -> None:
    other = upright(ONE[0], (0.32, 0.3, 0.3), 0.2, z=0.48)
    with Scene.open(first) as scene:
        one = label_at(scene, ONE[0])
    shown = Shown((other, thing(TWO), thing(THREE)), frames=60, begin=0.3)
    with visited(first, tmp_path / "s.cuboid", shown) as scene:
        assert label_at(scene, ONE[0]) != one
        assert told(scene)[one] == "gone"


def test_what_is_laid_where_another_stood_is_not_one_with_it(first: Path, tmp_path: Path) -> None:
    """One is pushed aside, three is laid between: both were moved, to where they are."""
    with Scene.open(first) as scene:
        one, two, three = (label_at(scene, place[0]) for place in (ONE, TWO, THREE))
    shown = Shown((thing(ONE, (-0.3, 0.21)), thing(TWO), thing(THREE, (-0.25, 0.06))), frames=60, begin=0.3)
    with visited(first, tmp_path / "s.cuboid", shown) as scene:
        assert told(scene) == {
            one: "moved",
            two: "unchanged",
            three: "moved",
        }
        for label, place in ((one, (-0.3, 0.21)), (three, (-0.25, 0.06))):
            (item,) = (item for item in scene.objects if item.label == label)
            assert np.linalg.norm(item.box.center[:2] - place) < 0.02


def test_pieces_that_went_together_are_one(tmp_path: Path) -> None:
    """What lies beside another thing before and after both were moved belongs to it."""

    def pieces(x: float, y: float) -> tuple[object, ...]:
        return upright((x, y), (0.14, 0.12, 0.14), z=0.48), upright((x + 0.1, y), (0.06, 0.12, 0.05), z=0.48)

    path = tmp_path / "s.cuboid"
    record(path, Shown((*pieces(-0.3, 0.05), thing(TWO)), frames=40))
    with Scene.open(path) as scene:
        assert len(scene.objects) == 3
        two = label_at(scene, TWO[0])
    record(path, Shown((*pieces(0.35, -0.05), thing(TWO)), frames=60, begin=0.3), "again")
    with Scene.open(path) as scene:
        changes = told(scene)
        assert changes.pop(two) == "unchanged"
        ((label, change),) = changes.items()
        assert change == "moved"
        ended = {item.label: item.merged_into for item in scene.all_objects}
        assert [ended[other] for other in (1, 2, 3) if other not in (label, two)] == [label]


def test_what_stood_there_without_a_label_is_not_new(tmp_path: Path) -> None:
    """A thing that proposals passed over in the first visit is found in the second one; it did not come."""
    things = (thing(ONE), thing(TWO), thing(THREE))
    shown = Shown(things, frames=40)
    passed_over = Passed(things, frames=40)
    record(tmp_path / "s.cuboid", passed_over)
    with Scene.open(tmp_path / "s.cuboid") as scene:
        assert len(scene.objects) == 2
    shutil.copy(tmp_path / "s.cuboid", tmp_path / "broken-off.cuboid")
    record(tmp_path / "s.cuboid", shown, "again")
    in_two(tmp_path / "broken-off.cuboid", shown, 20)
    for path in (tmp_path / "s.cuboid", tmp_path / "broken-off.cuboid"):
        with Scene.open(path) as scene:
            changes = told(scene)
            assert changes[label_at(scene, THREE[0])] == "found", path
            assert sorted(changes.values()) == ["found", "unchanged", "unchanged"]


def in_two(path: Path, shown: Shown, cut: int) -> None:
    """Let a recording go into a scene that is broken off, and gone on with from the last commit."""
    source = RecordingInfo("/again", "made", "given", len(shown.frames), CAMERA, {"every": 1})
    for resume in (False, True):
        with Scene.open(path) as scene:
            tracker = scene.tracker(
                CAMERA, proposals=shown.proposals, source=source, resume=resume, commit_every_s=1.0 if resume else 0.0
            )
            assert (tracker.visit.next_frame > 0) == resume
            for frame in shown.frames[tracker.visit.next_frame : None if resume else cut]:
                tracker.update(frame)
            if not resume:
                tracker.drop()


def test_a_visit_that_is_gone_on_with_tells_the_same(first: Path, moved: Path, tmp_path: Path) -> None:
    path = Path(shutil.copy(first, tmp_path / "s.cuboid"))
    tall = upright((-0.3, 0.4), (0.07, 0.07, 0.3), 0.0, z=0.48)
    in_two(path, Shown((thing(ONE, (0.45, -0.1)), tall, thing(THREE)), frames=60, begin=0.4), 33)
    with Scene.open(path) as scene, Scene.open(moved) as whole:
        told, expected = scene.changes(), whole.changes()
        assert [(one.label, one.change) for one in told] == [(one.label, one.change) for one in expected]
        for one, other in zip(told, expected, strict=True):
            np.testing.assert_array_equal(one.to_m, other.to_m)


def test_what_was_hidden_is_not_new(tmp_path: Path) -> None:
    """What stands behind another thing is found from the other side; it did not come."""
    tall, behind = (
        upright((0.0, 0.15), (0.1, 0.34, 0.3), 0.0, z=0.48),
        upright((-0.22, 0.15), (0.1, 0.1, 0.1), 0.0, z=0.48),
    )
    record(tmp_path / "s.cuboid", Shown((tall, behind), frames=9, begin=-0.24))
    with Scene.open(tmp_path / "s.cuboid") as scene:
        assert len(scene.objects) == 1
    record(tmp_path / "s.cuboid", Shown((tall, behind), frames=40, begin=2.5), "again")
    with Scene.open(tmp_path / "s.cuboid") as scene:
        changes = told(scene)
        assert changes[label_at(scene, (-0.22, 0.15))] == "found"
        assert "new" not in changes.values()


def test_what_is_thinner_than_the_ground_is_known_is_not_new(first: Path, tmp_path: Path) -> None:
    """A post may have stood where only the ground beside it was seen; a can that came stood nowhere before."""
    post, can = (
        upright(at, (side, side, 0.3), 0.0, z=0.48) for at, side in (((0.35, -0.1), 0.04), ((-0.3, 0.4), 0.08))
    )
    shown = Shown((thing(ONE), thing(TWO), thing(THREE), post, can), frames=40, begin=0.4)
    with visited(first, tmp_path / "s.cuboid", shown) as scene:
        changes = told(scene)
        assert changes[label_at(scene, (-0.3, 0.4))] == "new"
        assert changes[label_at(scene, (0.35, -0.1))] == "found"


class Passed(Shown):
    """Frames whose last thing has no proposals."""

    def proposals(self, frame: Frame, intrinsics: object) -> Proposals:
        all_of = super().proposals(frame, intrinsics)
        last = len(all_of) - 1
        return Proposals(all_of.boxes_xyxy[:last], all_of.scores[:last], all_of.masks[:last], all_of.mask_step)


def test_what_was_moved_between_visits_is_not_reported_as_gone_later(tmp_path: Path) -> None:
    """Both the visit's changes and the frames miss it in its old place; one of them gives its label to the new one."""
    floor, table = upright((0.0, 0.0), (6.0, 6.0, 0.02), z=-0.72), upright((0.0, 0.0), (1.2, 0.8, 0.7), z=-0.7)
    sizes = ((0.12, 0.12, 0.15), (0.2, 0.12, 0.08), (0.09, 0.09, 0.2))
    camera, seen = look_at((0.0, -1.1, 0.8), (0.0, 0.0, 0.0)), []
    for places, count in (((-0.4, 0.0, 0.3), 25), ((-0.2, 0.0, 0.3), 90)):
        boxes = [floor, table, *(upright((x, 0.0), size) for x, size in zip(places, sizes, strict=True))]
        with Scene.open(tmp_path / "place.cuboid") as scene, scene.tracker(TABLE_CAMERA) as tracker:
            results = [tracker.update(replace(frame_of(boxes, camera, k), timestamp_s=k / 10)) for k in range(count)]
            centers = {o.label: round(float(o.box.center[0]), 1) for o in tracker.objects}
        seen.append((centers, [(one.event, one.label) for result in results for one in result.events]))
    (before, _), (after, events) = seen
    assert sorted(before.values()) == [-0.4, 0.0, 0.3]
    moved = next(label for label, x in before.items() if x == -0.4)
    assert after == before | {moved: -0.2}
    assert "gone" not in {event for event, _ in events}
