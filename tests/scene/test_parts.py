"""A recording that is not recognised is a part of its own, which goes where it belongs when it meets the rest."""

from __future__ import annotations

import contextlib
import dataclasses
import sqlite3
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.geometry import se3
from cuboid.lab.synthetic import make_scene
from cuboid.lab.synthetic.view import SceneView
from cuboid.method.poses.sources import ESTIMATED, GivenPoses
from cuboid.runs.scene import RecordingInfo, Scene, layout
from cuboid.runs.scene.checking import problems
from cuboid.runs.scene.codec import Encoder, decode, take
from cuboid.runs.scene.localisation import OWN_WORLD, SAME_WORLD, ScenePoses, ScenePosesState

MADE = make_scene("table", 6, frames=150, camera="orbit")
CAMERA: Intrinsics = MADE.intrinsics(160, 120)
Poses = dict[int, Float64Array]


@pytest.fixture(scope="module")
def shown() -> list[Frame]:
    """A camera that goes round a table; poses in the room's world."""
    view = SceneView(MADE, CAMERA)
    rendered = [(k, view.render(k, "clean")) for k in range(0, 150, 2)]
    return [Frame(k // 2, k / 30, one.color, one.depth_m, MADE.T_room_camera[k]) for k, one in rendered]


def record(path: Path, frames: Sequence[Frame], poses: str) -> tuple[Poses, Poses, tuple[str, ...]]:
    """Let frames go into a scene; return their poses as told at once, and as corrected, and what the user is told."""
    told: Poses = {}
    with Scene.open(path) as scene:
        source = RecordingInfo(f"/{len(scene.recordings)}", "made", poses, len(frames), CAMERA, {})
        tracker = scene.tracker(CAMERA, source=source, same_world=False)
        located = tracker.poses(GivenPoses())
        for k, one in enumerate(frames):
            given = one.T_world_camera if poses == "given" else None
            with contextlib.suppress(FrameError):
                posed = located.locate(dataclasses.replace(one, index=k, timestamp_s=k / 15, T_world_camera=given))
                tracker.apply_correction(posed.moved)
                frame = dataclasses.replace(one, index=k, timestamp_s=k / 15, T_world_camera=posed.T_world_camera)
                tracker.update(frame, posed.anchor)
                told[k] = posed.T_world_camera
        return told, dict(located.trajectory() or told), tracker.warnings()


def off_m(found: Poses, frames: Sequence[Frame], T_world_room: Float64Array) -> float:
    """Return how far poses are from the truth, RMSE."""
    away = [T[:3, 3] - (T_world_room @ frames[k].T_world_camera)[:3, 3] for k, T in found.items()]
    return float(np.sqrt((np.array(away) ** 2).sum(1).mean()))


def test_parts_of_a_scene_join_when_they_meet(
    shown: list[Frame], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "s.cuboid"
    first, across, between = shown[:20], shown[74:54:-1], shown[10:70]
    told, _, warned = record(path, first, "estimated")
    assert warned == ()
    T_world_room = told[0] @ se3.inverse(first[0].T_world_camera)
    # The layout of the objects is the same from across; here the place is recognised by its pictures alone.
    with monkeypatch.context() as patch:
        patch.setattr(layout, "find_layout", lambda *_: None)
        told, corrected, warned = record(path, across, "estimated")
    assert len(told) > 15, "it is tracked all the same"
    assert min(np.linalg.norm(T[:3, 3]) for T in corrected.values()) > 100, "far aside"
    assert "the place was not recognised" in warned[0]
    with Scene.open(path) as scene:
        up = scene.tracker(CAMERA).tracker.up
        near, far = ([o for o in scene.objects if o.first_seen[0] == k] for k in (1, 2))
        assert len(near) >= 2
        assert len(far) >= 2
        for item in far:
            assert abs(item.box.rotation[:, 2] @ up) > 0.99, "a part is level as the scene is"
    told, corrected, warned = record(path, between, "estimated")
    assert warned == ()
    assert off_m(corrected, between, T_world_room) < 0.03
    assert problems(path) == []
    with Scene.open(path) as scene:
        assert all(np.linalg.norm(T[:3, 3]) < 10 for k in (1, 2, 4) for _, T in scene.poses(k).values())
        assert all(np.linalg.norm(item.box.center) < 10 for item in scene.objects)
        assert all(np.linalg.norm(past.box.center) < 10 for item in scene.objects for past in scene.history(item.label))
        assert {item.label for item in near} <= {item.label for item in scene.objects}
        # A pile that was one thing from across is two from the other side: it is there still.
        assert not {change.change for change in scene.changes()} & {"gone", "moved", "new"}


def test_a_place_is_recognised_and_labels_go_on(shown: list[Frame], tmp_path: Path) -> None:
    """A second recording, whose poses are estimated and which begins lost, is found among the old keyframes."""
    path, seen = tmp_path / "s.cuboid", []
    for number, frames in enumerate((shown[:45], shown[30:]), 1):
        told, _, _ = record(path, frames, "estimated")
        with Scene.open(path) as scene:
            seen.append({item.label for item in scene.objects if item.last_seen[0] == number})
        if number == 1:
            T_world_room = told[0] @ se3.inverse(frames[0].T_world_camera)
    assert min(told) < 10, "recognised within ten frames"
    assert off_m(told, frames, T_world_room) < 0.03
    assert len(told) > 0.8 * len(frames)
    known, again = seen
    assert len(known) >= 4
    assert len(known & again) >= len(known) - 1, "labels go on"


def test_given_poses_are_aligned_by_the_looks_of_the_place(shown: list[Frame], tmp_path: Path) -> None:
    path = tmp_path / "s.cuboid"
    record(path, shown[:40], "given")
    T_other_room = se3.exp([3.0, -2.0, 0.5, 0.3, 1.2, -0.4])
    frames = [
        dataclasses.replace(one, T_world_camera=T_other_room @ one.T_world_camera) for one in reversed(shown[20:])
    ]
    told, corrected, warned = record(path, frames, "given")
    assert warned == ()
    assert len(corrected) == len(frames), "what was seen before it was recognised is placed afterwards"
    assert np.linalg.norm(told[0][:3, 3]) > 100
    assert off_m(corrected, frames, se3.inverse(T_other_room)) < 0.015
    with Scene.open(path) as scene:
        labels = {item.label for item in scene.objects if item.first_seen[0] == 1}
        both = {item.label for item in scene.objects if item.last_seen[0] == 2} & labels
        assert len(both) >= 3
        assert all(np.linalg.norm(item.box.center) < 10 for item in scene.objects)
        assert not {change.change for change in scene.changes()} & {"gone", "moved", "new"}
    with sqlite3.connect(path) as connection:
        (data,) = connection.execute("SELECT T_world_recording FROM recordings WHERE id = 2").fetchone()
    connection.close()
    np.testing.assert_allclose(np.frombuffer(data).reshape(4, 4) @ T_other_room, np.eye(4), atol=0.02)


@pytest.mark.parametrize("mode", [ESTIMATED, OWN_WORLD])
def test_poses_go_on_from_any_cut(mode: str, shown: list[Frame]) -> None:
    """What has been recognised of a recording is saved, byte for byte."""

    def run(cuts: tuple[int, ...]) -> list[bytes]:
        poses, told = ScenePoses(CAMERA, TrackerConfig()), []
        poses.begin(SAME_WORLD, first=True)
        for frame in shown[:40]:
            poses.take(frame)
        poses.begin(mode, first=False)
        for k, one in enumerate(shown[50:20:-1]):
            given = None if mode == ESTIMATED else one.T_world_camera
            with contextlib.suppress(FrameError):
                frame = dataclasses.replace(one, index=100 + k, timestamp_s=k / 15, T_world_camera=given)
                posed = poses.locate(frame, np.array([0.0, 0.0, 1.0]))
                told += [posed.T_world_camera.tobytes(), *(T.tobytes() for T in posed.moved.values())]
            if k in cuts:
                state = decode(ScenePosesState, Encoder().parts(take(poses.state())))
                poses = ScenePoses.from_state(state, CAMERA)
        return told + [T.tobytes() for T in poses.trajectory(100).values()]

    whole = run(())
    assert len(whole) > 50
    assert run((2, 9, 13, 20, 26)) == whole
