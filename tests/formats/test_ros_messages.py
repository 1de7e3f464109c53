"""The messages of ROS 2: their definitions against rosbags' own, and the bytes made of them."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="messages are made with rosbags: pip install '.[ros]'")
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from cuboid.ground.core.errors import FrameError
from cuboid.ground.formats.ros_messages import OWN, SERVICES, VISION, RosMessages, request_of, response_of
from cuboid.ground.geometry.box import Box
from cuboid.results.views.ros_objects import detection
from made_messages import KINDS

# Versions of ROS 2 from Humble on, for which a message is the same bytes.
VERSIONS = (Stores.ROS2_HUMBLE, Stores.ROS2_IRON, Stores.ROS2_JAZZY, Stores.ROS2_KILTED)


@pytest.fixture(scope="module")
def messages() -> RosMessages:
    return RosMessages("the tests")


@pytest.mark.parametrize("kind", KINDS)
def test_messages_of_ros_are_the_same_in_each_version(messages: RosMessages, kind: str) -> None:
    hashes = {get_typestore(version).hash_rihs01(kind) for version in VERSIONS}
    assert hashes == {messages.store.hash_rihs01(kind)}


@pytest.mark.parametrize("kind", [*KINDS, *VISION, *OWN])
def test_a_definition_is_read_back_as_the_same_type(messages: RosMessages, kind: str) -> None:
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(messages.definition(kind), kind))
    assert store.hash_rihs01(kind) == messages.store.hash_rihs01(kind)


def test_the_messages_of_vision_msgs_are_those_of_its_version_4() -> None:
    # the fields of ros-perception/vision_msgs, branch ros2
    assert VISION["vision_msgs/msg/Detection3D"].splitlines() == [
        "std_msgs/Header header",
        "vision_msgs/ObjectHypothesisWithPose[] results",
        "vision_msgs/BoundingBox3D bbox",
        "string id",
    ]


@pytest.mark.parametrize("service", SERVICES)
def test_every_answer_says_whether_it_was_done(messages: RosMessages, service: str) -> None:
    fields = messages.store.fielddefs[response_of(service)][1]
    assert [name for name, _ in fields][:2] == ["success", "message"]
    assert request_of(service) in messages.store.types


def test_bytes_that_are_no_message_are_a_frame_error(messages: RosMessages) -> None:
    image = messages.make(
        "sensor_msgs/Image",
        header=messages.header("camera", 1_500_000_000),
        height=1,
        width=4,
        encoding="mono8",
        is_bigendian=0,
        step=4,
        data=np.arange(4, dtype=np.uint8),
    )
    data = messages.encode(image)
    back = messages.decode(data, "sensor_msgs/msg/Image")
    assert (back.header.stamp.sec, back.header.stamp.nanosec, back.data.tolist()) == (1, 500_000_000, [0, 1, 2, 3])
    for cut in (0, 3, 10, len(data) - 1):
        with pytest.raises(FrameError, match=r"a message is no sensor_msgs/msg/Image: "):
            messages.decode(data[:cut], "sensor_msgs/msg/Image")


def test_the_covariance_of_a_detection_has_the_variances_of_its_centre(messages: RosMessages) -> None:
    box = Box(np.zeros(3), np.ones(3), np.eye(3))
    known = detection(messages, 1, "cup", box, 0.9, 0, "map", (0.002, 0.003, 0.004)).results[0].pose.covariance
    assert np.flatnonzero(known).tolist() == [0, 7, 14]
    np.testing.assert_allclose(known[[0, 7, 14]], [4e-6, 9e-6, 16e-6])
    assert not detection(messages, 1, "cup", box, 0.9, 0, "map").results[0].pose.covariance.any()
