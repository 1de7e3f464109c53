"""Queries of finished results, a running tracker and a scene: the same questions, the same answers."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import cuboid
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.results import MapPoints, SupportPlane
from cuboid.ground.geometry.box import Box
from cuboid.results.files import ObjectsFile, ResultWriter, read_objects, write_objects
from cuboid.results.files.queries import MapQueries
from cuboid.results.files.report import RunReport
from cuboid.results.files.rows import AgentRow, EventRow, PoseRow
from made_results import FRAMES, SEEN, SKIPPED, box, camera, made_objects, write_results

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "scene"))
from made_scene import CAMERA, Shown, record


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> cuboid.Results:
    return cuboid.open_results(str(write_results(tmp_path_factory.mktemp("made"))))


def labels(objects: cuboid.ObjectTable) -> list[int]:
    return [item.label for item in objects]


def test_objects_planes_and_up_are_those_of_the_files(results: cuboid.Results) -> None:
    assert labels(results.objects) == [1, 2, 3]
    assert results.objects.find(4).label == 1, "4 was merged into 1"
    assert [plane.offset for plane in results.planes] == [0.0]
    assert results.up is not None
    assert results.up.tolist() == [0, 0, 1]
    assert "<table>" in results._repr_html_()


def test_a_cloud_has_the_points_of_one_object_and_is_saved(results: cuboid.Results, tmp_path: Path) -> None:
    cloud = results.cloud(2)
    assert (cloud.xyz.dtype, cloud.rgb.dtype, len(cloud)) == (np.float32, np.uint8, 14**3)
    assert (cloud.rgb == (40, 200, 40)).all()
    assert max(box(2).distance_m(point) for point in cloud.xyz) < 1e-6
    assert np.array_equal(results.cloud(4).xyz, results.cloud(1).xyz), "4 was merged into 1"
    cloud.save(str(tmp_path / "cup.ply"))
    head, body = (tmp_path / "cup.ply").read_bytes().split(b"end_header\n", 1)
    rows = np.frombuffer(body, [("xyz", "<f4", 3), ("rgb", "u1", 3)])
    assert b"element vertex 2744\nproperty float x" in head
    assert np.array_equal(rows["xyz"], cloud.xyz)
    assert np.array_equal(rows["rgb"], cloud.rgb)
    with pytest.raises(cuboid.OutputError, match=r"ends in \.ply"):
        cloud.save(tmp_path / "cup.pcd")


def test_near_orders_by_the_distance_to_the_boxes(results: cuboid.Results) -> None:
    # From the middle of the plane: box 3 is 0.25 m away, box 1 0.2 m, box 2 0.225 m and a little.
    assert labels(results.near((0, 0, 0.05), within_m=0.24)) == [1, 2]
    assert labels(results.near(np.zeros(3), within_m=5)) == [1, 2, 3]
    assert labels(results.near([-0.3, 0.0, 0.1], within_m=0)) == [1], "inside of a box is at distance 0"


def test_on_lists_the_objects_of_a_plane(results: cuboid.Results) -> None:
    assert labels(results.on(0)) == [1, 2, 3]


def test_wrong_questions_are_one_line(results: cuboid.Results, tmp_path: Path) -> None:
    questions: list[tuple[Callable[[], object], str]] = [
        (lambda: results.cloud(7), "no object has the label 7; expected one of 1, 2, 3"),
        (lambda: results.on(1), "there is no plane 1; expected 0 to 0"),
        (lambda: results.near((0, 0), 1), "expected a point as three finite numbers"),
        (lambda: results.near((0, 0, np.nan), 1), "expected a point as three finite numbers"),
        (lambda: results.near((0, 0, 0), -1), "expected a distance of at least 0 metres, got -1"),
        (lambda: results.sightings(label=9), "no object ever had the label 9"),
        (lambda: results.sightings(frame=40), "frame 40 is not among the frames that were read"),
        (lambda: cuboid.open_results(tmp_path / "nowhere"), "expected a folder with the results"),
        (lambda: cuboid.open_results(tmp_path), "holds no results"),
    ]
    for ask, said in questions:
        with pytest.raises(cuboid.InputError, match=said):
            ask()


def test_frames_say_what_became_of_each(results: cuboid.Results) -> None:
    assert [one.index for one in results.frames] == list(range(FRAMES))
    assert {one.index: one.reason for one in results.frames if one.state == "skipped"} == SKIPPED
    used = results.frames[8]
    assert (used.state, used.timestamp_s, used.reason) == ("used", pytest.approx(8 / 30, abs=1e-6), None)
    assert used.T_world_camera is not None
    assert np.allclose(used.T_world_camera, camera(8), atol=1e-5)
    assert results.frames[7].T_world_camera is None


def test_a_lost_camera_is_a_state_of_its_own(tmp_path: Path) -> None:
    folder = write_results(tmp_path)
    run = folder / "run.json"
    run.write_text(run.read_text().replace(SKIPPED[7], "the camera is lost: the frame shows no place that is known"))
    assert [(one.index, one.state) for one in cuboid.open_results(folder).frames if one.state != "used"] == [
        (7, "lost"),
        (23, "skipped"),
    ]


def test_sightings_by_label_and_by_frame(results: cuboid.Results) -> None:
    assert len(results.sightings()) == sum(len({*frames} - SKIPPED.keys()) for frames in SEEN.values())
    assert [seen.frame for seen in results.sightings(label=3)] == SEEN[3]
    assert [seen.frame for seen in results.sightings(label=5)] == SEEN[5], "a label that was retired"
    assert {seen.label for seen in results.sightings(label=1)} == {1, 4}, "with the labels merged into it"
    assert [seen.label for seen in results.sightings(frame=12)] == [1, 2, 4]
    assert results.sightings(label=3, frame=12) == results.sightings(frame=7) == []
    assert isinstance(results.sightings()[0], cuboid.Sighting)


def test_warnings_and_the_recording_are_there(results: cuboid.Results, tmp_path: Path) -> None:
    assert results.warnings == ()
    assert results.recording[8].color[0, 0].tolist() == [8, 100, 200]
    moved = cuboid.open_results(results.folder, recording=tmp_path / "moved")
    with pytest.raises(cuboid.InputError, match="moved"):
        _ = moved.recording


def test_names_are_written_where_there_are_any(tmp_path: Path) -> None:
    plain = ObjectsFile(None, cuboid.Intrinsics(1, 1, 0, 0, 2, 2), (), ())
    objects = tuple(replace(item, plane=None) for item in made_objects())
    write_objects(tmp_path / "plain.json", replace(plain, objects=objects))
    assert '"name"' not in (tmp_path / "plain.json").read_text()
    named = (replace(objects[0], name="my cup"), *objects[1:])
    write_objects(tmp_path / "named.json", replace(plain, objects=named))
    found = read_objects(tmp_path / "named.json").objects
    assert [item.name for item in found] == ["my cup", None, None]


def test_records_are_shown_in_a_line(results: cuboid.Results) -> None:
    item = replace(results.objects[0], name="my cup")
    said = "#1 my cup: 20.0 x 10.0 x 30.0 cm at -0.30, 0.00, 0.15 m; probability 0.60, seen in 29 frames"
    assert repr(item) == f"TrackedObject({said})"
    records = [
        item,
        item.box,
        results.planes[0],
        results.cloud(1),
        results.map_points(),
        results.frames[0],
        results.frames[7],
        results.sightings()[0],
        results,
        results.report,
        results.poses[2],
        cuboid.RunOutcome(results.report, (), (), None, {}, 1.0, 0, 0),
        cuboid.Proposals(np.zeros((0, 4), np.int32), np.zeros(0, np.float32)),
        cuboid.DepthCamera(500.0, 500.0, 320.0, 240.0, (640, 480), np.eye(4)),
        cuboid.Proposal3D(0, item.box, 0.5, np.zeros(4)),
        cuboid.Sighting(1, item.box, None, 1.0, np.zeros(4)),
    ]
    for one in records:
        assert len(repr(one).splitlines()) == 1, repr(one)
        assert "array(" not in repr(one)
    assert repr(results.objects).count("\n") == 3, "a line an object"


def test_the_table_has_names_and_integer_planes(results: cuboid.Results) -> None:
    named = replace(results.objects[0], name="<b>cup", plane=None)
    table = cuboid.ObjectTable([named, results.objects[1]])
    assert [(row["name"], row["plane"]) for row in table.rows()] == [("<b>cup", None), (None, 0)]
    assert "1 &lt;b&gt;cup" in table._repr_html_()
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    frame = table.to_pandas()
    assert frame["plane"].dtype == pandas.Int64Dtype()
    assert frame.loc[2, "plane"] == 0
    assert pandas.isna(frame.loc[1, "plane"])
    assert frame.loc[1, "name"] == "<b>cup"
    assert len(cuboid.ObjectTable().to_pandas()) == 0


@pytest.fixture(scope="module")
def asked(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, MapQueries]]:
    """A made recording of two boxes on a table: as results, from the tracker that ran, and as a scene."""
    folder = tmp_path_factory.mktemp("three")
    shown = Shown()
    tracker = cuboid.Tracker(CAMERA, proposals=shown.proposals)
    with ResultWriter(folder / "results") as writer:
        for frame in shown.frames:
            writer.add(tracker.update(frame))
        finish(writer, tracker, len(shown.frames))
    record(folder / "made.cuboid", Shown())
    with cuboid.Scene.open(folder / "made.cuboid") as scene:
        yield {"results": cuboid.open_results(folder / "results"), "tracker": tracker, "scene": scene}


def finish(writer: ResultWriter, tracker: cuboid.Tracker, frames: int) -> None:
    report = cuboid.RunReport("1", True, "r", "made", "given", 1, {}, frames, frames, (), {}, 1.0, 1.0)
    points = tracker.map_points()
    found = ObjectsFile(tracker.up, tracker.intrinsics, tuple(tracker.planes), points.counted(tracker.objects))
    writer.finish(found, points, report)


@pytest.mark.parametrize("kind", ["results", "scene"])
def test_the_answers_are_those_of_the_tracker(asked: dict[str, MapQueries], kind: str) -> None:
    one, other = asked["tracker"], asked[kind]
    assert labels(one.objects) == labels(other.objects) == [1, 2]
    for a, b in zip(one.objects, other.objects, strict=True):
        assert (a.plane, a.first_frame, a.last_frame, a.frames_seen) == (
            b.plane,
            b.first_frame,
            b.last_frame,
            b.frames_seen,
        )
        assert np.allclose(a.box.center, b.box.center, atol=1e-5)
        assert np.allclose(a.box.size, b.box.size, atol=1e-5)
        assert np.array_equal(rows(one.cloud(a.label)), rows(other.cloud(a.label)))
    assert one.up is not None
    assert other.up is not None
    assert np.allclose(one.up, other.up, atol=1e-5)
    assert len(one.planes) == len(other.planes) >= 1
    for p, q in zip(one.planes, other.planes, strict=True):
        assert isinstance(q, SupportPlane)
        assert np.allclose([*p.normal, p.offset], [*q.normal, q.offset], atol=1e-5)
    place = one.objects[1].box.center
    assert labels(one.near(place, 0.01)) == labels(other.near(place, 0.01)) == [2]
    assert labels(one.near(place, 2.0)) == labels(other.near(place, 2.0)) == [2, 1]
    on = [labels(one.on(k)) for k in range(len(one.planes))]
    assert on == [labels(other.on(k)) for k in range(len(one.planes))]
    assert [1, 2] in on, "both stand on the table"


def test_wrong_questions_get_the_same_line(asked: dict[str, MapQueries]) -> None:
    for one in asked.values():
        with pytest.raises(cuboid.InputError, match="no object has the label 9; expected one of 1, 2"):
            one.cloud(9)


def test_a_scene_gives_names(asked: dict[str, MapQueries]) -> None:
    scene = asked["scene"]
    assert isinstance(scene, cuboid.Scene)
    scene.name(2, "red box")
    assert [item.name for item in scene.objects] == [None, "red box"]
    assert repr(scene.objects.find(2)).startswith("SceneObject(#2 red box: ")
    scene.name(2, "")


def test_a_scene_answers_with_what_was_committed_last(tmp_path: Path) -> None:
    path = tmp_path / "made.cuboid"
    record(path, Shown())
    with cuboid.Scene.open(path) as scene:
        before = len(scene.map_points().xyz)
        assert len(scene.cloud(2)) > 0
        with cuboid.Scene.open(path) as other:
            other.forget(2)
        assert [item.label for item in scene.objects] == [1]
        assert (scene.map_points().label != 2).all()
        record(path, Shown(begin=2.0))
        assert len(scene.map_points().xyz) > before


def test_a_scene_that_is_not_made_yet_is_empty(tmp_path: Path) -> None:
    with cuboid.Scene.open(tmp_path / "new.cuboid") as scene:
        assert (scene.objects, scene.planes, scene.up) == ([], (), None)
        assert isinstance(scene.map_points(), MapPoints)
        assert scene.near((0, 0, 0), 1) == []
        with pytest.raises(cuboid.InputError, match="expected none, since no plane is known"):
            scene.on(0)


def rows(cloud: cuboid.PointCloud) -> np.ndarray:
    """Points with colors in an order that does not depend on how the map stores them."""
    both = np.column_stack((cloud.xyz, cloud.rgb))
    return both[np.lexsort(both.T)]


def test_results_of_a_camera_have_the_frame_numbers_of_its_recording(tmp_path: Path) -> None:
    rig = cuboid.Results(tmp_path, tmp_path)  # a recording that cannot be opened
    lens = {key: [64.0, 64.0] for key in ("fx", "fy", "cx", "cy")} | {"width": [64, 64], "height": [48, 48]}
    config = {"rig": {"cameras": ["left", "right"], "sequence": [0, 1, 0, 1, 0], "recordings": ["a", "b"], **lens}}
    skipped = ((1, "no depth"), (2, "no pose"))
    rig.report = RunReport("1", True, "rig.json", "rig", "given", 1, config, 5, 3, skipped, {}, 1.0, 1.0)
    rig.poses = {k: PoseRow(k / 10, np.eye(4)) for k in (0, 3, 4)}
    rig.events = [EventRow("appeared", k, None, np.zeros(3), 1.0, k, k / 10) for k in (0, 3, 4)]
    rig.agents = [AgentRow(k, k / 10, Box(np.zeros(3), np.ones(3), np.eye(3))) for k in (3, 4)]
    left, right = rig.of_camera("left"), rig.of_camera("right")
    assert (left.report.skipped, right.report.skipped) == (((1, "no pose"),), ((0, "no depth"),))
    assert [frame.index for frame in left.frames] == [0, 1, 2]
    assert (left.report.frames_read, left.report.frames_used) == (3, 2)
    assert [(event.label, event.frame) for event in left.events] == [(0, 0), (3, 2), (4, 2)]
    assert [event.frame for event in right.events] == [1, 1, 1]
    assert ([row.frame for row in left.agents], [row.frame for row in right.agents]) == ([2], [1])
    with pytest.raises(InputError):
        _ = right.recording
