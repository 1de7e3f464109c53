from __future__ import annotations

import csv
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cuboid.ground.core.errors import InputError
from cuboid.ground.core.frame import Frame
from cuboid.ground.core.results import FrameResult, MapPoints, ObjectEvent, TrackedObject
from cuboid.ground.formats.folder import AGENTS, EVENTS
from cuboid.ground.geometry.box import Box
from cuboid.results.files import (
    LimitReached,
    ObjectsFile,
    Results,
    RunReport,
    Timing,
    read_map,
    read_objects,
    read_proposals,
    read_run,
    read_tracks,
    read_trajectory,
    write_map,
    write_objects,
    write_run,
)
from cuboid.results.files.rows import TRACKS_HEADER, PoseRow, ProposalRow, TrackRow, read_agents, read_events
from cuboid.runs.pipeline.options import RunHooks
from cuboid.runs.pipeline.run import track_recording
from fakes import INTRINSICS, FakeRecording, FakeTracker, box

RECT = np.array([1.0, 2.0, 11.5, 12.25])


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("results") / "out"
    track_recording(FakeRecording(4), path, hooks=RunHooks(make_tracker=FakeTracker))
    return path


def test_tracks_csv_is_what_the_contract_says(results: Path) -> None:
    header = "frame,timestamp,label,cx,cy,cz,length,width,height,qw,qx,qy,qz,iou,visible,x0,y0,x1,y1,probability"
    lines = (results / "tracks.csv").read_text().splitlines()
    assert lines[0] == header
    assert lines[1] == (
        "1,0.033333,1,0.000000,0.200000,1.000000,0.100000,0.200000,0.300000,"
        "0.894427191,0.000000000,0.000000000,0.447213595,,0.500000,1.00,2.00,11.50,12.25,0.700000"
    )
    rows = list(csv.DictReader(lines))
    assert [row["frame"] for row in rows] == ["1", "2", "3"]
    assert [row["iou"] for row in rows] == ["", "0.750000", "0.750000"]


def test_proposals_csv_is_what_the_contract_says(results: Path) -> None:
    header = "frame,timestamp,label,cx,cy,cz,length,width,height,qw,qx,qy,qz,score,x0,y0,x1,y1"
    lines = (results / "proposals.csv").read_text().splitlines()
    assert lines[0] == header
    assert [row["label"] for row in csv.DictReader(lines)] == ["0", "1", "1", "1"]
    proposal = read_proposals(results / "proposals.csv")[0]
    assert (proposal.frame, proposal.label, proposal.score) == (0, 0, 0.5)
    np.testing.assert_allclose(proposal.box.center, [0.01, 0.2, 1.0])


def test_trajectory_is_in_the_tum_form(results: Path) -> None:
    lines = (results / "trajectory.txt").read_text().splitlines()
    assert lines[2] == "0.066667 0.020000 0.000000 0.000000 0.000000000 0.000000000 0.000000000 1.000000000"
    assert len(lines) == 4


def test_objects_json_is_what_the_contract_says(results: Path) -> None:
    document = json.loads((results / "objects.json").read_text())
    assert list(document) == ["format", "version", "up", "intrinsics", "planes", "objects"]
    assert (document["format"], document["version"], document["up"]) == ("cuboid-objects", 1, [0.0, 0.0, 1.0])
    assert document["intrinsics"] == {"fx": 500.0, "fy": 500.0, "cx": 31.5, "cy": 23.5, "width": 64, "height": 48}
    assert list(document["planes"][0]) == ["normal", "offset", "extent"]
    assert document["objects"] == [
        {
            "label": 1,
            "center": [0.0, 0.2, 1.0],
            "size": [0.1, 0.2, 0.3],
            "rotation": [[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]],
            "score": 0.9,
            "probability": 0.9,
            "heat": 0.8,
            "first_frame": 1,
            "last_frame": 3,
            "frames_seen": 3,
            "points": 4,
            "mean_color": [10.0, 20.0, 30.0],
            "plane": 0,
            "merged_labels": [3, 4],
        }
    ]


def test_run_json_is_what_the_contract_says(results: Path) -> None:
    document = json.loads((results / "run.json").read_text())
    assert list(document) == [
        "version",
        "complete",
        "recording",
        "format",
        "poses",
        "threads",
        "config",
        "frames",
        "milliseconds",
        "seconds",
        "peak_memory_mb",
        "warnings",
        "limits",
    ]
    assert document["frames"] == {"read": 4, "used": 4, "skipped": []}
    assert list(document["milliseconds"]["frame"]) == ["median", "p95"]
    assert document["config"]["tracker"]["voxel_m"] == 0.01


def test_map_ply_is_read_by_another_library(results: Path) -> None:
    import trimesh

    cloud = trimesh.load(results / "map.ply")
    points = read_map(results / "map.ply")
    assert isinstance(cloud, trimesh.PointCloud)
    np.testing.assert_array_equal(np.asarray(cloud.vertices), points.xyz)
    np.testing.assert_array_equal(np.asarray(cloud.colors)[:, :3], points.rgb)
    np.testing.assert_array_equal(points.label, [1, 1, 1, 1])
    np.testing.assert_allclose(points.heat, np.linspace(0, 1, 4), rtol=1e-6)


def test_all_files_come_back_as_they_were_written(tmp_path: Path) -> None:
    tracker = FakeTracker(INTRINSICS)
    recording = FakeRecording(3)
    for i in range(3):
        tracker.update(recording.read(i))
    content = ObjectsFile(None, INTRINSICS, tuple(tracker.planes), tuple(tracker.objects))
    write_objects(tmp_path / "objects.json", content)
    back = read_objects(tmp_path / "objects.json")
    assert (back.up, back.intrinsics, back.objects[0].merged_labels) == (None, INTRINSICS, (3, 4))
    np.testing.assert_array_equal(back.objects[0].box.rotation, box().rotation)
    np.testing.assert_array_equal(back.planes[0].extent, tracker.planes[0].extent)
    timings = {"frame": Timing(1.5, 2.5)}
    report = RunReport(
        "0.1.0",
        False,
        "r",
        "tum",
        "given",
        1,
        {"a": 1},
        3,
        2,
        ((1, "bad"),),
        timings,
        1.5,
        99.5,
        ("odd",),
        {"clusters": LimitReached(100, 2, 345)},
    )
    write_run(tmp_path / "run.json", report)
    assert read_run(tmp_path / "run.json") == report


def test_rows_come_back_as_they_were_written(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        rotation[:, 0] *= np.linalg.det(rotation)
        some = Box(rng.normal(size=3), rng.uniform(0.1, 1, 3), rotation)
        T_world_camera = np.eye(4)
        T_world_camera[:3, :3], T_world_camera[:3, 3] = rotation, some.center
        track = TrackRow(12, some, 0.25, 1.0, RECT, 7, 1305031102.175304, probability=0.625)
        (tmp_path / "tracks.csv").write_text(f"{TRACKS_HEADER}\n{track.line()}\n")
        (tmp_path / "trajectory.txt").write_text(PoseRow(0.5, T_world_camera).line() + "\n")
        back = read_tracks(tmp_path / "tracks.csv")[0]
        assert (back.frame, back.timestamp_s, back.label, back.iou) == (7, 1305031102.175304, 12, 0.25)
        assert back.probability == 0.625
        np.testing.assert_allclose(back.box.rotation, rotation, atol=1e-8)
        np.testing.assert_allclose(back.box.center, some.center, atol=1e-6)
        pose = read_trajectory(tmp_path / "trajectory.txt")[0]
        np.testing.assert_allclose(pose.T_world_camera, T_world_camera, atol=1e-6)


def test_results_of_an_older_version_have_no_probability_in_frames(results: Path, tmp_path: Path) -> None:
    lines = (results / "tracks.csv").read_text().splitlines()
    (tmp_path / "tracks.csv").write_text("".join(line.rpartition(",")[0] + "\n" for line in lines))
    rows = read_tracks(tmp_path / "tracks.csv")
    assert [(row.frame, row.probability) for row in rows] == [(1, None), (2, None), (3, None)]
    np.testing.assert_array_equal(rows[0].rect_xyxy, read_tracks(results / "tracks.csv")[0].rect_xyxy)
    document = json.loads((results / "objects.json").read_text())
    del document["objects"][0]["probability"]
    (tmp_path / "objects.json").write_text(json.dumps(document))
    assert read_objects(tmp_path / "objects.json").objects[0].probability == 0.9


def test_no_negative_zero_is_written() -> None:
    still = Box(np.array([-1e-9, -0.0, 0.0]), np.ones(3), np.eye(3))
    assert "-0.0" not in ProposalRow(0, still, 0.0, RECT, 0, -0.0).line()


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (lambda text: text.replace("frame,", "Frame,", 1), r"tracks.csv:1: expected the header"),
        (lambda text: text + "1,2,3\n", r"tracks.csv:5: expected 20 values, got 3"),
        (lambda text: text.replace("0.100000", "wide", 1), r"tracks.csv:2: length: expected a number"),
        (lambda text: text.replace("0.100000", "nan", 1), r"tracks.csv:2: length: expected a finite number"),
    ],
)
def test_a_malformed_line_is_named(results: Path, tmp_path: Path, change: object, complaint: str) -> None:
    assert callable(change)
    path = tmp_path / "tracks.csv"
    path.write_text(change((results / "tracks.csv").read_text()))
    with pytest.raises(InputError, match=complaint):
        read_tracks(path)


@pytest.mark.parametrize(
    ("name", "content", "complaint"),
    [
        ("objects.json", "{", "is not JSON"),
        ("objects.json", "[]", "expected an object with format, version"),
        ("objects.json", '{"format": "other"}', "expected format 'cuboid-objects' version 1, got 'other'"),
        ("objects.json", '{"format": "cuboid-objects", "version": 1}', "field 'up' is missing"),
        ("run.json", "{}", "field 'version' is missing"),
        ("map.ply", "ply\nformat ascii 1.0\nend_header\n", "expected a binary PLY"),
    ],
)
def test_a_file_of_another_kind_is_one_line(tmp_path: Path, name: str, content: str, complaint: str) -> None:
    path = tmp_path / name
    read = {"objects.json": read_objects, "run.json": read_run, "map.ply": read_map}[name]
    with pytest.raises(InputError, match="cannot be read: No such file"):
        read(path)
    path.write_text(content)
    with pytest.raises(InputError, match=complaint):
        read(path)


def test_a_truncated_map_is_named(results: Path, tmp_path: Path) -> None:
    path = tmp_path / "map.ply"
    path.write_bytes((results / "map.ply").read_bytes()[:-5])
    with pytest.raises(InputError, match="expected 4 points"):
        read_map(path)


def test_an_empty_map_is_a_map(tmp_path: Path) -> None:
    nothing = np.zeros((0, 3), np.float32)
    write_map(tmp_path / "map.ply", MapPoints(nothing, np.zeros((0, 3), np.uint8), np.zeros(0, np.float32)))
    assert len(read_map(tmp_path / "map.ply").xyz) == 0


def test_points_are_counted_in_the_map_that_is_written() -> None:
    points = MapPoints(
        np.zeros((6, 3), np.float32),
        np.zeros((6, 3), np.uint8),
        np.zeros(6, np.float32),
        np.array([0, 2, 2, 1, 0, 2], np.int32),
    )
    thing = TrackedObject(1, box(), 0.9, 0.8, 0, 2, 3, 1234, np.zeros(3), None)
    known = [replace(thing, label=label) for label in (1, 2, 3)]
    assert [(item.label, item.points) for item in points.counted(known)] == [(1, 1), (2, 3), (3, 0)]
    nothing = MapPoints(points.xyz[:0], points.rgb[:0], points.heat[:0], points.label[:0])
    assert [item.points for item in nothing.counted(known)] == [0, 0, 0]


def test_no_nan_reaches_json(tmp_path: Path) -> None:
    content = ObjectsFile(np.array([math.nan, 0, 1]), INTRINSICS, (), ())
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_objects(tmp_path / "objects.json", content)


class SomebodyMoves(FakeTracker):
    """In frame 2 somebody moves, and object 1 is gone."""

    def update(self, frame: Frame, anchor: int = 0) -> FrameResult:
        result = super().update(frame, anchor)
        if frame.index != 2:
            return result
        gone = ObjectEvent("gone", 1, np.array([0.0, 0.2, 1.0]), None, 1.0)
        return replace(result, agents=(box(0.5), box(1.5)), events=(gone,))


def test_what_moves_has_files_of_its_own_only_where_something_does(results: Path, tmp_path: Path) -> None:
    assert not (results / EVENTS).exists()
    assert not (results / AGENTS).exists()
    track_recording(FakeRecording(4), tmp_path / "out", hooks=RunHooks(make_tracker=SomebodyMoves))
    agents = read_agents(tmp_path / "out" / AGENTS)
    assert [row.frame for row in agents] == [2, 2]
    for row, true in zip(agents, (box(0.5), box(1.5)), strict=True):
        np.testing.assert_allclose(row.box.corners(), true.corners(), atol=1e-6)
    assert [(row.frame, row.event, row.label) for row in read_events(tmp_path / "out" / EVENTS)] == [(2, "gone", 1)]
    assert Results(tmp_path / "out").agents[1].timestamp_s == agents[1].timestamp_s
    with (tmp_path / "out" / AGENTS).open("a") as file:
        file.write("9,0.3,0,0,0,1,1,1,1,0,0,0\n")
    with pytest.raises(InputError, match=r"agents.csv: frame 9 is not among the used frames"):
        assert Results(tmp_path / "out").agents
