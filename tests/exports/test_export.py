from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
import trimesh
from made_run import BOXES, CAMERA, FRAMES, SEEN
from pycocotools.coco import COCO
from rosbags.highlevel import AnyReader

from cuboid.cli import main
from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import InputError, OutputError
from cuboid.ground.core.palette import color_of
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.overlap import iou
from cuboid.ground.geometry.se3 import rotation_from_quat_wxyz
from cuboid.results.exports import EXPORTS, export
from cuboid.results.exports.kitti import in_camera, kitti_row
from cuboid.results.files import Results, TrackRow, read_map
from cuboid.results.files.objects import write_objects
from cuboid.results.files.rows import EVENTS_HEADER

OWN = ("boxer", "coco", "csv", "graphml", "json", "kitti", "mcap", "ply")
SUFFIXES = {name: form.suffix for name, form in EXPORTS.items()}


def load(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", OWN)
class TestAnyForm:
    def test_the_same_results_are_the_same_bytes(self, run: Results, tmp_path: Path, name: str) -> None:
        for folder in "ab":
            export(run, name, tmp_path / folder / f"out{SUFFIXES[name]}")
        one, two = (sorted(path for path in (tmp_path / folder).rglob("*") if path.is_file()) for folder in "ab")
        assert [path.read_bytes() for path in one] == [path.read_bytes() for path in two]
        assert one

    def test_what_lies_there_is_kept_without_force(self, run: Results, tmp_path: Path, name: str) -> None:
        output = tmp_path / f"out{SUFFIXES[name]}"
        if SUFFIXES[name]:
            output.write_text("mine")
        else:
            output.mkdir()
            (output / "notes.txt").write_text("mine")
            (output / "object_099.ply").write_text("of an earlier export")
        before = sorted(output.rglob("*"))
        with pytest.raises(OutputError, match="--force replaces"):
            export(run, name, output)
        assert sorted(output.rglob("*")) == before
        export(run, name, output, force=True)
        if SUFFIXES[name]:
            assert output.read_bytes() != b"mine"
        else:
            assert (output / "notes.txt").read_text() == "mine"
            assert not (output / "object_099.ply").exists()
            assert (output / "boxes.ply").exists()

    def test_a_fault_leaves_nothing(
        self, run: Results, tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def full(self: Path, *args: object, **options: object) -> int:
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(Path, "write_text", full)
        monkeypatch.setattr(Path, "write_bytes", full)
        (tmp_path / "there").mkdir()
        with pytest.raises(OutputError, match="the disk is full"):
            export(run, name, tmp_path / "there" / f"out{SUFFIXES[name]}")
        assert list((tmp_path / "there").iterdir()) == []

    def test_results_without_an_object_are_exported(self, run: Results, tmp_path: Path, name: str) -> None:
        document = load(run.folder / "objects.json")
        (run.folder / "objects.json").write_text(json.dumps({**document, "up": None, "planes": [], "objects": []}))
        header, *_ = (run.folder / "tracks.csv").read_text().splitlines()
        (run.folder / "tracks.csv").write_text(header + "\n")
        export(run, name, tmp_path / f"out{SUFFIXES[name]}")
        assert (tmp_path / f"out{SUFFIXES[name]}").exists()


def test_the_command_gives_a_file_the_suffix_of_its_format_and_says_so(
    run: Results, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for form, given, written in (("coco", "a.coco", "a.json"), ("kitti", "b.json", "b.txt"), ("ply", "c.ply", "c")):
        assert main(["export", str(run.folder), "--to", form, "--output", str(tmp_path / given)]) == 0
        assert f"{form} written to {tmp_path / written}" in capsys.readouterr().out
        assert (tmp_path / written).exists()


def test_wrong_calls_are_one_line(run: Results, tmp_path: Path, refused: Callable[..., str]) -> None:
    there = tmp_path / "out.json"
    assert "unknown export 'pdf'; there are: boxer, coco, csv," in refused(
        "export", run.folder, "--to", "pdf", "--output", there
    )
    assert "expected a folder with the results" in refused(
        "export", tmp_path / "none", "--to", "json", "--output", there
    )
    own = refused("export", run.folder, "--to", "json", "--output", run.folder / "objects.json", "--force")
    assert "belongs to the results themselves" in own
    assert "belongs to the results" in refused("export", run.folder, "--to", "ply", "--output", run.folder, "--force")
    with pytest.raises(OutputError, match=r"'coco' is a \.json file; name it .*out\.json$"):
        export(run, "coco", tmp_path / "out.coco")
    (run.folder / "tracks.csv").unlink()
    assert "tracks.csv: cannot be read" in refused("export", run.folder, "--to", "coco", "--output", there)
    assert not there.exists()


def test_files_of_a_rig_are_refused_before_one_is_written(tmp_path: Path) -> None:
    def run_of(*cameras: str) -> Any:
        report = SimpleNamespace(rig_cameras=[SimpleNamespace(name=camera) for camera in cameras])
        return SimpleNamespace(folder=tmp_path / "run", report=report)  # any use of its content is an AttributeError

    (tmp_path / "out-b.txt").write_text("mine")
    with pytest.raises(OutputError, match=r"out-b\.txt: exists"):
        export(run_of("a", "b"), "kitti", tmp_path / "out.txt")
    with pytest.raises(OutputError, match="'c:1' and 'c/1' would be written to one file"):
        export(run_of("c:1", "c/1"), "kitti", tmp_path / "out.txt")
    assert [file.name for file in tmp_path.iterdir()] == ["out-b.txt"]


def test_ply_has_the_points_of_each_object_and_closed_boxes(run: Results, tmp_path: Path) -> None:
    export(run, "ply", tmp_path / "ply")
    assert sorted(path.name for path in (tmp_path / "ply").iterdir()) == [
        "boxes.ply",
        "object_001.ply",
        "object_002.ply",
    ]
    own = run.map_points().label == 1
    cloud = trimesh.load(tmp_path / "ply" / "object_001.ply")
    np.testing.assert_array_equal(cloud.vertices, run.map_points().xyz[own])
    np.testing.assert_array_equal(cloud.colors[:, :3], run.map_points().rgb[own])
    assert len(read_map(tmp_path / "ply" / "object_002.ply").xyz) == 0
    mesh = trimesh.load(tmp_path / "ply" / "boxes.ply", process=False)
    parts = mesh.split()
    assert len(parts) == 2
    for label, part in zip((1, 2), parts, strict=True):
        box = BOXES[label]
        assert part.is_watertight
        assert part.volume == pytest.approx(box.volume, rel=1e-4)  # outward: the volume is not negative
        np.testing.assert_allclose(sorted(map(tuple, part.vertices)), sorted(map(tuple, box.corners())), atol=1e-6)
        assert (part.visual.vertex_colors[:, :3] == color_of(label)).all()
    header = (tmp_path / "ply" / "boxes.ply").read_bytes().partition(b"end_header")[0].decode()
    assert "element edge 24" in header


def test_coco_is_read_by_its_own_tools(run: Results, tmp_path: Path) -> None:
    export(run, "coco", tmp_path / "coco.json")
    coco = COCO(str(tmp_path / "coco.json"))
    assert coco.getImgIds() == list(SEEN)
    assert coco.loadImgs([3])[0]["file_name"] == "color/000003.png"
    assert [category["name"] for category in coco.loadCats(coco.getCatIds())] == ["object"]
    found = coco.loadAnns(coco.getAnnIds(imgIds=[1], catIds=[1]))
    assert [item["track_id"] for item in found] == [1, 2, 3]
    assert found[0]["bbox"] == [10.0, 11.5, 10.25, 19.5]
    assert found[0]["area"] == pytest.approx(10.25 * 19.5, abs=0.01)
    assert min(coco.getAnnIds()) == 1
    result = coco.loadRes(
        [{name: item[name] for name in ("image_id", "category_id", "bbox", "score")} for item in found]
    )
    assert len(result.getAnnIds()) == 3
    merged = {track["id"]: track["merged_into"] for track in load(tmp_path / "coco.json")["tracks"]}
    assert merged == {1: None, 2: None, 3: 1}


def test_without_its_recording_coco_says_that_images_have_no_names(run: Results, tmp_path: Path) -> None:
    moved = tmp_path / "moved"
    (tmp_path / "recording").rename(moved)
    (note,) = export(run, "coco", tmp_path / "a.json")
    assert "--recording says where it is" in note
    assert load(tmp_path / "a.json")["images"][0]["file_name"] == "000000"
    assert export(Results(run.folder, moved), "coco", tmp_path / "b.json") == []
    assert load(tmp_path / "b.json")["images"][0]["file_name"] == "color/000000.png"
    with pytest.raises(InputError):
        export(Results(run.folder, tmp_path / "nowhere"), "coco", tmp_path / "c.json")


def read_kitti(path: Path) -> Float64Array:
    """Return the lines without the type: frame, label, truncated, occluded, alpha, rectangle, height, width, ..."""
    lines = [line.split() for line in path.read_text().splitlines()]
    assert {words[2] for words in lines} == {"Misc"}
    return np.array([[*words[:2], *words[3:]] for words in lines], np.float64)


def kitti_box(line: Float64Array) -> Box:
    """Return the box of a line in the camera frame."""
    height, width, length, x, y, z, turn = line[9:16]
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, s, 0.0], [0.0, 0.0, -1.0], [-s, c, 0.0]])
    return Box(np.array([x, y - height / 2, z]), np.array([length, width, height]), rotation)


def test_kitti_of_a_level_camera_is_exact(make_run: Callable[[float], Results], tmp_path: Path) -> None:
    run = make_run(0.0)
    (note,) = export(run, "kitti", tmp_path / "k.txt")
    assert "tilted by 0 degrees" in note
    assert "IoU 1.00" in note
    lines = read_kitti(tmp_path / "k.txt")
    assert lines.shape == (sum(map(len, SEEN.values())), 17)
    assert lines[:, :2].tolist() == [[frame, label] for frame in SEEN for label in SEEN[frame]]
    assert lines[0, 2:4].tolist() == [0, 0]
    assert lines[0, 9:12].tolist() == [0.10, 0.12, 0.20]  # height, width, length
    for line in lines:
        true = in_camera(BOXES[int(line[1])], run.poses[int(line[0])].T_world_camera)
        assert iou(kitti_box(line), true) > 0.999
        ahead_rad = np.arctan2(true.center[0], true.center[2])
        assert np.cos(line[4] - line[15] + ahead_rad) == pytest.approx(1.0)
    assert lines[lines[:, 0] == 3, 16].tolist() == [0.9, 0.9]  # label 3 ended as object 1
    assert lines[lines[:, 0] == 1, 3].tolist() == [0, 1, 1]


def test_kitti_of_a_tilted_camera_keeps_centres_and_says_what_it_loses(run: Results, tmp_path: Path) -> None:
    (note,) = export(run, "kitti", tmp_path / "k.txt")
    assert "tilted by 30 degrees" in note
    overlaps = []
    for line in read_kitti(tmp_path / "k.txt"):
        true = in_camera(BOXES[int(line[1])], run.poses[int(line[0])].T_world_camera)
        np.testing.assert_allclose(kitti_box(line).center, true.center, atol=2e-6)
        overlaps.append(iou(kitti_box(line), true))
    assert f"IoU {np.median(overlaps):.2f}" in note
    assert 0.3 < np.median(overlaps) < 0.95


@pytest.mark.parametrize(("x", "truncated"), [(0.0, 0), (0.45, 1), (0.58, 2), (2.0, 2)])
def test_kitti_says_what_the_image_cuts_off(x: float, truncated: int) -> None:
    box = Box(np.array([x, 0.0, 1.0]), np.full(3, 0.2), np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], float))
    seen = TrackRow(1, box, None, 1.0, np.zeros(4), 0, 0.0)
    line, _ = kitti_row(seen, np.eye(4), CAMERA, 1.0)
    assert line.split()[3] == str(truncated)


def messages(file: Path) -> dict[str, list[tuple[int, Any]]]:
    """Return times and messages of a bag, by topic."""
    found: dict[str, list[tuple[int, Any]]] = {}
    with AnyReader([file]) as bag:
        for connection, time_ns, raw in bag.messages():
            found.setdefault(connection.topic, []).append((time_ns, bag.deserialize(raw, connection.msgtype)))
    return found


def test_mcap_has_pictures_and_transforms_as_ros_has_them(run: Results, tmp_path: Path) -> None:
    assert export(run, "mcap", tmp_path / "r.mcap") == []
    found = messages(tmp_path / "r.mcap")
    color_topic, depth = "/camera/color/image_raw/compressed", "/camera/aligned_depth_to_color"
    per_frame = (
        "/tf",
        "/objects/markers",
        "/objects/detections",
        "/camera/color/camera_info",
        f"{depth}/camera_info",
        color_topic,
        f"{depth}/image_raw/compressedDepth",
    )
    assert {topic: len(several) for topic, several in found.items()} == {**dict.fromkeys(per_frame, 4), "/map": 1}
    assert [time_ns for time_ns, _ in found["/tf"]] == [round(k / 30 * 1e6) * 1000 for k in (0, 1, 3, 4)]
    color, deep = found[color_topic][0][1], found[f"{depth}/image_raw/compressedDepth"][0][1]
    assert cv2.imdecode(color.data, cv2.IMREAD_COLOR).shape == (48, 64, 3)
    assert (cv2.imdecode(deep.data[12:], cv2.IMREAD_UNCHANGED) == 1500).all()
    assert deep.format == "16UC1; compressedDepth png"
    transform = found["/tf"][2][1].transforms[0]
    assert (transform.header.frame_id, transform.child_frame_id) == ("world", "camera_color_optical_frame")
    moved = transform.transform.translation
    np.testing.assert_allclose([moved.x, moved.y, moved.z], run.poses[3].T_world_camera[:3, 3], atol=1e-6)
    xyz = np.frombuffer(found["/map"][0][1].data, np.float32).reshape(-1, 4)[:, :3]
    np.testing.assert_array_equal(xyz, run.map_points().xyz)


def test_mcap_has_boxes_where_they_are(run: Results, tmp_path: Path) -> None:
    export(run, "mcap", tmp_path / "r.mcap")
    found = messages(tmp_path / "r.mcap")
    first = found["/objects/detections"][0][1].detections[0]
    assert (first.id, first.header.frame_id, first.header.stamp.sec) == ("1", "world", 0)
    q = first.bbox.center.orientation
    np.testing.assert_allclose(rotation_from_quat_wxyz([q.w, q.x, q.y, q.z]), BOXES[1].rotation, atol=1e-6)
    assert [first.bbox.size.x, first.bbox.size.y, first.bbox.size.z] == pytest.approx([0.20, 0.12, 0.10])
    assert first.results[0].hypothesis.score == pytest.approx(0.9)
    markers = found["/objects/markers"][0][1].markers
    assert {(one.ns, one.id, one.type) for one in markers} == {("boxes", 1, 1), ("edges", 1, 5), ("labels", 1, 9)}
    edges, text = (next(one for one in markers if one.ns == name) for name in ("edges", "labels"))
    assert len(edges.points) == 24
    assert text.text == "#1"
    assert text.pose.position.z > 0.80  # above the box
    deleted = {one.id for _, frame in found["/objects/markers"] for one in frame.markers if one.action == 2}
    assert deleted == {3}  # became part of 1


def test_mcap_has_the_events_of_objects_at_their_frames(run: Results, tmp_path: Path) -> None:
    (run.folder / "events.csv").write_text(
        f"{EVENTS_HEADER}\n1,0.033333,moved,1,0.1,0.2,0.3,0.4,0.5,0.6,0.9\n3,0.1,gone,2,0.1,0.2,0.3,,,,1.0\n"
    )
    export(Results(run.folder), "mcap", tmp_path / "r.mcap")
    (at_ns, moved), (_, gone) = messages(tmp_path / "r.mcap")["/objects/events"]
    assert (at_ns, moved.event, moved.label, moved.score, moved.header.frame_id) == (33333000, "moved", 1, 0.9, "world")
    places = [[getattr(at, axis) for axis in "xyz"] for at in (moved.from_position, moved.to_position)]
    assert places == [[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]]
    assert (gone.event, gone.label, np.isnan(gone.to_position.x)) == ("gone", 2, True)


def test_mcap_needs_no_pictures(run: Results, tmp_path: Path) -> None:
    (tmp_path / "recording").rename(tmp_path / "moved")
    (note,) = export(run, "mcap", tmp_path / "r.mcap")
    assert "no pictures" in note
    assert set(messages(tmp_path / "r.mcap")) >= {"/tf", "/objects/detections", "/map"}


def test_json_has_sizes_in_centimetres_and_footprints_on_the_ground(run: Results, tmp_path: Path) -> None:
    export(run, "json", tmp_path / "j.json")
    document = load(tmp_path / "j.json")
    assert (document["type"], document["units"], document["up"]) == ("FeatureCollection", "cm", [0.0, 0.0, 1.0])
    one, two, table = document["features"]
    assert [one["properties"][f"{side}_cm"] for side in ("length", "width", "height")] == [20.0, 12.0, 10.0]
    assert one["properties"]["center_cm"] == [5.0, 2.0, 75.0]
    assert (one["properties"]["first_seen_s"], one["properties"]["last_seen_s"]) == (0.0, 0.1)
    assert one["properties"]["stands_on_plane"] == table["properties"]["number"] == 0
    assert two["properties"]["stands_on_plane"] is None
    for feature, area_cm2 in ((one, 240.0), (two, 56.0), (table, 40000.0)):
        (ring,) = np.array(feature["geometry"]["coordinates"])
        np.testing.assert_array_equal(ring[0], ring[-1])
        np.testing.assert_allclose(ring[:, 2], 70.0, atol=1e-9)
        x, y = ring[:, 0], ring[:, 1]
        signed = 0.5 * float((x[:-1] * y[1:] - x[1:] * y[:-1]).sum())
        assert signed == pytest.approx(area_cm2, rel=1e-3)  # positive: counter-clockwise from above


def test_csv_has_a_row_an_object(run: Results, tmp_path: Path) -> None:
    export(run, "csv", tmp_path / "o.csv")
    with (tmp_path / "o.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["label"] for row in rows] == ["1", "2"]
    assert [float(rows[0][f"{side}_cm"]) for side in ("length", "width", "height")] == [20.0, 12.0, 10.0]
    assert [float(rows[1][f"{axis}_m"]) for axis in "xyz"] == [0.3, -0.1, 0.8]
    assert (rows[0]["plane"], rows[1]["plane"], rows[0]["merged_labels"]) == ("0", "", "3")
    assert (rows[0]["first_frame"], rows[0]["last_frame"]) == ("0", "3")
    assert int(rows[1]["last_frame"]) < FRAMES


def test_graphml_has_objects_surfaces_and_what_is_on_what(run: Results, tmp_path: Path) -> None:
    assert export(run, "graphml", tmp_path / "g.graphml") == []
    space = {"g": "http://graphml.graphdrawing.org/xmlns"}
    root = ElementTree.parse(tmp_path / "g.graphml").getroot()
    keys = {key.get("id"): (key.get("attr.name"), key.get("attr.type")) for key in root.findall("g:key", space)}
    nodes = {
        node.get("id"): {keys[one.get("key")][0]: one.text for one in node}
        for node in root.iterfind(".//g:node", space)
    }
    assert set(nodes) == {"object:1", "object:2", "plane:0"}
    assert [float(str(nodes["object:1"][name])) for name in ("length_m", "width_m", "height_m")] == [0.2, 0.12, 0.1]
    assert nodes["plane:0"]["kind"] == "plane"
    edges = {
        (edge.get("source"), edge[0].text, edge.get("target")): float(str(edge[1].text))
        for edge in root.iterfind(".//g:edge", space)
    }
    assert {one for one in edges if one[1] == "on"} == {(f"object:{k}", "on", "plane:0") for k in (1, 2)}
    assert all(end in nodes for source, _, target in edges for end in (source, target))
    assert all(0.5 <= score <= 1.0 for score in edges.values())


def test_json_has_relations_that_were_saved(run: Results, tmp_path: Path) -> None:
    write_objects(run.folder / "objects.json", run.found.with_relations(run.map_points()))
    export(Results(run.folder), "json", tmp_path / "j.json")
    one, *_ = load(tmp_path / "j.json")["features"]
    assert {"to": "plane:0", "is": "on"}.items() <= one["properties"]["relations"][0].items()
