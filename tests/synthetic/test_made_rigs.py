"""Made rigs: a recording for each camera, and one truth of all frames."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from cuboid.ground.core.errors import InputError
from cuboid.ground.geometry.se3 import inverse
from cuboid.inputs.recordings.opening import open_recording
from cuboid.inputs.recordings.rig import RigRecording
from cuboid.lab.synthetic import make_rig, render_recording
from cuboid.results.files.rows import read_trajectory

FRAMES, SIZE = 2, (96, 72)


@pytest.mark.parametrize(("cameras", "moving"), [(3, False), (2, True)])
def test_poses_times_and_truth_belong_to_the_frames_of_all_cameras(tmp_path: Path, cameras: int, moving: bool) -> None:
    scene = make_rig("table", 1, cameras, moving=moving, frames=FRAMES)
    render_recording(scene, tmp_path / "rig", size=SIZE)
    rig = open_recording(tmp_path / "rig", register="off")
    assert isinstance(rig, RigRecording)
    assert (rig.kind, len(rig)) == ("moving" if moving else "fixed", cameras * FRAMES)
    assert [rig.part_of(k)[0].camera.name for k in range(cameras)] == [f"camera-{k + 1}" for k in range(cameras)]
    assert len({part.camera.intrinsics.fx for part in rig.parts}) == cameras
    true = read_trajectory(tmp_path / "rig" / "true_trajectory.txt")
    np.testing.assert_allclose([pose.timestamp_s for pose in true], [rig.timestamp_s(k) for k in range(len(rig))])
    for k in range(0, len(rig), cameras):  # of the first camera, whose poses are not interpolated
        np.testing.assert_allclose(rig.pose(k), true[k].T_world_camera, atol=1e-5)
    truth = json.loads((tmp_path / "rig" / "truth.json").read_text(encoding="utf-8"))
    assert truth["frames"] == cameras * FRAMES
    for k, part in enumerate(rig.parts):
        own = json.loads((tmp_path / "rig" / part.camera.name / "truth.json").read_text(encoding="utf-8"))
        for number, runs in truth["visibility"]["objects"].items():
            every = np.concatenate([[value] * int(length) for value, length in runs])
            assert (
                np.concatenate([[v] * int(n) for v, n in own["visibility"]["objects"][number]]).tolist()
                == every[k::cameras].tolist()
            )


def test_the_cameras_of_a_moving_rig_are_rigid_to_each_other() -> None:
    scene = make_rig("room", 1, 2, moving=True, frames=6)
    path = scene.T_world_camera
    for first, second in zip(path[::2], path[1::2], strict=True):
        apart = inverse(first) @ second  # one frame later: the rig has moved a little
        assert np.linalg.norm(apart[:3, 3] - scene.rig.T_rig_camera[1, :3, 3]) < 0.03


def test_fixed_cameras_need_room_around_the_scene() -> None:
    with pytest.raises(InputError, match="no rig can stand around a scene of the kind 'shelf'"):
        make_rig("shelf", 1, 2)
