"""The OAK driver: its messages and their pairing with depthai itself where it is installed, the device as a fake."""

from __future__ import annotations

from datetime import timedelta
from itertools import islice
from typing import Any, ClassVar

import numpy as np
import pytest
from played import answering, color_image, depth_image, install, lacking

import cuboid
from cuboid.ground.core.errors import InputError
from cuboid.inputs.cameras.oak import COLOR, DEPTH, WAITING_MESSAGES, calibration_of, shot_of

K = [[64.0, 0.0, 32.0], [0.0, 64.0, 24.0], [0.0, 0.0, 1.0]]


Transformation = answering("Transformation", getIntrinsicMatrix=K)


class ImgFrame:
    """An image message."""

    def __init__(self, pixels: np.ndarray, k: int) -> None:
        self._pixels, self._k = pixels, k

    def getCvFrame(self) -> np.ndarray:
        return self._pixels

    def getFrame(self) -> np.ndarray:
        return self._pixels

    def getTransformation(self) -> Any:
        return Transformation()

    def getWidth(self) -> int:
        return self._pixels.shape[1]

    def getHeight(self) -> int:
        return self._pixels.shape[0]

    def getTimestamp(self) -> timedelta:
        return timedelta(seconds=k_s(self._k))


def k_s(k: int) -> float:
    return 5.0 + k / 30.0


class Port:
    """An input, an output, or the inputs of a node by name."""

    def __init__(self) -> None:
        self.linked: list[Port] = []
        self.inputs: dict[str, Port] = {}

    def __getitem__(self, name: str) -> Port:
        return self.inputs.setdefault(name, Port())

    def link(self, other: Port) -> None:
        other.linked.append(self)

    def createOutputQueue(self, maxSize: int, blocking: bool) -> MessageQueue:
        assert (maxSize, blocking) == (WAITING_MESSAGES, False)
        return MessageQueue()


class MessageQueue:
    """Three pairs, then nothing."""

    def __init__(self) -> None:
        self._k = 0

    def get(self, timeout: timedelta) -> dict[str, ImgFrame] | None:
        assert isinstance(timeout, timedelta)
        k, self._k = self._k, self._k + 1
        if k >= 3:
            return None
        return {COLOR: ImgFrame(color_image(k)[..., ::-1], k), DEPTH: ImgFrame(depth_image(k), k)}


class Camera:
    def build(self, socket: str) -> Camera:
        self.socket = socket
        return self

    def requestOutput(self, size: tuple[int, int], fps: float, enableUndistortion: bool | None = None) -> Port:
        assert (self.socket == "A") == bool(enableUndistortion)
        self.size = size
        return Port()


class StereoDepth:
    def __init__(self) -> None:
        self.left, self.right, self.depth, self.inputAlignTo = Port(), Port(), Port(), Port()


class ImageAlign:
    def __init__(self) -> None:
        self.input, self.inputAlignTo, self.outputAligned = Port(), Port(), Port()


class Sync:
    def __init__(self) -> None:
        self.inputs, self.out = Port(), Port()

    def setSyncThreshold(self, threshold: timedelta) -> None:
        assert threshold == timedelta(seconds=0.5 / 30)


class Device:
    platform = "RVC2"

    def __init__(self, info: str | None = None) -> None:
        if info not in (None, "1844"):
            raise RuntimeError("Cannot find any device with given deviceInfo")

    def getDeviceName(self) -> str:
        return "OAK-D"

    def getDeviceId(self) -> str:
        return "1844"

    def getPlatform(self) -> str:
        return self.platform


class Pipeline:
    made: ClassVar[list[Pipeline]] = []

    def __init__(self, defaultDevice: Device) -> None:
        self._device, self.nodes, self._running = defaultDevice, [], False
        self.made.append(self)

    def create(self, kind: type) -> Any:
        self.nodes.append(kind())
        return self.nodes[-1]

    def getDefaultDevice(self) -> Device:
        return self._device

    def start(self) -> None:
        self._running = True

    def isRunning(self) -> bool:
        return self._running

    def stop(self) -> None:
        self._running = False


class Node:
    Camera, StereoDepth, Sync, ImageAlign = Camera, StereoDepth, Sync, ImageAlign


class CameraBoardSocket:
    CAM_A, CAM_B, CAM_C = "A", "B", "C"


class Platform:
    RVC2, RVC4 = "RVC2", "RVC4"


MEMBERS = {
    "Device": Device,
    "DeviceInfo": str,
    "Pipeline": Pipeline,
    "CameraBoardSocket": CameraBoardSocket,
    "Platform": Platform,
    "node": Node,
}


@pytest.mark.parametrize("platform", ["RVC2", "RVC4"])
def test_a_device_gives_frames(monkeypatch: pytest.MonkeyPatch, platform: str) -> None:
    install(monkeypatch, "depthai", MEMBERS)
    monkeypatch.setattr(Device, "platform", platform)
    with cuboid.open_camera("oak:id=1844,size=64x48") as camera:
        assert (camera.name, camera.depth_units_per_metre) == ("OAK-D 1844", 1000.0)
        frames = list(islice(camera, 2))
    assert not Pipeline.made[-1].isRunning()
    assert (camera.intrinsics.fx, camera.intrinsics.cx, camera.intrinsics.width) == (64.0, 32.0, 64)
    np.testing.assert_array_equal(frames[0].color, color_image(1))  # the first told the intrinsics
    np.testing.assert_allclose(frames[0].depth_m, depth_image(1) / 1000.0, atol=1e-6)
    assert frames[1].timestamp_s == pytest.approx(k_s(2))
    stereo, sync = (next(n for n in Pipeline.made[-1].nodes if isinstance(n, kind)) for kind in (StereoDepth, Sync))
    align = next((n for n in Pipeline.made[-1].nodes if isinstance(n, ImageAlign)), stereo)
    assert align.inputAlignTo.linked, "depth is aligned to color"
    assert sync.inputs[DEPTH].linked == [align.outputAligned if platform == "RVC4" else stereo.depth]
    assert stereo.left.linked
    assert stereo.right.linked


def test_no_device_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    install(monkeypatch, "depthai", MEMBERS)
    with pytest.raises(InputError, match="--camera oak: 99 cannot be opened: Cannot find any device"):
        cuboid.open_camera("oak:id=99")


def test_the_fake_has_no_more_than_the_library() -> None:
    dai = pytest.importorskip("depthai", reason="depthai is not installed: pip install '.[oak]'")
    real = [name for name in MEMBERS if not hasattr(dai, name)]
    pairs = [(Device, dai.Device), (Pipeline, dai.Pipeline), (Node, dai.node), (Platform, dai.Platform)]
    pairs += [(ImgFrame, dai.ImgFrame), (Transformation, dai.ImgTransformation), (MessageQueue, dai.MessageQueue)]
    pairs += [(CameraBoardSocket, dai.CameraBoardSocket), (ImageAlign, dai.node.ImageAlign)]
    missing = [f"{fake.__name__}: {name}" for fake, one in pairs for name in lacking(fake, one)]
    assert [*real, *missing] == ["Device: platform", "Pipeline: made"]  # the fakes' own
    for kind, names in ((dai.node.StereoDepth, vars(StereoDepth())), (dai.node.ImageAlign, vars(ImageAlign()))):
        assert all(hasattr(kind, name) for name in names)


def test_messages_of_the_library_are_paired_and_read() -> None:
    dai = pytest.importorskip("depthai", reason="depthai is not installed: pip install '.[oak]'")
    pipeline = dai.Pipeline(False)  # what runs on this side of the cable alone
    sync = pipeline.create(dai.node.Sync)
    sync.setRunOnHost(True)
    sync.setSyncThreshold(timedelta(milliseconds=10))
    feeds = {name: sync.inputs[name].createInputQueue() for name in (COLOR, DEPTH)}
    queue = sync.out.createOutputQueue(maxSize=WAITING_MESSAGES, blocking=False)
    pipeline.start()
    color, depth = dai.ImgFrame(), dai.ImgFrame()
    color.setCvFrame(np.ascontiguousarray(color_image(3)[..., ::-1]), dai.ImgFrame.Type.BGR888i)
    depth.setCvFrame(depth_image(3), dai.ImgFrame.Type.RAW16)
    lens = color.getTransformation()
    lens.setIntrinsicMatrix(K)
    color.setTransformation(lens)
    for name, message in ((COLOR, color), (DEPTH, depth)):
        message.setTimestamp(timedelta(seconds=k_s(3)))
        feeds[name].send(message)
    group = queue.get(timedelta(seconds=10))
    pipeline.stop()
    shot = shot_of(group)
    np.testing.assert_array_equal(shot.color, color_image(3))
    np.testing.assert_array_equal(shot.depth, depth_image(3))
    assert shot.timestamp_s == pytest.approx(k_s(3))
    found = calibration_of(color, "OAK")
    assert (found.fx, found.cy, found.size) == (64.0, 24.0, (64, 48))
    with pytest.raises(InputError, match="does not know its intrinsics"):
        calibration_of(depth, "OAK")
