"""Names from a detector, in results and in scenes; a user's name wins."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from made_scene import CAMERA, THINGS, Shown, change, record

from cuboid import Tracker, cli
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.method.detection.types import Detections
from cuboid.results.exports import export
from cuboid.results.files import open_results
from cuboid.runs.scene import Scene
from cuboid.runs.scene.checking import problems, rescue

NAMES = ("book", "cup")


def detector_of(shown: Shown, seen: list[int] | None = None) -> Callable[[Frame, Intrinsics], Detections]:
    """The first thing is a book, the second a cup, by the masks of the frames."""

    def detect(frame: Frame, intrinsics: Intrinsics) -> Detections:
        if seen is not None:
            seen.append(frame.index)
        masks = shown.proposals(frame, None)
        hit = shown._hits[frame.index]
        numbers = [int(k) - 2 for k in np.unique(hit[hit >= 2])]
        scores = np.full((len(masks), 2), 0.06, np.float32)
        scores[np.arange(len(masks)), [min(k, 1) for k in numbers]] = 0.8
        return Detections(masks.boxes_xyxy, scores, NAMES)

    return detect


def tracked(shown: Shown, **options: object) -> Tracker:
    tracker = Tracker(CAMERA, proposals=shown.proposals, **options)  # type: ignore[arg-type]
    for frame in shown.frames:
        tracker.update(frame)
    return tracker


def names_of(tracker: Tracker) -> dict[int, str | None]:
    """The name of what stands where each thing does, by the thing's place in THINGS."""
    centres = {k: thing.center for k, thing in enumerate(THINGS)}
    return {
        min(centres, key=lambda k: float(np.linalg.norm(centres[k] - item.box.center))): item.name
        for item in tracker.objects
    }


def test_objects_get_names_and_without_a_detector_none(tmp_path: Path) -> None:
    shown = Shown()
    seen: list[int] = []
    tracker = tracked(shown, detector=detector_of(shown, seen))
    assert names_of(tracker) == {0: "book", 1: "cup"}
    assert seen == [0, 3, 6, 9, 12, 15]
    assert all(item.name_score is not None and item.name_score > 0.9 for item in tracker.objects)
    tracker.save(tmp_path / "named")
    plain = tracked(shown)
    plain.save(tmp_path / "plain")
    document = json.loads((tmp_path / "named" / "objects.json").read_text())
    without = json.loads((tmp_path / "plain" / "objects.json").read_text())
    for item in document["objects"]:
        assert {item.pop("name"), *(name for name, _ in item.pop("names", []))} <= {*NAMES}
        assert item.pop("name_score") > 0.9
    assert document == without
    for name in ("tracks.csv", "proposals.csv", "trajectory.txt", "map.ply"):
        assert (tmp_path / "named" / name).read_bytes() == (tmp_path / "plain" / name).read_bytes()
    config = json.loads((tmp_path / "named" / "run.json").read_text())["config"]
    assert (config["detector_every"], config["vocabulary"]) == (3, [*NAMES])
    again = open_results(tmp_path / "named")
    assert {item.name for item in again.found.objects} == {*NAMES}
    assert all(item.name_score for item in again.found.objects)


def test_every_frame_or_each_nth() -> None:
    shown, seen = Shown(frames=7), []  # type: ignore[var-annotated]
    tracked(shown, detector=detector_of(shown, seen), detector_every=1)
    assert seen == [0, 1, 2, 3, 4, 5, 6]
    with pytest.raises(ValueError, match="each n-th frame, n >= 1, got 0"):
        Tracker(CAMERA, detector=detector_of(shown), detector_every=0)


def test_detectors_that_answer_nonsense_are_told() -> None:
    shown = Shown(frames=1)
    far = Detections(np.array([[0, 0, 999, 9]], np.int32), np.ones((1, 1), np.float32), ("cup",))
    for answer, error in (([], TypeError), (far, ValueError)):
        with pytest.raises(error, match=r"a detector must return cuboid\.Detections|lie outside its 160 x 120 pixels"):
            tracked(shown, detector=lambda frame, intrinsics, answer=answer: answer)


def test_images_that_are_turned_give_the_same_names() -> None:
    shown = Shown()
    detect = detector_of(shown)
    turned = Intrinsics(CAMERA.fy, CAMERA.fx, CAMERA.height - 1 - CAMERA.cy, CAMERA.cx, CAMERA.height, CAMERA.width)
    R = np.eye(4)
    R[:3, :3] = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])

    def detect_turned(frame: Frame, intrinsics: Intrinsics) -> Detections:
        found = detect(frame, CAMERA)
        boxes = found.boxes_xyxy
        rolled = np.column_stack([120 - boxes[:, 3], boxes[:, 0], 120 - boxes[:, 1], boxes[:, 2]]).astype(np.int32)
        return dataclasses.replace(found, boxes_xyxy=rolled)

    tracker = Tracker(turned, detector=detect_turned)
    for frame in shown.frames:
        pose = frame.T_world_camera
        assert pose is not None
        color, depth_m = (np.ascontiguousarray(np.rot90(image, -1)) for image in (frame.color, frame.depth_m))
        tracker.update(dataclasses.replace(frame, color=color, depth_m=depth_m, T_world_camera=pose @ R))
    assert {name for name in names_of(tracker).values() if name} == {*NAMES}


def test_exports_have_the_names(tmp_path: Path) -> None:
    shown = Shown()
    tracked(shown, detector=detector_of(shown)).save(tmp_path / "out")
    results = open_results(tmp_path / "out")
    export(results, "coco", tmp_path / "c.json")
    coco = json.loads((tmp_path / "c.json").read_text())
    assert [one["name"] for one in coco["categories"]] == ["object", "book", "cup"]
    named = {one["id"]: one["name"] for one in coco["categories"]}
    for track in coco["tracks"]:
        assert named[track["category_id"]] == track["name"]
    assert {one["category_id"] for one in coco["annotations"]} == {2, 3}
    export(results, "csv", tmp_path / "c.csv")
    header, *rows = (tmp_path / "c.csv").read_text().splitlines()
    assert header.endswith(",name,name_score,names")
    assert all(len(row.split(",")) == len(header.split(",")) for row in rows)
    assert {row.split(",")[-3] for row in rows} == {*NAMES}
    export(results, "json", tmp_path / "j.json")
    features = json.loads((tmp_path / "j.json").read_text())["features"]
    assert {one["properties"]["name"] for one in features if one["properties"]["kind"] == "object"} == {*NAMES}


def into(path: Path, shown: Shown, *, detector: object = None) -> set[str | None]:
    objects, _ = record(path, shown, detector=detector)
    return {item.name for item in objects}


def test_a_scene_keeps_the_evidence_and_a_users_name_wins(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, shown = tmp_path / "made.cuboid", Shown()
    assert into(path, shown, detector=detector_of(shown)) == {*NAMES}
    with Scene.open(path) as scene:
        cup = next(item for item in scene.objects if item.name == "cup")
        assert cup.name_score is not None
        assert cup.name_score > 0.9
        scene.name(cup.label, "Anna's")
        mine = scene.objects.find(cup.label)
        assert (mine.name, mine.name_score, mine.names[0][0]) == ("Anna's", None, "cup")
    # a later visit without a detector goes on from the evidence
    later = Shown(begin=0.5)
    assert into(path, later) == {"book", "Anna's"}
    assert cli.main(["scene", "list", str(path)]) == 0
    assert "Anna's" in capsys.readouterr().out
    with Scene.open(path) as scene:
        scene.write_results(tmp_path / "out")
        scene.name(cup.label, "")
        assert scene.objects.find(cup.label).name == "cup"
    found = open_results(tmp_path / "out").found.objects
    assert {item.name for item in found} == {"book", "Anna's"}
    assert problems(path) == []
    assert rescue(path, tmp_path / "new.cuboid") == []
    with Scene.open(tmp_path / "new.cuboid") as scene:
        assert {item.name for item in scene.objects} == {*NAMES}


def test_a_damaged_class_is_told(tmp_path: Path) -> None:
    path, shown = tmp_path / "made.cuboid", Shown()
    into(path, shown, detector=detector_of(shown))
    change(path, "UPDATE objects SET classes = '[1]'")
    with pytest.raises(InputError, match=r"objects\.classes is damaged"), Scene.open(path) as scene:
        _ = scene.objects
