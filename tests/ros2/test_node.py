"""A bag that is played, the node, and this listener, as three processes that find each other by DDS."""

from __future__ import annotations

import json
import os
import shlex
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="DDS is not installed: pip install '.[ros2]'")
pytest.importorskip("rosbags", reason="messages are read with rosbags: pip install '.[ros2]'")

import cuboid
from cuboid.cli import main
from cuboid.ground.formats.ros_messages import RosMessages, request_of, response_of
from cuboid.ground.middleware.dds import DdsTransport, WireTypes
from cuboid.ground.middleware.transport import Qos
from cuboid.inputs.cameras.ros2 import WAITING_IMAGES
from cuboid.runs.tracking.tracker import Tracker

REPOSITORY = Path(__file__).resolve().parents[2]
LOOP = REPOSITORY / "benchmarks" / "ros2_loop.py"
TOPICS = {
    "/cuboid/detections": ("vision_msgs/msg/Detection3DArray", Qos.RELIABLE),
    "/cuboid/markers": ("visualization_msgs/msg/MarkerArray", Qos.RELIABLE),
    "/cuboid/map": ("sensor_msgs/msg/PointCloud2", Qos.LATCHED),
    "/cuboid/cloud": ("sensor_msgs/msg/PointCloud2", Qos.LATCHED),
    "/cuboid/answer": ("std_msgs/msg/String", Qos.RELIABLE),
    "/tf": ("tf2_msgs/msg/TFMessage", Qos.RELIABLE),
    "/diagnostics": ("diagnostic_msgs/msg/DiagnosticArray", Qos.RELIABLE),
}
# The rate of images is low, so that a busy machine keeps up; benchmarks/ros2_loop.py judges 30 Hz.
FRAMES, HERTZ, FIRST_NS = 24, 2.0, 1_500_000_000_123_456_789
STAMPS_NS = [FIRST_NS + round(k * 1e9 / HERTZ) for k in range(FRAMES)]


@pytest.fixture(scope="module")
def bag(data_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag of a real recording, written with rosbags."""
    folder = tmp_path_factory.mktemp("played") / "bag"
    words = ["convert", str(data_dir / "desk-realsense"), "--to", "mcap", "--output", str(folder)]
    assert main([*words, "--last", str(FRAMES - 1)]) == 0
    return folder / "recording"


class Listener:
    """Takes all that the node sends, and reads each message with rosbags."""

    def __init__(self, domain: int) -> None:
        self.messages = RosMessages("the tests", "ros2")
        self.transport = DdsTransport(domain, self.messages)
        self._inlets = {topic: self.transport.inlet(topic, *how, 500) for topic, how in TOPICS.items()}
        self._commands = self.transport.outlet("/cuboid/command", "std_msgs/msg/String", Qos.RELIABLE)
        self.came: dict[str, list[Any]] = {topic: [] for topic in TOPICS}

    def until(self, enough: Callable[[], Any], wait_s: float = 90.0) -> Any:
        """Take what comes until it is enough."""
        until_s = time.monotonic() + wait_s
        while not (found := enough()):
            assert time.monotonic() < until_s, {topic: len(came) for topic, came in self.came.items()}
            self.transport.wait(0.05)
            for topic, inlet in self._inlets.items():
                while (data := inlet.take()) is not None:
                    self.came[topic].append(self.messages.decode(data, TOPICS[topic][0]))  # refused: the test fails
        return found

    def ask(self, **command: Any) -> dict[str, Any]:
        """Send a command and return its answer."""
        self.until(self._commands.wanted)
        number = len(self.came["/cuboid/answer"]) + 100
        text = json.dumps({**command, "id": number})
        self._commands.send(self.messages.encode(self.messages.make("std_msgs/String", data=text)), 0)

        def answer() -> dict[str, Any] | None:
            answers = [json.loads(one.data) for one in self.came["/cuboid/answer"]]
            return next((one for one in answers if one["id"] == number), None)

        return self.until(answer)

    def detected(self) -> dict[int, Any]:
        """Return the arrays of detections by their stamps."""
        return {ns(one.header): one for one in self.came["/cuboid/detections"]}


def ns(header: Any) -> int:
    return int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec)


@contextmanager
def running(bag: Path, domain: int, *options: str) -> Iterator[tuple[Listener, subprocess.Popen[str]]]:
    """Run the player and the node; the listener is here."""
    environment = os.environ | {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    listener = Listener(domain)
    node_command = [sys.executable, "-m", "cuboid", "ros2", "--domain", str(domain), "--transport", "dds", *options]
    node = subprocess.Popen(node_command, stderr=subprocess.PIPE, text=True, env=environment)
    frames = f"--frames {FRAMES} --distinct {FRAMES} --hertz {HERTZ} --first-ns {FIRST_NS}".split()
    player_command = [sys.executable, str(LOOP), "play", str(bag), "--domain", str(domain), *frames]
    player_command += ["--clock", "--wait", "--linger", "60"]
    player = subprocess.Popen(player_command, stdout=subprocess.PIPE, text=True, env=environment)
    try:
        yield listener, node
    finally:
        for process in (player, node):
            process.kill()
            process.communicate()
        listener.transport.close()


def ended(node: subprocess.Popen[str]) -> str:
    """End the node as Ctrl-C does; return what it said."""
    node.send_signal(signal.SIGINT)
    _, said = node.communicate(timeout=90)
    assert node.returncode == 0, said
    return said


def documented_options() -> list[str]:
    """Return the options of the first call on the page of the documentation."""
    page = (REPOSITORY / "docs" / "ros2.md").read_text(encoding="utf-8")
    (call, *_) = [line for line in page.splitlines() if line.startswith("    cuboid ros2 ")]
    return shlex.split(call)[2:]


def test_the_objects_of_a_bag_arrive_with_its_stamps_and_poses_of_tf(bag: Path, tmp_path: Path) -> None:
    domain = 20 + os.getpid() % 200
    output = tmp_path / "out"
    options = (*documented_options(), "--sim-time", "--output", str(output), "--param", "object_frames=true")
    with running(bag, domain, *options) as (listener, node):
        listener.until(lambda: max(listener.detected(), default=0) == STAMPS_NS[-1])
        check_against_the_tracker(listener, bag)
        check_markers_and_frames(listener)
        check_commands(listener, output)
        check_diagnostics(listener)
        said = ended(node)
    assert "images of ROS 2 /camera/color/image_raw, poses tf" in said
    assert "results in" not in said, "after the reset there was nothing to save"


def check_against_the_tracker(listener: Listener, bag: Path) -> None:
    """Track the frames that the node had; the objects must be the same."""
    had = sorted(STAMPS_NS.index(stamp) for stamp in listener.detected())
    assert len(had) >= FRAMES // 2  # a busy machine may drop some
    recording = cuboid.open_recording(bag)
    tracker = Tracker(recording.intrinsics, poses="given")
    for k in had:
        result = tracker.update(replace(recording.read(k), timestamp_s=STAMPS_NS[k] / 1e9))
    last = listener.detected()[STAMPS_NS[-1]]
    assert last.header.frame_id == "world"
    boxes = {int(one.id): one.bbox for one in last.detections}
    assert boxes.keys() == {one.label for one in result.sightings} != set()
    for one in result.sightings:
        center = boxes[one.label].center.position
        np.testing.assert_allclose((center.x, center.y, center.z), one.box.center, atol=1e-3)


def check_markers_and_frames(listener: Listener) -> None:
    labels = {int(one.id) for one in listener.detected()[STAMPS_NS[-1]].detections}
    texts = {one.text for array in listener.came["/cuboid/markers"] for one in array.markers}
    assert texts >= {f"#{label}" for label in labels}
    own = [one for array in listener.came["/tf"] for one in array.transforms if one.child_frame_id.startswith("object")]
    assert {one.child_frame_id for one in own} >= {f"object_{label}" for label in labels}
    assert {one.header.frame_id for one in own} == {"world"}


def check_commands(listener: Listener, output: Path) -> None:
    found = listener.ask(command="query")
    label = found["objects"][0]["label"]
    assert listener.ask(command="name", label=label, name="lamp")["success"]
    (named,) = listener.ask(command="query", name="lamp")["objects"]
    assert (named["label"], named["name"]) == (label, "lamp")
    assert listener.ask(command="cloud", label=label)["success"]
    cloud = listener.until(lambda: listener.came["/cuboid/cloud"])[-1]
    assert cloud.width > 100
    assert cloud.point_step * cloud.width == len(cloud.data)
    asked = {"label": 0, "name": "lamp", "near": point(listener), "within_m": 0.0}
    assert call(listener, "query", "cuboid_ros/srv/Query", asked) == "1 objects"
    assert listener.ask(command="save")["message"] == f"saved in {output}"
    assert {item.label: item.name for item in cuboid.open_results(output).objects}[label] == "lamp"
    refused = listener.ask(command="set", parameter="min_probability", value=3)
    assert (refused["success"], refused["message"][:26]) == (False, "parameter min_probability:")
    for text in ('{"command": "dance"}', "no JSON", '{"command": "name", "label": "x", "name": ""}'):
        listener._commands.send(listener.messages.encode(listener.messages.make("std_msgs/String", data=text)), 0)
    listener.until(lambda: sum("not a command" in one.data for one in listener.came["/cuboid/answer"]) == 3)
    assert listener.ask(command="reset")["success"]
    assert listener.ask(command="query")["objects"] == []
    deleted = {one.id for one in listener.came["/cuboid/markers"][-1].markers if one.action == 2}
    assert label in deleted


def point(listener: Listener) -> Any:
    return listener.messages.make("geometry_msgs/Point", x=0.0, y=0.0, z=0.0)


def call(listener: Listener, name: str, kind: str, fields: dict[str, Any]) -> str:
    """Call a service as ROS on Cyclone DDS does; return the message of the answer."""
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.pub import DataWriter
    from cyclonedds.qos import Policy
    from cyclonedds.qos import Qos as DdsQos
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic
    from cyclonedds.util import duration

    messages, domain = listener.messages, int(listener.transport.name.split()[-1])
    types, participant = WireTypes(messages), DomainParticipant(domain)
    request, response = (types.raw_type(part, called=True) for part in (request_of(kind), response_of(kind)))
    qos = DdsQos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(10))
    writer = DataWriter(participant, Topic(participant, f"rq/cuboid/{name}Request", request), qos=qos)
    reader = DataReader(participant, Topic(participant, f"rr/cuboid/{name}Reply", response), qos=qos)
    listener.until(writer.get_matched_subscriptions)
    listener.until(lambda: reader.get_subscription_matched_status().current_count)
    data = messages.encode(messages.store.types[request_of(kind)](**fields))
    sample = request.__new__(request)
    sample.data = data[:4] + struct.pack("<Qq", 11, 1) + data[4:]
    writer.write(sample)
    (came,) = listener.until(lambda: reader.take(N=1))
    return str(messages.decode(came.data[:4] + came.data[20:], response_of(kind)).message)


def check_diagnostics(listener: Listener) -> None:
    stale = lambda: [one for one in listener.came["/diagnostics"] if one.status[0].level == 3]  # noqa: E731
    array = listener.until(stale)[-1]
    status = array.status[0]
    assert status.message.startswith("no image for ")
    values = {pair.key: pair.value for pair in status.values}
    used = sum(int(values[key]) for key in ("frames", "frames skipped", "frames dropped", "images damaged"))
    assert int(values["pairs"]) == used >= FRAMES // 2
    images = int(values["color images"]) + int(values["depth images"])
    # An image may still wait for a partner that the network has lost.
    assert 0 <= images - 2 * used - int(values["images without partner"]) <= WAITING_IMAGES
    assert ns(array.header) == STAMPS_NS[-1], "the clock is that of the simulation"


def test_poses_are_estimated_and_published(bag: Path) -> None:
    with running(bag, 21 + os.getpid() % 200, "--pose", "estimated", "--limit", "12") as (listener, node):

        def cameras() -> list[Any]:
            sent = [one for array in listener.came["/tf"] for one in array.transforms]
            return [one for one in sent if one.header.frame_id == "map"]

        listener.until(lambda: len(cameras()) >= 6)
        _, said = node.communicate(timeout=90)
    assert node.returncode == 0, said
    assert {one.child_frame_id for one in cameras()} == {"camera_color_optical_frame"}
    assert {ns(one.header) for one in cameras()} <= set(STAMPS_NS)


def test_a_node_that_waits_for_images_is_ended_by_a_signal(tmp_path: Path) -> None:
    domain = str(22 + os.getpid() % 200)
    command = [sys.executable, "-m", "cuboid", "ros2", "--domain", domain, "--transport", "dds"]
    node = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    assert node.stderr is not None
    first = next(line for line in node.stderr if "kernels" not in line)
    assert first == "cuboid: waiting for images\n"
    said = ended(node)
    assert "ended before the first image" in said


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (["--pose", "odom"], "--pose is tf, estimated or a topic such as /odom, got 'odom'"),
        (["--param", "speed=1"], "there is no parameter 'speed'"),
        (["--domain", "x"], "domain must be a whole number, got 'x'"),
        (["--transport", "rclpy"], "needs rclpy, a part of a sourced ROS 2"),
    ],
)
def test_a_mistake_is_one_line(words: list[str], part: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["ros2", *words]) == 2
    assert part in capfd.readouterr().err.splitlines()[-1]
