"""The Orbbec driver with a fake of the SDK, which has no more than the SDK itself where that is installed."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from played import answering, color_image, depth_image, install, lacking

import cuboid
from cuboid.ground.core.errors import FrameError, InputError
from cuboid.inputs.cameras.orbbec import CONVERSIONS, rgb_of


class OBError(Exception):
    pass


class OBFormat:
    RGB, BGR, MJPG, YUYV, UYVY, Y16 = (f"OBFormat.{name}" for name in ("RGB", "BGR", "MJPG", "YUYV", "UYVY", "Y16"))


class OBSensorType:
    COLOR_SENSOR, DEPTH_SENSOR = "color", "depth"


class OBFrameAggregateOutputMode:
    FULL_FRAME_REQUIRE = "full"


class VideoFrame:
    def __init__(self, data: bytes, size: tuple[int, int], kind: str, k: int = 0) -> None:
        self._data, self._size, self._kind, self._k = data, size, kind, k

    def get_data(self) -> np.ndarray:
        return np.frombuffer(self._data, np.uint8)

    def get_width(self) -> int:
        return self._size[0]

    def get_height(self) -> int:
        return self._size[1]

    def get_format(self) -> str:
        return self._kind

    def get_timestamp_us(self) -> int:
        return 7_000_000 + 33_000 * self._k


class DepthFrame(VideoFrame):
    def get_depth_scale(self) -> float:
        return 0.5  # the pixels count half millimetres


class FrameSet:
    def __init__(self, k: int) -> None:
        self._k = k

    def get_color_frame(self) -> VideoFrame | None:
        if self._k == 0:
            return None
        return VideoFrame(color_image(self._k).tobytes(), (64, 48), OBFormat.RGB, self._k)

    def get_depth_frame(self) -> DepthFrame:
        return DepthFrame((2 * depth_image(self._k)[::2, ::2]).tobytes(), (32, 24), OBFormat.Y16, self._k)


class Parameters:
    """Attributes as given."""

    def __init__(self, **values: Any) -> None:
        vars(self).update(values)


def lens(**values: float) -> Parameters:
    return Parameters(**{**dict.fromkeys(("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"), 0.0), **values})


PARAM = Parameters(
    rgb_intrinsic=Parameters(fx=64.0, fy=65.0, cx=32.0, cy=24.0, width=64, height=48),
    depth_intrinsic=Parameters(fx=32.0, fy=32.0, cx=16.0, cy=12.0, width=32, height=24),
    rgb_distortion=lens(k1=0.01, p1=0.001, k3=0.002),
    depth_distortion=lens(),
    transform=Parameters(rot=np.eye(3, dtype=np.float32), transform=np.array([-25.0, 0, 0], np.float32)),
)


class StreamProfileList:
    def get_video_stream_profile(self, width: int, height: int, kind: str, fps: int) -> str:
        if (width, height) != (64, 48):
            raise OBError("no such profile")
        return f"{width}x{height} {kind} {fps}"

    def get_default_video_stream_profile(self) -> str:
        return "default"


class Config:
    def enable_stream(self, profile: str) -> None:
        assert isinstance(profile, str)

    def set_frame_aggregate_output_mode(self, mode: str) -> None:
        assert mode == OBFrameAggregateOutputMode.FULL_FRAME_REQUIRE


class Pipeline:
    def __init__(self, device: Any) -> None:
        self._k = -1

    def get_stream_profile_list(self, sensor: str) -> StreamProfileList:
        return StreamProfileList()

    def enable_frame_sync(self) -> None:
        pass

    def start(self, config: Config) -> None:
        self._k = 0

    def get_camera_param(self) -> Parameters:
        return PARAM

    def wait_for_frames(self, timeout_ms: int) -> FrameSet | None:
        assert isinstance(timeout_ms, int)
        k, self._k = self._k, self._k + 1
        return FrameSet(k) if k < 4 else None

    def stop(self) -> None:
        self._k = 99


DeviceInfo = answering("DeviceInfo", get_name="Gemini 335", get_serial_number="CP15")
Device = answering("Device", get_device_info=DeviceInfo())


class DeviceList:
    count = 1

    def get_count(self) -> int:
        return self.count

    def get_device_by_index(self, index: int) -> Any:
        return Device()

    def get_device_by_serial_number(self, serial: str) -> Any:
        if serial != "CP15":
            raise OBError(f"Device not found! {serial}")
        return Device()


Context = answering("Context", query_devices=DeviceList())
CLASSES = (OBError, OBFormat, OBSensorType, OBFrameAggregateOutputMode, Config, Pipeline, Context)
OTHERS = (VideoFrame, DepthFrame, FrameSet, StreamProfileList, DeviceInfo, Device, DeviceList)
MEMBERS = {kind.__name__: kind for kind in CLASSES}


@pytest.mark.parametrize("size", ["64x48", "1280x720"])
def test_a_device_gives_frames(monkeypatch: pytest.MonkeyPatch, size: str) -> None:
    install(monkeypatch, "pyorbbecsdk", MEMBERS)
    with cuboid.open_camera(f"orbbec:serial=CP15,size={size}") as camera:
        assert camera.name == "Gemini 335 CP15"
        calibration = camera._driver.calibration
        frame = next(iter(camera))  # the first set had no color
    assert calibration.distortion == (0.01, 0.0, 0.001, 0.0, 0.002, 0.0, 0.0, 0.0)
    np.testing.assert_allclose(calibration.depth_camera.T_color_depth[:3, 3], [-0.025, 0, 0])
    assert frame.timestamp_s == pytest.approx(7.033)
    assert np.median(frame.depth_m[frame.depth_m > 0]) == pytest.approx(1.501)


@pytest.mark.parametrize(("spec", "count"), [("orbbec", 0), ("orbbec:serial=X", 1)])
def test_no_device_is_one_line(monkeypatch: pytest.MonkeyPatch, spec: str, count: int) -> None:
    install(monkeypatch, "pyorbbecsdk", MEMBERS)
    monkeypatch.setattr(DeviceList, "count", count)
    with pytest.raises(
        InputError, match=r"--camera orbbec: (no camera is there|the camera cannot be opened: Device not)"
    ):
        cuboid.open_camera(spec)


@pytest.mark.parametrize("kind", ["RGB", "BGR", "YUYV", "UYVY", "MJPG"])
def test_color_comes_in_several_forms(kind: str) -> None:
    image = np.full((48, 64, 3), (200, 60, 90), np.uint8)
    code = {"YUYV": cv2.COLOR_RGB2YUV_YUYV, "UYVY": cv2.COLOR_RGB2YUV_UYVY, "BGR": cv2.COLOR_RGB2BGR}.get(kind)
    data = image if code is None else cv2.cvtColor(image, code)
    raw = cv2.imencode(".jpg", image[..., ::-1])[1] if kind == "MJPG" else data
    found = rgb_of(VideoFrame(raw.tobytes(), (64, 48), f"OBFormat.{kind}"))
    np.testing.assert_allclose(found, image, atol=4)
    assert kind in CONVERSIONS or kind in ("RGB", "MJPG")
    with pytest.raises(FrameError, match="color image"):
        rgb_of(VideoFrame(b"12345", (64, 48), f"OBFormat.{kind}"))


def test_the_fake_has_no_more_than_the_sdk() -> None:
    sdk = pytest.importorskip("pyorbbecsdk", reason="the SDK is not installed: pip install --no-deps pyorbbecsdk2")
    missing = [
        f"{fake.__name__}: {name}"
        for fake in (*CLASSES, *OTHERS)
        for name in lacking(fake, getattr(sdk, fake.__name__))
    ]
    assert missing == ["DeviceList: count"]  # the fake's own
    param = sdk.OBCameraParam()
    for name, values in vars(PARAM).items():
        assert all(hasattr(getattr(param, name), field) for field in vars(values)), name
    assert str(sdk.OBFormat.RGB).endswith(".RGB")
    with pytest.raises(InputError, match="no camera is there"):
        cuboid.open_camera("orbbec")
