"""What a scene tells, in this process and to those that open it later."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import re
import shutil
import sqlite3
from pathlib import Path

import cv2
import numpy as np
import pytest
from made_scene import CAMERA, THINGS, Shown, change, record

from cuboid import cli
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.errors import CuboidError, InputError, OutputError
from cuboid.ground.geometry import se3
from cuboid.results.files import Results
from cuboid.runs.scene import RecordingInfo, Scene, SceneObject
from cuboid.runs.scene.checking import problems, rescue
from cuboid.runs.scene.database import Writing, open_to_read
from cuboid.runs.scene.schema import SCENE_VERSION
from cuboid.runs.scene.session import SceneTracker

# To another place, out of view from here.
AWAY = se3.compose((1, 0, 0, 0), (20.0, 0, 0))


def test_objects_are_told_where_they_stand(made: Path) -> None:
    with Scene.open(made) as scene:
        assert [item.label for item in scene.objects] == [1, 2]
        for item in scene.objects:
            near = min(float(np.linalg.norm(item.box.center - thing.center)) for thing in THINGS)
            assert near < 0.1
            assert isinstance(item, SceneObject)
            assert item.first_seen[0] == item.last_seen[0] == 1
        assert [item.label for item in scene.near(scene.objects[1].box.center, 0.01)] == [2]
        assert {item.label for item in scene.near(scene.objects[1].box.center, 2.0)} == {1, 2}
        assert scene.near([5.0, 5.0, 5.0], 1.0) == []
        picture = scene.picture(1)
        assert picture is not None
        assert cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR).shape[2] == 3


def test_objects_tell_how_sure_they_are(path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with Scene.open(path) as scene:
        kept = {item.label: item for item in scene.objects}
    for item in kept.values():
        assert 0.001 < min(item.size_sigma_m) <= max(item.size_sigma_m) < 0.05
        assert 0.0 < min(item.center_sigma_m) <= max(item.center_sigma_m) < 0.05
        assert "+z" in item.sides_seen
    assert cli.main(["find", str(path), "--json"]) == 0
    found = json.loads(capfd.readouterr().out)["objects"]
    assert all(0.001 < one["height_sigma_m"] < 0.05 for one in found)
    assert [tuple(one["sides_seen"]) for one in found] == [kept[one["label"]].sides_seen for one in found]
    change(path, "UPDATE objects SET accuracy = '[0.1, 0.1]'")
    with Scene.open(path) as scene, pytest.raises(InputError, match=r"objects\.accuracy is damaged"):
        scene.objects  # noqa: B018


def test_the_history_of_an_object(made: Path) -> None:
    with Scene.open(made) as scene:
        past = scene.history(1)
        assert [one.frame for one in past] == sorted({one.frame for one in past})
        assert len(past) > 8
        assert all(one.recording == 1 and 0 < one.visible <= 1 for one in past)
        assert np.allclose(past[-1].box.center, scene.objects[0].box.center)
        with pytest.raises(InputError, match="no object has the label 7"):
            scene.history(7)


def test_a_second_recording_keeps_labels_and_names(path: Path) -> None:
    with Scene.open(path) as scene:
        scene.name(2, " red, box ")
        with pytest.raises(InputError, match="a name is one line"):
            scene.name(2, "two\nlines")
    other = Shown(begin=2.0)
    with Scene.open(path) as scene, scene.tracker(CAMERA, proposals=other.proposals) as tracker:
        assert tracker.visit.first_frame == 16
        assert tracker.objects == [], "nothing was seen yet in this recording"
        for frame in other.frames:
            found = tracker.update(frame)
            assert found.index == frame.index
        assert [(item.label, item.name) for item in tracker.objects] == [(1, None), (2, "red, box")]
        assert all(0 <= item.first_frame <= item.last_frame < 16 for item in tracker.objects)
        assert all(item.frames_seen <= 16 for item in tracker.objects)
    with Scene.open(path) as scene:
        assert [(one.number, one.complete, one.frames_used) for one in scene.recordings] == [
            (1, True, 16),
            (2, True, 16),
        ]
        assert [(item.label, item.name) for item in scene.objects] == [(1, None), (2, "red, box")]
        assert {one.recording for one in scene.history(1)} == {1, 2}


def test_a_run_that_was_broken_off_is_not_begun_again_on_its_own_part(path: Path) -> None:
    shown = Shown(frames=6)
    source = RecordingInfo("/again", "made", "given", 6, CAMERA, {"every": 1})

    def begin(source: RecordingInfo, **options: bool) -> SceneTracker:
        return scene.tracker(CAMERA, proposals=shown.proposals, source=source, commit_every_s=0.0, **options)

    with Scene.open(path) as scene:  # killed before the first commit: nothing of it was saved
        begin(source).drop()
    with Scene.open(path) as scene:
        tracker = begin(dataclasses.replace(source, settings={"every": 2}))
        assert tracker.visit.number == 2
        for frame in shown.frames[:4]:
            tracker.update(frame)
        tracker.drop()
    before = path.read_bytes()
    with Scene.open(path) as scene, pytest.raises(InputError) as refused:
        begin(source)
    assert re.search(r"/again was broken off before frame [1-4]: --resume continues it, with the", str(refused.value))
    assert path.read_bytes() == before
    # a camera's frames are gone, and another recording is none of this one
    for other in (dataclasses.replace(source, frames=0), dataclasses.replace(source, path="/other")):
        with Scene.open(path) as scene:
            begin(other).drop()
            assert scene.recordings[-1].path == other.path


def test_forgotten_labels_are_not_given_again(path: Path) -> None:
    with Scene.open(path) as scene:
        scene.forget(2)
        assert [item.state for item in scene.all_objects] == ["present", "forgotten"]
    record(path, Shown(), "again")
    with Scene.open(path) as scene:
        states = {item.label: item.state for item in scene.all_objects}
        assert states == {1: "present", 2: "forgotten", 3: "present"}
    assert problems(path) == []


def test_merged_objects_stay_one(path: Path) -> None:
    with Scene.open(path) as scene:
        assert scene.merge(2, 1) == 1
        assert [(item.label, item.state, item.merged_into) for item in scene.all_objects] == [
            (1, "present", None),
            (2, "merged", 1),
        ]
        assert len(scene.history(1)) > len(scene.history(2)) > 0
        with pytest.raises(InputError, match="got 1 twice"):
            scene.merge(1, 1)
        with pytest.raises(InputError, match="no object that is there has the label 2"):
            scene.merge(1, 2)
    assert problems(path) == []


def test_the_results_of_a_recording(path: Path, tmp_path: Path) -> None:
    with Scene.open(path) as scene:
        scene.name(1, "blue box")
        scene.write_results(tmp_path / "out")
        with pytest.raises(InputError, match="there is no recording 3"):
            scene.write_results(tmp_path / "other", 3)
        history = {label: scene.history(label) for label in (1, 2)}
    results = Results(tmp_path / "out")
    assert [(item.label, item.name) for item in results.found.objects] == [(1, "blue box"), (2, None)]
    assert [item.points for item in results.found.objects] == [(results.map_points().label == k).sum() for k in (1, 2)]
    assert len(results.poses) == 16
    assert [(row.frame, row.label) for row in results.tracks] == sorted(
        (one.frame, label) for label, past in history.items() for one in past
    )
    assert len(results.map_points().xyz) > 1000


def set_rig(path: Path, rig: object) -> None:
    """Store settings of a rig with the recording of a scene."""
    change(path, "UPDATE recordings SET settings = ?", json.dumps({"every": 1, "rig": rig}))


def test_a_recording_of_a_rig_may_be_long(path: Path, tmp_path: Path) -> None:
    set_rig(path, {"cameras": ["left", "right"], "sequence": [k % 2 for k in range(4000)]})
    assert problems(path) == []
    assert rescue(path, tmp_path / "new.cuboid") == []
    for scene_path in (path, tmp_path / "new.cuboid"):
        with Scene.open(scene_path) as scene:
            scene.write_results(tmp_path / scene_path.stem)
        rows = Results(tmp_path / scene_path.stem).tracks
        assert {row.camera for row in rows} == {"left", "right"}
        assert all(row.camera == ("left", "right")[row.frame % 2] for row in rows)


@pytest.mark.parametrize(
    ("rig", "says"),
    [
        ({"cameras": ["left", "right"], "sequence": [0, 1]}, "cameras for 2 frames, expected at least 16"),
        (
            {"cameras": ["left", "right"], "sequence": [2] * 16},
            "of camera 2, the last camera of the rig is 1",
        ),
        ({"cameras": ["left", "right"], "sequence": [-1] * 16}, "expected"),
        ({"sequence": [0] * 16}, "cameras"),
        (None, "expected"),
    ],
)
def test_frames_of_a_rig_without_a_camera_are_damaged(rig: object, says: str, path: Path, tmp_path: Path) -> None:
    set_rig(path, rig)
    with Scene.open(path) as scene, pytest.raises(InputError, match=rf"^[^\n]*settings is damaged: [^\n]*{says}"):
        scene.write_results(tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_other_files_are_refused_in_one_line(path: Path, tmp_path: Path) -> None:
    text = tmp_path / "text.cuboid"
    text.write_text("no scene " * 100)
    other = tmp_path / "other.cuboid"
    change(other, "CREATE TABLE t (x)")
    newer = Path(shutil.copy(path, tmp_path / "newer.cuboid"))
    change(newer, f"PRAGMA user_version = {SCENE_VERSION + 1}")
    for file, said in ((text, "is no scene file"), (other, "but no scene file"), (newer, "written by another Cuboid")):
        before = file.read_bytes()
        with pytest.raises(CuboidError, match=said):
            Scene.open(file)
        assert file.read_bytes() == before
    with pytest.raises(InputError, match=r"made with voxel_m = 0\.01, not 0\.02"), Scene.open(path) as scene:
        scene.tracker(CAMERA, TrackerConfig(voxel_m=0.02))


@pytest.mark.parametrize("version", [-(2**31), -9, -1, 0])
def test_a_version_below_the_first_is_refused_and_nothing_is_written(version: int, path: Path, tmp_path: Path) -> None:
    spoiled = Path(shutil.copy(path, tmp_path / "spoiled.cuboid"))
    change(spoiled, f"PRAGMA user_version = {version}")
    before = spoiled.read_bytes()
    for way in (Scene.open, open_to_read, Writing):
        with pytest.raises(
            InputError,
            match=f"written by another Cuboid .scene version {version}.; this one reads version {SCENE_VERSION}",
        ) as found:
            way(spoiled)
        assert "\n" not in str(found.value)
        assert spoiled.read_bytes() == before
    assert cli.main(["scene", "list", str(spoiled)]) == 2
    assert cli.main(["scene", "check", str(spoiled)]) != 0


def test_every_byte_of_the_map_is_under_a_check_sum(path: Path, tmp_path: Path) -> None:
    with contextlib.closing(sqlite3.connect(path)) as connection:
        data = bytearray(connection.execute("SELECT data FROM blocks WHERE number = 1").fetchone()[0])
    data[len(data) // 2] ^= 1
    change(path, "UPDATE blocks SET data = ? WHERE number = 1", bytes(data))
    assert problems(path) == ["block 1 of the map is damaged: its check sum is wrong"]
    with pytest.raises(InputError, match="'cuboid scene check --rescue NEW' saves"):
        record(path, Shown(), "again")
    lost = rescue(path, tmp_path / "new.cuboid")
    assert len(lost) == 1
    assert "block 1 of the map" in lost[0]
    assert problems(tmp_path / "new.cuboid") == []
    record(tmp_path / "new.cuboid", Shown(), "again")
    with Scene.open(tmp_path / "new.cuboid") as scene:
        assert [item.label for item in scene.objects] == [1, 2]
        assert [one.complete for one in scene.recordings] == [True, True], "the refused one left nothing"


def test_fine_points_are_in_the_file_in_exports_and_in_what_is_rescued(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cuboid.runs.tracking.posed_tracker.resolves_m", lambda *_: 3.0)
    path, new, points = tmp_path / "fine.cuboid", tmp_path / "new.cuboid", []
    record(path, Shown())
    assert problems(path) == []
    with sqlite3.connect(path) as connection:
        assert connection.execute("SELECT sum(living) FROM blocks WHERE cube < 0").fetchone()[0] > 500
    connection.close()
    assert rescue(path, new) == []
    for file in (path, new):
        with Scene.open(file) as scene:
            scene.write_results(tmp_path / file.stem)
        cloud = Results(tmp_path / file.stem).map_points()
        cells = np.floor(cloud.xyz[cloud.label == 1] / 0.01).astype(int)
        assert len(cells) > 1.5 * len(np.unique(cells, axis=0)), "several points a voxel of 1 cm"
        points.append(sorted(map(tuple, np.column_stack([cloud.xyz, cloud.rgb, cloud.label]).tolist())))
    assert points[0] == points[1]
    record(new, Shown(begin=0.5), "again")
    with Scene.open(new) as scene:
        assert [item.label for item in scene.objects] == [1, 2]
    assert problems(new) == []


def test_a_recording_begins_without_the_map(path: Path) -> None:
    """Opening takes as long as the objects take: of the map, only what is looked at is read."""
    change(path, "UPDATE blocks SET data = x'00'")
    shown = Shown()
    away = [dataclasses.replace(f, T_world_camera=AWAY @ f.T_world_camera) for f in shown.frames]
    with Scene.open(path) as scene:
        tracker = scene.tracker(CAMERA, proposals=shown.proposals)
        for frame in away[:-1]:
            tracker.update(frame)
        with pytest.raises(InputError, match="'cuboid scene check --rescue NEW' saves"):
            tracker.update(shown.frames[-1])
        tracker.drop()


@pytest.mark.parametrize("seed", range(12))
def test_what_can_be_read_of_a_damaged_file_is_saved(seed: int, path: Path, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    data = bytearray(path.read_bytes())
    for _ in range(3):  # some pages of nonsense, not the first one
        at = 4096 * int(rng.integers(1, len(data) // 4096))
        data[at : at + 4096] = rng.bytes(4096)
    path.write_bytes(bytes(data))
    found = problems(path)
    assert found
    assert all("\n" not in line for line in found)
    try:
        rescue(path, tmp_path / "new.cuboid")
    except CuboidError:
        assert not (tmp_path / "new.cuboid").exists()
        return
    assert problems(tmp_path / "new.cuboid") == []
    with Scene.open(tmp_path / "new.cuboid") as scene:
        known = {item.label for item in scene.all_objects}
    record(tmp_path / "new.cuboid", Shown(), "again")
    with Scene.open(tmp_path / "new.cuboid") as scene:
        assert known <= {item.label for item in scene.all_objects}
    with pytest.raises(OutputError, match="exists; name another file"):
        rescue(path, tmp_path / "new.cuboid")
