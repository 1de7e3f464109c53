"""The node with several cameras: images of two cameras on a transport in this process give one map."""

from __future__ import annotations

import json
import time
from collections import defaultdict, deque
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="messages are made with rosbags: pip install '.[ros2]'")

import cuboid
from cuboid.cli import main
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.formats.ros_messages import RosMessages
from cuboid.ground.middleware.transport import Qos, Request
from cuboid.inputs.recordings.opening import open_recording
from cuboid.inputs.recordings.rig import RigRecording
from cuboid.results.files import Results
from cuboid.results.views.ros_objects import color_image, depth_image
from made_rigs import NAMES, POSES, THINGS, rig_document, write_rig

IMAGE, INFO = "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/CameraInfo"
FIRST_S = 1_700_000_000.0


class Bus:
    """A transport in this process: what is sent on a topic is kept, and what is put there is received."""

    name = "a bus"

    def __init__(self, messages: RosMessages) -> None:
        self.messages = messages
        self.kinds: dict[str, str] = {}
        self.waiting: dict[str, deque[bytes]] = defaultdict(deque)
        self.sent: dict[str, list[Any]] = defaultdict(list)
        self.closed = 0

    def put(self, topic: str, kind: str, message: Any) -> None:
        self.kinds[topic] = kind
        self.waiting[topic].append(self.messages.encode(message))

    def topics(self) -> dict[str, str]:
        return self.kinds

    def inlet(self, topic: str, kind: str, qos: Qos, kept: int, *, wakes: bool = True) -> Any:
        bus = self

        class In:
            def take(self) -> bytes | None:
                return bus.waiting[topic].popleft() if bus.waiting[topic] else None

        return In()

    def outlet(self, topic: str, kind: str, qos: Qos) -> Any:
        bus = self

        class Out:
            def wanted(self) -> bool:
                return True

            def send(self, data: bytes, time_ns: int) -> None:
                bus.sent[topic].append(bus.messages.decode(data, kind))

        return Out()

    def serve(self, service: str, kind: str) -> None:
        pass

    def requests(self) -> Iterator[Request]:
        return iter(())

    def declare(self, values: Any, change: Any) -> None:
        pass

    def wait(self, seconds: float) -> None:
        time.sleep(min(seconds, 0.005))

    def close(self) -> None:
        self.closed += 1


def play(bus: Bus, name: str, K: Intrinsics, frames: list[Frame]) -> None:
    """Put the images of a camera on the bus, as a driver does."""
    frame_id = f"{name}_optical"
    for frame in frames:
        time_ns = round((FIRST_S + frame.timestamp_s) * 1e9)
        bus.put(f"/{name}/color/image_raw/compressed", IMAGE, color_image(bus.messages, frame.color, time_ns, frame_id))
        depth = depth_image(bus.messages, frame.depth_m, time_ns, frame_id)
        bus.put(f"/{name}/depth/image_raw/compressedDepth", IMAGE, depth)
        bus.put(f"/{name}/color/camera_info", INFO, bus.messages.camera_info(K, time_ns, frame_id))


@pytest.fixture
def bus(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Bus:
    found = Bus(RosMessages("the tests", "ros2"))
    rig = open_recording(write_rig(tmp_path / "rig"))
    assert isinstance(rig, RigRecording)
    for part in rig.parts:
        frames = [rig.read(k) for k in range(len(rig)) if rig.part_of(k)[0] is part]
        play(found, part.camera.name, part.camera.intrinsics, frames)
    monkeypatch.setattr("cuboid.services.ros2.opening._transport", lambda *_: found)
    monkeypatch.setattr("cuboid.cli.progress.load_kernels", lambda: None)
    return found


def write_topics(path: Path, **change: Any) -> Path:
    document = rig_document()
    for camera in document["cameras"]:  # type: ignore[attr-defined]
        camera["serial"] = f"/{camera.pop('recording')}/color/image_raw/compressed"
    path.write_text(json.dumps({**document, **change}), encoding="utf-8")
    return path


def test_the_images_of_two_cameras_give_one_map(bus: Bus, tmp_path: Path) -> None:
    file, output = write_topics(tmp_path / "rig.json"), tmp_path / "out"
    assert main(["ros2", "--rig", str(file), "--queue", "40", "--limit", "16", "--output", str(output)]) == 0
    found = Results(output)
    assert len(found.objects) == len(THINGS)
    assert {row.camera for row in found.tracks} == set(NAMES)
    for name, T in zip(NAMES, POSES, strict=True):
        frames = [one for sent in bus.sent["/tf"] for one in sent.transforms]
        own = [one for one in frames if one.child_frame_id == f"{name}_color_optical_frame"]
        assert len(own) >= 6
        shift = own[0].transform.translation
        np.testing.assert_allclose((shift.x, shift.y, shift.z), T[:3, 3], atol=1e-6)
    stamps = [one.header.stamp.sec + one.header.stamp.nanosec / 1e9 for one in bus.sent["/cuboid/detections"]]
    assert stamps == sorted(stamps)
    assert stamps[0] == pytest.approx(FIRST_S, abs=1e-4)
    assert bus.closed >= 1
    assert cuboid.open_results(output).report.complete


@pytest.mark.parametrize(
    ("words", "change", "part"),
    [
        (
            ["--color", "/left/color/image_raw/compressed"],
            {},
            "has 2 cameras (left, right); name a topic of each with --color",
        ),
        (["--pose", "tf"], {}, "a fixed rig has the poses of its cameras; leave out --pose tf"),
        (["--info", "/x"], {}, "--info is for one camera"),
        ([], {"kind": "moving"}, "takes a moving rig whose cameras have poses in one world"),
    ],
)
def test_a_wrong_call_is_one_line(
    bus: Bus, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], change: Any, part: str
) -> None:
    assert main(["ros2", "--rig", str(write_topics(tmp_path / "rig.json", **change)), *words]) == 2
    assert part in capsys.readouterr().err


def test_several_topics_need_a_rig(bus: Bus, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["ros2", *("--color", "/left/color"), *("--color", "/right/color")]) == 2
    assert "several cameras need --rig rig.json" in capsys.readouterr().err
