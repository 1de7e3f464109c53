"""The node of rclpy, against a stand-in that has rclpy's names."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator

import pytest

pytest.importorskip("rosbags", reason="messages are read with rosbags: pip install '.[ros2]'")

from cuboid.ground.core.errors import InputError, MissingExtraError
from cuboid.ground.formats.ros_messages import RosMessages, request_of, response_of
from cuboid.ground.middleware.rclpy_node import RclpyTransport
from cuboid.ground.middleware.transport import Qos
from fake_rclpy import FakeRos, install


@pytest.fixture
def ros(monkeypatch: pytest.MonkeyPatch) -> FakeRos:
    return install(monkeypatch)


@pytest.fixture
def transport(ros: FakeRos) -> Iterator[RclpyTransport]:
    made = RclpyTransport("cuboid", ros.messages)
    yield made
    made.close()
    assert (ros.nodes[0].destroyed, ros.running) == (True, False)


def test_bytes_go_out_and_come_in_with_the_quality_of_sensors(ros: FakeRos, transport: RclpyTransport) -> None:
    outlet = transport.outlet("/out", "std_msgs/msg/String", Qos.LATCHED)
    assert not outlet.wanted()
    inlet = transport.inlet("/out", "std_msgs/msg/String", Qos.SENSOR, 2)
    assert outlet.wanted()
    (_, profile) = ros.subscriptions["/out"][0]
    assert (profile.reliability, profile.durability, profile.depth) == ("BEST_EFFORT", "VOLATILE", 2)
    assert transport.topics() == {"/out": "std_msgs/msg/String"}
    for text in ("one", "two", "three"):
        outlet.send(ros.messages.encode(ros.messages.make("std_msgs/String", data=text)), 0)
    transport.wait(10.0)  # returns at once
    came = [ros.messages.decode(data, "std_msgs/msg/String").data for data in iter(inlet.take, None)]
    assert came == ["two", "three"]


def test_a_service_is_answered_by_the_thread_that_asks_for_calls(ros: FakeRos, transport: RclpyTransport) -> None:
    kind = "cuboid_ros/srv/Query"
    transport.serve("/cuboid/query", kind)
    near = ros.type_of("geometry_msgs/msg/Point")()
    near.x, near.y, near.z = 1.0, 2.0, 3.0
    answers = []

    def call() -> None:
        answers.append(ros.call("/cuboid/query", label=3, name="cup", near=near, within_m=0.5))

    calling = threading.Thread(target=call)
    calling.start()
    while not (found := list(transport.requests())):
        pass
    request = ros.messages.decode(found[0].data, request_of(kind))
    assert (request.label, request.name, request.near.y, request.within_m) == (3, "cup", 2.0, 0.5)
    header = ros.messages.header("map", 7)
    objects = ros.messages.make("vision_msgs/Detection3DArray", header=header, detections=[])
    answer = ros.messages.store.types[response_of(kind)](success=True, message="0 objects", objects=objects)
    found[0].reply(ros.messages.encode(answer))
    calling.join()
    assert (answers[0].success, answers[0].message, answers[0].objects.header.frame_id) == (True, "0 objects", "map")


def test_a_call_that_nobody_answers_fails(
    ros: FakeRos, transport: RclpyTransport, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(transport._calls, "wait_s", 0.01)
    transport.serve("/cuboid/reset", "std_srvs/srv/Trigger")
    answer = ros.call("/cuboid/reset")
    assert (answer.success, answer.message) == (False, "no answer within 30 s")


def test_parameters_are_checked_where_they_are_set(ros: FakeRos, transport: RclpyTransport) -> None:
    values: dict[str, object] = {}

    def change(name: str, value: object) -> None:
        if value == -1:
            raise InputError("expected a number from 0")
        values[name] = value

    ros.nodes[0].parameters["min_probability"] = 0.5  # as a launch file sets it before the node declares it
    transport.declare({"min_probability": 0.0, "object_frames": False}, change)
    assert values == {"min_probability": 0.5, "object_frames": False}
    assert ros.nodes[0].set_parameter("object_frames", True).successful
    refused = ros.nodes[0].set_parameter("min_probability", -1)
    assert (refused.successful, refused.reason) == (False, "expected a number from 0")
    assert values == {"min_probability": 0.5, "object_frames": True}
    assert ros.nodes[0].set_parameter("use_sim_time", True).successful, "another's parameter is not ours to refuse"


def test_without_ros_one_line_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rclpy", None)
    with pytest.raises(MissingExtraError, match=r"needs rclpy, a part of a sourced ROS 2 .* --transport dds"):
        RclpyTransport("cuboid", RosMessages("the tests", "ros2"))
