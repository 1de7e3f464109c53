"""Poses of a rig's cameras from the scene that they see."""

from __future__ import annotations

import json
import weakref
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cuboid.cli import main
from cuboid.ground.core.frame import Frame, RigCamera
from cuboid.ground.geometry.se3 import angle, inverse
from cuboid.inputs.calibration.rig_check import RigWatch
from cuboid.inputs.recordings.opening import open_recording
from cuboid.inputs.recordings.rig import RigRecording
from made_rigs import POSES, WIDE, write_camera, write_rig
from made_scenes import look_at


def test_the_scene_gives_the_poses_of_the_cameras(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rig = write_rig(tmp_path / "rig")
    output = tmp_path / "found.json"
    assert main(["calibrate", "--rig", str(rig / "left"), str(rig / "right"), "--output", str(output), "--json"]) == 0
    found = open_recording(output)
    assert isinstance(found, RigRecording)
    true = inverse(POSES[0]) @ POSES[1]
    error = inverse(true) @ found.rig.T_rig_camera["right"]
    assert np.linalg.norm(error[:3, 3]) < 0.003
    assert np.degrees(angle(error)) < 0.2
    assert found.read(1).camera_name == "right"
    printed = json.loads(capsys.readouterr().out)
    assert printed["cameras"][1]["error_mm"] < 5
    assert Path(printed["picture"]).read_bytes().startswith(b"\x89PNG")


def test_cameras_that_see_different_things_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_camera(tmp_path / "a", WIDE, [POSES[0]] * 3, [0.0, 0.1, 0.2])
    away = look_at((0.0, 0.0, 0.4), (0.0, 3.0, 0.0))
    write_camera(tmp_path / "b", WIDE, [away] * 3, [0.0, 0.1, 0.2])
    call = ["calibrate", "--rig", str(tmp_path / "a"), str(tmp_path / "b"), "--output", str(tmp_path / "rig.json")]
    assert main(call) == 2
    assert "camera b: " in capsys.readouterr().err


def test_a_knocked_camera_is_named(tmp_path: Path) -> None:
    still, moved = POSES[0], POSES[0].copy()
    moved[:3, 3] += (0.0, 0.03, 0.0)
    times_s = [*np.arange(8) / 30, *(90.0 + np.arange(8) / 30)]
    stood = open_recording(write_camera(tmp_path / "stood", WIDE, [still] * 16, times_s))
    knocked = open_recording(write_camera(tmp_path / "knocked", WIDE, [still] * 8 + [moved] * 8, times_s))
    for ahead in (False, True):
        watch, steady = RigWatch(ahead=ahead), []
        for frame_stood, frame_knocked in zip(stood, knocked, strict=True):
            watch.add(replace(frame_stood, camera=RigCamera("right", WIDE)))
            watch.add(replace(frame_knocked, camera=RigCamera("left", WIDE)))
            steady.append(not watch.warnings)
        watch.finish()
        assert steady[7]  # before the blow
        assert len(watch.warnings) == 1
        assert watch.warnings[0].startswith("camera left was knocked: 90 s after its start it sees the scene 3")


def test_colors_of_watched_frames_are_not_kept() -> None:
    watch, color = RigWatch(ahead=False), np.zeros((240, 320, 3), np.uint8)
    kept = weakref.ref(color)
    for k in range(3):
        watch.add(Frame(k, k / 30, color, np.ones((240, 320), np.float32), camera=RigCamera("left", WIDE)))
    del color
    assert kept() is None
