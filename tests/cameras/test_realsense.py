"""The RealSense driver with the SDK itself: its software device, and its playback of a real recording."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cuboid
from cuboid.cli import main
from cuboid.ground.core.errors import InputError
from cuboid.inputs.cameras import LiveCamera
from cuboid.inputs.cameras.realsense import RealSense
from cuboid.results.files import read_run

rs = pytest.importorskip(
    "pyrealsense2",
    reason="the SDK, or the system's libusb that it loads, is not installed: pip install '.[realsense]'",
    exc_type=ImportError,
)

WIDTH, HEIGHT = 64, 48


def sample(data_dir: Path) -> Path:
    return data_dir / "containers" / "realsense" / "single_depth_color_640x480.bag"


def test_a_real_recording_is_played_back(data_dir: Path) -> None:
    read = cuboid.open_recording(sample(data_dir))
    with cuboid.open_camera(f"realsense:file={sample(data_dir)}") as camera:
        assert camera.name == "Intel RealSense D435 728612070259"
        frames = list(camera)
    assert camera.intrinsics == read.intrinsics
    assert len(frames) == 1
    frame, same = frames[0], read.read(0)
    np.testing.assert_array_equal(frame.color, same.color)
    both = (frame.depth_m > 0) & (same.depth_m > 0)  # the SDK pairs color with the other of the two depth images
    assert both.mean() > 0.9
    assert np.median(np.abs(frame.depth_m - same.depth_m)[both]) < 0.01


def test_the_command_tracks_and_keeps_it(
    data_dir: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ["track", "--camera", f"realsense:file={sample(data_dir)}", "--output", str(tmp_path / "out")]
    assert main([*words, "--record", str(tmp_path / "kept"), "--threads", "1"]) == 0, capfd.readouterr().err
    run = read_run(tmp_path / "out" / "run.json")
    assert (run.frames_used, run.complete, run.format) == (1, True, "plain")
    assert len(cuboid.open_recording(tmp_path / "kept")) == 1


class SoftwareCamera:
    """The SDK's software device, and a thread that feeds it."""

    def __init__(self, model: Any) -> None:
        self.device = rs.software_device()
        self.device.register_info(rs.camera_info.name, "Software")
        self.device.register_info(rs.camera_info.serial_number, "0815")
        self._streams = [
            self._stream(rs.stream.depth, rs.format.z16, 2, 0, model),
            self._stream(rs.stream.color, rs.format.rgb8, 3, 1, model),
        ]
        beside = rs.extrinsics()
        beside.rotation, beside.translation = [0, 1, 0, -1, 0, 0, 0, 0, 1], [0.015, 0, 0]  # columns
        self._streams[0][1].register_extrinsics_to(self._streams[1][1], beside)
        self.device.create_matcher(rs.matchers.default)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._feed, daemon=True)
        self._thread.start()

    def _stream(self, kind: Any, form: Any, size: int, uid: int, model: Any) -> tuple[Any, Any, int]:
        sensor = self.device.add_sensor("Stereo Module" if size == 2 else "RGB Camera")
        camera, stream = rs.intrinsics(), rs.video_stream()
        camera.width, camera.height, camera.model, camera.coeffs = WIDTH, HEIGHT, model, [0.01 if size == 3 else 0] * 5
        camera.fx = camera.fy = 64.0
        camera.ppx, camera.ppy = 32.0, 24.0
        stream.type, stream.uid, stream.fmt, stream.bpp, stream.fps = kind, uid, form, size, 30
        stream.width, stream.height, stream.intrinsics = WIDTH, HEIGHT, camera
        profile = sensor.add_video_stream(stream, True)
        if size == 2:
            sensor.add_read_only_option(rs.option.depth_units, 0.0001)
        return sensor, profile.as_video_stream_profile(), size

    def _feed(self) -> None:
        k = 0
        while not self._stop.wait(0.01):
            for sensor, profile, size in self._streams:
                frame = rs.software_video_frame()
                depth, color = np.full((HEIGHT, WIDTH), 15000 + k, np.uint16), np.zeros((HEIGHT, WIDTH, 3), np.uint8)
                color[..., 0] = k % 250
                frame.pixels, frame.bpp, frame.stride = (depth if size == 2 else color), size, WIDTH * size
                frame.timestamp, frame.frame_number, frame.profile = k * 33.0, k, profile
                frame.domain = rs.timestamp_domain.hardware_clock
                if size == 2:
                    frame.depth_units = 0.0001
                sensor.on_video_frame(frame)
            k += 1

    def close(self) -> None:
        self._stop.set()
        self._thread.join()


@pytest.fixture
def software() -> Iterator[SoftwareCamera]:
    made = SoftwareCamera(rs.distortion.brown_conrady)
    yield made
    made.close()


def test_a_software_device_streams(software: SoftwareCamera) -> None:
    driver = RealSense({"size": f"{WIDTH}x{HEIGHT}", "rate": "30"}, software.device)
    assert (driver.name, driver.depth_units_per_metre) == ("Software 0815", 10000.0)
    assert driver.calibration.distortion == pytest.approx((0.01,) * 5)
    depth_camera = driver.calibration.depth_camera
    np.testing.assert_allclose(depth_camera.T_color_depth[:3], [[0, -1, 0, 0.015], [1, 0, 0, 0], [0, 0, 1, 0]])
    shots = []
    until_s = time.monotonic() + 10
    while len(shots) < 3 and time.monotonic() < until_s:
        shots += [shot for shot in [driver.take(0.5)] if shot is not None]
    driver.close()
    for shot in shots:
        k = round(shot.timestamp_s / 0.033)
        assert (shot.color[..., 0] == k % 250).all()
        assert (shot.color[..., 1:] == 0).all()
        assert (shot.depth == 15000 + k).all()


def test_its_frames_reach_the_tracker_in_metres(software: SoftwareCamera) -> None:
    with LiveCamera(RealSense({"size": "64x48"}, software.device)) as camera:
        frame = next(iter(camera))
    assert np.median(frame.depth_m[frame.depth_m > 0]) == pytest.approx(1.5, abs=0.1)


def test_a_fisheye_is_refused() -> None:
    software = SoftwareCamera(rs.distortion.kannala_brandt4)
    try:
        with pytest.raises(InputError, match="its lens is of the kind 'kannala_brandt4'; expected none, brown_conrady"):
            RealSense({"size": "64x48"}, software.device)
    finally:
        software.close()


@pytest.mark.parametrize(
    ("spec", "part"),
    [
        ("realsense", "no camera is there"),
        ("realsense:file=nothing.bag", "nothing.bag: there is no such file"),
        ("realsense:size=big", "size must be a whole number, got 'big'"),
        ("realsense:rate=fast", "rate must be a whole number, got 'fast'"),
    ],
)
def test_a_wrong_call_is_one_line(spec: str, part: str) -> None:
    with pytest.raises(InputError, match=part):
        cuboid.open_camera(spec)


def test_a_file_of_something_else_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.bag").write_bytes(b"#ROSBAG V2.0\n" + bytes(300))
    with pytest.raises(InputError, match=r"a\.bag cannot be opened"):
        cuboid.open_camera(f"realsense:file={tmp_path / 'a.bag'}")
