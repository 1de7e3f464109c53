"""The source of frames that stands between a driver and the tracker."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import pytest
from played import CALIBRATION, SIZE, PlayedDriver, color_image, depth_image, pose

import cuboid
from cuboid.ground.core.errors import InputError, MissingExtraError, OutputError
from cuboid.inputs.cameras import CAMERAS, LiveCamera, Shot
from cuboid.inputs.cameras.latest import LatestQueue
from cuboid.inputs.readers import Calibration, DepthCamera, open_recording
from cuboid.results.files import read_run, read_tracks
from cuboid.runs.pipeline.options import RunHooks, TrackOptions
from cuboid.runs.pipeline.run import track_recording
from cuboid.runs.pipeline.streaming import FrameSource
from fakes import FakeTracker


def test_a_camera_is_a_source_and_a_recording_is_none() -> None:
    assert isinstance(LiveCamera(PlayedDriver(1)), FrameSource)
    assert not isinstance(cuboid.Recording, FrameSource)


def test_frames_come_with_depth_in_metres_and_their_poses() -> None:
    driver = PlayedDriver(3)
    with LiveCamera(driver) as camera:
        frames = list(camera)
    assert [frame.index for frame in frames] == [0, 1, 2]
    assert frames[2].timestamp_s == pytest.approx(100.0 + 2 / 30)
    np.testing.assert_array_equal(frames[2].color, color_image(2))
    np.testing.assert_allclose(frames[2].depth_m, depth_image(2) / 1000.0, atol=1e-6)
    np.testing.assert_allclose(frames[2].T_world_camera, pose(2))
    assert (driver.closed, camera.dropped, camera.warnings) == (1, 0, [])


def test_depth_of_a_camera_of_its_own_is_carried_into_color() -> None:
    beside = np.eye(4)
    beside[0, 3] = 0.05
    depth_camera = DepthCamera(32.0, 32.0, 16.0, 12.0, (32, 24), beside)
    calibration = Calibration(64.0, 64.0, 32.0, 24.0, SIZE, "the fake", depth_camera=depth_camera)
    driver = PlayedDriver(1, calibration=calibration)
    shot = driver.take(0.1)
    half = Shot(shot.timestamp_s, shot.color, np.full((24, 32), 1500, np.uint16))
    driver = PlayedDriver(0, calibration=calibration, then=iter([half]).__next__, poses=False)
    with LiveCamera(driver) as camera:
        frame = next(iter(camera))
    assert frame.depth_m.shape == (48, 64)
    assert frame.depth_m[frame.depth_m > 0].max() == pytest.approx(1.5)
    assert (frame.depth_m > 0).mean() > 0.9


def test_what_nobody_takes_is_dropped_oldest_first_and_counted() -> None:
    queue: LatestQueue[int] = LatestQueue(3)
    for k in range(10):
        queue.put(k)
    queue.end()
    assert [queue.get(), queue.get(), queue.get(), queue.get()] == [7, 8, 9, None]
    assert queue.dropped == 7


def test_a_slow_tracker_gets_new_frames_and_the_report_says_how_many_it_missed(tmp_path: Path) -> None:
    class Slow(FakeTracker):
        def update(self, frame, anchor=0):
            time.sleep(0.05)
            return super().update(frame, anchor)

    with LiveCamera(PlayedDriver(60, paced=False, every_s=0.005)) as camera:
        track_recording(camera, tmp_path / "out", hooks=RunHooks(make_tracker=Slow))
    run = read_run(tmp_path / "out" / "run.json")
    assert run.complete
    assert run.frames_dropped > 20
    assert run.frames_dropped + run.frames_read == 60
    assert (run.recording, run.format, run.frames_used) == ("a played camera", "camera", run.frames_read)


@pytest.mark.parametrize(("form", "named"), [("plain", "plain"), ("mcap", "ros-bag")])
def test_the_kept_frames_tracked_again_give_the_same(tmp_path: Path, form: str, named: str) -> None:
    if form == "mcap":
        pytest.importorskip("rosbags", reason="bags are written with rosbags")
    with LiveCamera(PlayedDriver(9, spoil=(4,)), record=tmp_path / "kept", form=form) as camera:
        track_recording(
            camera, tmp_path / "live", TrackOptions(limit=7, threads=2), hooks=RunHooks(make_tracker=FakeTracker)
        )
    assert [w for w in camera.warnings if "1 frames of a played camera could not be used" in w]
    run = read_run(tmp_path / "live" / "run.json")
    assert (run.frames_used, run.format) == (7, named)
    kept = open_recording(tmp_path / "kept")
    assert 7 <= len(kept) <= 8  # the one that was made ready behind the last
    np.testing.assert_array_equal(kept.read(5).color, color_image(6))  # the spoilt one has no number
    np.testing.assert_allclose(kept.read(5).depth_m, depth_image(6) / 1000.0, atol=1e-6)
    track_recording(kept, tmp_path / "again", TrackOptions(limit=7), hooks=RunHooks(make_tracker=FakeTracker))
    for name in ("tracks.csv", "objects.json", "trajectory.txt"):
        assert (tmp_path / "live" / name).read_bytes() == (tmp_path / "again" / name).read_bytes()


def test_every_and_limit_mean_what_they_mean_for_a_recording(tmp_path: Path) -> None:
    with LiveCamera(PlayedDriver(100)) as camera:
        outcome = track_recording(
            camera, tmp_path / "out", TrackOptions(every=3, limit=4), hooks=RunHooks(make_tracker=FakeTracker)
        )
    assert (outcome.report.frames_read, outcome.report.complete) == (4, True)
    assert [row.frame for row in read_tracks(tmp_path / "out" / "tracks.csv")] == [3, 6, 9]
    assert open_recording is not None


def fail() -> Shot | None:
    raise RuntimeError("xioctl(VIDIOC_DQBUF): No such device")


def test_a_camera_that_is_unplugged_ends_the_run_with_a_whole_result(tmp_path: Path) -> None:
    with LiveCamera(PlayedDriver(6, then=fail)) as camera:
        outcome = track_recording(camera, tmp_path / "out", hooks=RunHooks(make_tracker=FakeTracker))
    assert outcome.report.complete
    assert outcome.report.frames_used == 6
    assert "failed: RuntimeError: xioctl(VIDIOC_DQBUF): No such device" in outcome.report.warnings[0]


def test_a_camera_that_falls_silent_ends_the_run(tmp_path: Path) -> None:
    with LiveCamera(PlayedDriver(3, then=lambda: time.sleep(0.01)), silence_s=0.05) as camera:
        outcome = track_recording(camera, tmp_path / "out", hooks=RunHooks(make_tracker=FakeTracker))
    assert outcome.report.frames_used == 3
    assert "gave no frame for 0.05 s" in outcome.report.warnings[0]


def test_a_camera_that_gives_nothing_is_refused_and_leaves_nothing(tmp_path: Path) -> None:
    camera = LiveCamera(PlayedDriver(0, then=fail), record=tmp_path / "kept")
    with camera, pytest.raises(InputError, match="failed: RuntimeError"):
        track_recording(camera, tmp_path / "out", hooks=RunHooks(make_tracker=FakeTracker))
    assert list(tmp_path.iterdir()) == []


def test_only_frames_without_depth_are_refused() -> None:
    with LiveCamera(PlayedDriver(2, spoil=(0, 1))) as camera, pytest.raises(InputError, match="2 frames of a played"):
        list(camera)


def test_close_ends_a_waiting_iteration_at_once() -> None:
    with LiveCamera(PlayedDriver(2, then=lambda: time.sleep(0.01))) as camera:
        for frame in camera:
            if frame.index == 1:
                camera.close()
    assert camera.warnings == []


def test_wrong_calls_are_refused_with_what_was_expected(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="exists; frames are recorded into a new folder"):
        LiveCamera(PlayedDriver(1), record=tmp_path)
    with pytest.raises(InputError, match="unknown camera 'kinect9'; there are: oak, orbbec, realsense, record3d, ros2"):
        cuboid.open_camera("kinect9")
    with pytest.raises(InputError, match="expected OPTION=VALUE"):
        cuboid.open_camera("realsense:831612070538,640x480")
    with pytest.raises(InputError, match=r"unknown option 'speed'; there are: serial, size, rate, file"):
        cuboid.open_camera("realsense:speed=3")


@pytest.mark.parametrize(
    ("camera", "module", "part"),
    [
        ("orbbec", "pyorbbecsdk", "pip install --no-deps pyorbbecsdk2"),
        ("oak", "depthai", r"needs depthai, which is not installed: .* '\.\[oak\]'"),
        ("record3d", "record3d", "needs record3d, which is not installed: pip install record3d"),
    ],
)
def test_what_a_camera_needs_is_said(camera: str, module: str, part: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MissingExtraError, match=part):
        cuboid.open_camera(camera)


def test_a_camera_of_another_package_is_opened_by_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    monkeypatch.setitem(CAMERAS._items, "toy", lambda options: asked.append(options) or PlayedDriver(2))
    with cuboid.open_camera("toy:serial=7,size=64x48") as camera:
        assert len(list(camera)) == 2
    assert asked == [{"serial": "7", "size": "64x48"}]
    assert CALIBRATION.size == (camera.intrinsics.width, camera.intrinsics.height)
