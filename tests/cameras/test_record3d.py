"""The Record3D driver with a fake of its library, which has no more than that where it is installed."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from played import install, lacking

import cuboid
from cuboid.ground.core.errors import InputError


class DeviceInfo:
    udid = "00008101"
    product_id = 4776


class CameraPose:
    qx, qy, qz, qw, tx, ty, tz = 0.0, 0.0, 0.0, 1.0, 0.1, 0.2, 0.3


class IntrinsicMatrixCoeffs:
    fx, fy, tx, ty = 700.0, 710.0, 360.0, 480.0


class Record3DStream:
    """Sends 720 x 960 color with 192 x 256 depth from a thread of its own, as the library does."""

    frames = 3

    def __init__(self) -> None:
        self.on_new_frame: Callable[[], Any] = lambda: None
        self.on_stream_stopped: Callable[[], Any] = lambda: None
        self._k = -1

    @staticmethod
    def get_connected_devices() -> list[DeviceInfo]:
        return [DeviceInfo()]

    def connect(self, device: DeviceInfo) -> None:
        assert isinstance(device, DeviceInfo)
        threading.Thread(target=self._send, daemon=True).start()

    def _send(self) -> None:
        for k in range(self.frames):
            self._k = k
            self.on_new_frame()
            time.sleep(0.1)
        self.on_stream_stopped()

    def disconnect(self) -> None:
        pass

    def get_rgb_frame(self) -> np.ndarray:
        return np.full((960, 720, 3), (10 * self._k, 20, 30), np.uint8)

    def get_depth_frame(self) -> np.ndarray:
        return np.full((256, 192), 1.25, np.float32)

    def get_confidence_frame(self) -> np.ndarray:
        sure = np.full((256, 192), 2, np.uint8)
        sure[:128] = 0
        return sure

    def get_intrinsic_mat(self) -> IntrinsicMatrixCoeffs:
        return IntrinsicMatrixCoeffs()

    def get_camera_pose(self) -> CameraPose:
        return CameraPose()


def test_a_phone_gives_frames_and_poses(monkeypatch: pytest.MonkeyPatch) -> None:
    install(monkeypatch, "record3d", {"Record3DStream": Record3DStream})
    with cuboid.open_camera("record3d") as camera:
        assert camera.has_poses
        frames = list(camera)
    assert frames
    K, frame = camera.intrinsics, frames[0]
    assert (K.width, K.height, K.fx, K.cx) == (720, 960, 700.0, 360.0)
    upper, lower = frame.depth_m[:400], frame.depth_m[500:]
    assert (upper == 0).all(), "low confidence is no reading"
    assert np.median(lower) == pytest.approx(1.25)
    T = frame.T_world_camera
    np.testing.assert_allclose(T[:3, 3], [0.1, 0.2, 0.3])
    np.testing.assert_allclose(T[:3, :3], np.diag([1.0, -1.0, -1.0]))  # ARKit's axes to ours


def test_another_device_is_not_there(monkeypatch: pytest.MonkeyPatch) -> None:
    install(monkeypatch, "record3d", {"Record3DStream": Record3DStream})
    with pytest.raises(InputError, match="no device 'mine' is there; connect it by USB"):
        cuboid.open_camera("record3d:id=mine")


def test_the_fake_has_no_more_than_the_library() -> None:
    real = pytest.importorskip("record3d", reason="the library is not installed: pip install record3d")
    for fake in (DeviceInfo, CameraPose, IntrinsicMatrixCoeffs, Record3DStream):
        assert lacking(fake, getattr(real, fake.__name__)) in ([], ["frames"])  # the fake's own
    stream = real.Record3DStream()
    stream.on_new_frame = stream.on_stream_stopped = threading.Event().set
    assert stream.get_depth_frame() is not None
