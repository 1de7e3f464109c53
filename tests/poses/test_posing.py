"""Where the poses of a run come from."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from posed_pictures import CAMERA, ate_m, black, camera_path, picture

import cuboid
from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.frame import Frame
from cuboid.ground.geometry import se3
from cuboid.inputs.readers import open_recording
from cuboid.method.poses.sources import BridgedPoses, EstimatedPoses, GivenPoses
from cuboid.results.files import Results, read_run, read_trajectory
from cuboid.runs.pipeline.run import track_recording

PATH = camera_path(30, 45.0)


@pytest.fixture(scope="module")
def pictures() -> list[Frame]:
    return [picture(T, k) for k, T in enumerate(PATH)]


def test_given_poses_are_taken_as_they_are(pictures: list[Frame]) -> None:
    source = GivenPoses()
    posed = source.locate(replace(pictures[3], T_world_camera=PATH[3]))
    np.testing.assert_array_equal(posed.T_world_camera, PATH[3])
    assert not posed.moved
    assert source.trajectory() is None
    with pytest.raises(FrameError, match="the frame has no camera pose"):
        source.locate(pictures[3])


def test_gaps_between_given_poses_are_bridged(pictures: list[Frame]) -> None:
    def given(index: int) -> np.ndarray:
        if index == 0 or 8 <= index < 20:
            raise FrameError("the frame has no camera pose")
        return PATH[index]

    source = BridgedPoses(CAMERA, given)
    with pytest.raises(FrameError, match="the frame has no camera pose"):
        source.locate(pictures[0])
    found = [source.locate(frame).T_world_camera for frame in pictures[1:]]
    for k, T in enumerate(found, start=1):
        away = se3.log(se3.inverse(PATH[k]) @ T)
        bridged = 8 <= k < 20
        assert np.linalg.norm(away[:3]) < (0.015 if bridged else 1e-12), k
        assert np.linalg.norm(away[3:]) < (0.01 if bridged else 1e-12), k


def test_a_covered_lens_is_not_bridged(pictures: list[Frame]) -> None:
    def given(index: int) -> np.ndarray:
        if index >= 4:
            raise FrameError("the frame has no camera pose")
        return PATH[index]

    source = BridgedPoses(CAMERA, given)
    for frame in pictures[:6]:
        source.locate(frame)
    with pytest.raises(FrameError, match="the camera is lost"):
        source.locate(black(6))


class Corrected:
    """An estimator whose first keyframe is corrected by a bit more with every frame."""

    def __init__(self, steps_m: list[float]) -> None:
        from cuboid.method.poses import PoseEstimator

        self._real = PoseEstimator(CAMERA)
        self._steps_m = steps_m

    @property
    def keyframes(self):
        return self._real.keyframes

    def update(self, frame: Frame):
        estimate = self._real.update(frame)
        self.keyframes[0].T_world_camera = se3.exp([self._steps_m.pop(0), 0, 0, 0, 0, 0])
        return estimate


def test_small_corrections_wait_until_they_add_up(pictures: list[Frame]) -> None:
    source = EstimatedPoses(CAMERA, min_shift_m=0.005)
    source._estimator = Corrected([0.0, 0.002, 0.004, 0.006, 0.007, 0.02])
    moved = [source.locate(frame).moved for frame in pictures[:6]]
    assert [list(m) for m in moved] == [[], [], [], [0], [], [0]]
    np.testing.assert_allclose(moved[3][0][:3, 3], [0.006, 0, 0], atol=1e-12)
    np.testing.assert_allclose(moved[5][0][:3, 3], [0.014, 0, 0], atol=1e-12)


def test_objects_are_tracked_without_given_poses(tmp_path: Path, pictures: list[Frame]) -> None:
    """The default where the recording has none; lost frames add nothing; both trajectories are written."""
    folder = tmp_path / "recording"
    for name in ("color", "depth"):
        (folder / name).mkdir(parents=True)
    for k in range(30):
        frame = black(k) if k in (15, 16) else pictures[k]
        depth_m = np.where(frame.depth_m > 0, frame.depth_m, 0.4)
        cv2.imwrite(str(folder / "color" / f"{k:06d}.png"), frame.color[..., ::-1])
        cv2.imwrite(str(folder / "depth" / f"{k:06d}.png"), np.rint(depth_m * 1000).astype(np.uint16))
    camera = (CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy)
    recording = open_recording(folder, intrinsics=camera, depth_scale=1000)
    outcome = track_recording(recording, tmp_path / "out")
    report = read_run(tmp_path / "out" / "run.json")
    assert report.poses == "estimated"
    assert [frame for frame, _ in report.skipped] == [15, 16]
    assert report.milliseconds["poses"].median_ms > 0
    assert outcome.objects
    there = [k for k in range(30) if k not in (15, 16)]
    for name in ("trajectory.txt", "trajectory_online.txt"):
        rows = read_trajectory(tmp_path / "out" / name)
        assert ate_m([row.T_world_camera for row in rows], [PATH[k] for k in there]) < 0.008, name
    # the boxes stand in the world of the first camera
    box = min((o.box for o in outcome.objects), key=lambda b: np.abs(b.size - [0.4, 0.3, 0.3]).sum())
    center = se3.transform(PATH[0], box.center)
    assert np.linalg.norm(center - [-0.6, 0.5, 0.15]) < 0.06


def test_frames_without_poses_are_posed_by_the_video_and_lost_ones_say_so(tmp_path: Path) -> None:
    tracker, truth = cuboid.Tracker(CAMERA), camera_path(24, angle_deg=20.0)
    for index, T in enumerate(truth):
        plain = replace(black(index), depth_m=np.full((CAMERA.height, CAMERA.width), 0.4, np.float32))
        result = tracker.update(plain if index == 12 else picture(T, index))
        if index == 12:
            assert isinstance(result, cuboid.SkippedFrame)
            assert "camera is lost" in result.reason
            assert result.sightings == ()
        else:
            assert isinstance(result, cuboid.FrameResult), index
    assert tracker.poses == "estimated"
    assert sorted(tracker.trajectory) == [k for k in range(24) if k != 12]
    assert len(tracker.objects) >= 3
    tracker.save(tmp_path / "out")
    found = Results(tmp_path / "out")
    assert [frame for frame, _ in found.report.skipped] == [12]
    for index, row in found.poses.items():
        np.testing.assert_allclose(row.T_world_camera, tracker.trajectory[index], atol=1e-5)
