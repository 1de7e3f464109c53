"""`--foxglove`: what a client of Foxglove's protocol reads of a run while it goes."""

from __future__ import annotations

import dataclasses
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

pytest.importorskip("foxglove", reason="foxglove-sdk is not installed: pip install '.[foxglove]'")
pytest.importorskip("rosbags", reason="messages are made with rosbags: pip install '.[foxglove]'")

from cuboid.cli import main
from cuboid.ground.core.errors import InputError, MissingExtraError
from cuboid.ground.core.frame import Frame
from cuboid.ground.core.results import FrameResult, ObjectEvent
from cuboid.results.views.foxglove_view import FoxgloveView
from fakes import INTRINSICS, FakeTracker, box, write_recording
from foxglove_client import FoxgloveClient

TOPICS = {
    "/cuboid/detections": "vision_msgs/msg/Detection3DArray",
    "/cuboid/markers": "visualization_msgs/msg/MarkerArray",
    "/cuboid/events": "cuboid_ros/msg/ObjectEvent",
    "/cuboid/map": "sensor_msgs/msg/PointCloud2",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    "/cuboid/color/compressed": "sensor_msgs/msg/CompressedImage",
    "/cuboid/depth/compressedDepth": "sensor_msgs/msg/CompressedImage",
    "/cuboid/camera_info": "sensor_msgs/msg/CameraInfo",
}


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


def test_a_client_reads_a_run_while_it_goes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    listening = threading.Event()

    class WaitingTracker(FakeTracker):
        """Begins when the client listens."""

        def update(self, frame: Frame, anchor: int = 0) -> FrameResult:
            assert listening.wait(20.0)
            result = super().update(frame, anchor)
            moved = ObjectEvent("moved", 1, np.zeros(3), np.ones(3), 0.9)
            return dataclasses.replace(result, events=(moved,) if frame.index == 3 else ())

    monkeypatch.setattr("cuboid.runs.pipeline.run._tracker", WaitingTracker)
    port, read = free_port(), {}

    def look() -> None:
        with connected(port) as client:
            client.subscribe(*TOPICS)
            listening.set()
            client.until(lambda: len(client.messages.get("/cuboid/detections", ())) == 6)
            client.until(lambda: set(client.messages) >= set(TOPICS))
            read.update(messages=client.messages, channels=client.channels)

    looking = threading.Thread(target=look)
    looking.start()
    recording = str(write_recording(tmp_path / "recording", 6))
    assert main(["track", recording, "--output", str(tmp_path / "out"), f"--foxglove=127.0.0.1:{port}"]) == 0
    looking.join()
    assert TOPICS.items() <= {topic: one["schemaName"] for topic, one in read["channels"].items()}.items()
    check(read["messages"])


@contextmanager
def connected(port: int) -> Iterator[FoxgloveClient]:
    """Connect to the server of a run that has just begun, as soon as it is there."""
    for _ in range(200):
        try:
            with FoxgloveClient(port) as client:
                yield client
            return
        except ConnectionRefusedError:
            time.sleep(0.05)
    raise AssertionError("no server")


def check(messages: dict[str, list[Any]]) -> None:
    """Compare what was read with what the tracker had."""
    last = messages["/cuboid/detections"][-1]
    (seen,) = last.detections
    assert (seen.id, seen.results[0].hypothesis.class_id, last.header.frame_id) == ("1", "object", "map")
    center, size = seen.bbox.center.position, seen.bbox.size
    np.testing.assert_allclose((center.x, center.y, center.z), box().center)
    np.testing.assert_allclose((size.x, size.y, size.z), box().size)
    stamp = last.header.stamp
    assert stamp.sec + stamp.nanosec / 1e9 == pytest.approx(5 / 30, abs=1e-6)
    assert {(one.ns, one.id, one.text) for one in messages["/cuboid/markers"][-1].markers} == {
        ("boxes", 1, ""),
        ("edges", 1, ""),
        ("labels", 1, "#1"),
    }
    (camera,) = messages["/tf"][-1].transforms
    assert (camera.header.frame_id, camera.child_frame_id) == ("map", "camera_color_optical_frame")
    assert camera.transform.translation.x == pytest.approx(0.05)
    color = cv2.imdecode(np.asarray(messages["/cuboid/color/compressed"][-1].data), cv2.IMREAD_COLOR)
    assert color.shape == (48, 64, 3)
    assert messages["/cuboid/camera_info"][-1].k[0] == 64.0
    assert messages["/cuboid/map"][0].width == 1
    (event,) = messages["/cuboid/events"]
    assert (event.event, event.label, event.from_position.x, event.to_position.x) == ("moved", 1, 0.0, 1.0)
    status = messages["/diagnostics"][0].status[0]
    assert (status.message, {one.key for one in status.values} >= {"frames", "objects"}) == ("tracking", True)


def test_without_the_sdk_one_line_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(MissingExtraError, match=r"'--foxglove' needs foxglove, .* pip install '\.\[foxglove\]'"):
        FoxgloveView(INTRINSICS, port=0)


def test_a_port_that_is_taken_is_one_line() -> None:
    taken = "--foxglove: cannot listen on 127.0.0.1:"
    with FoxgloveView(INTRINSICS, port=0) as first, pytest.raises(InputError, match=taken):
        FoxgloveView(INTRINSICS, port=first.port)


@pytest.mark.parametrize("where", ["here", ":8765", "localhost:x", "localhost:99999"])
def test_a_wrong_address_is_one_line(where: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["track", "R", "--output", str(tmp_path / "out"), f"--foxglove={where}"])
    assert (ended.value.code, capfd.readouterr().err.count("\n")) == (2, 1)
