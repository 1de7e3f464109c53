"""Camera poses from tf and from topics of poses, as they come."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="messages are made with rosbags: pip install '.[ros2]'")

from cuboid.ground.core.errors import InputError
from cuboid.ground.formats.ros_messages import RosMessages
from cuboid.ground.geometry import se3
from cuboid.inputs.cameras.ros_poses import RosPoses

CAMERA, START_NS = "camera_optical", 5_000_000_000


class Topics:
    """A transport whose messages a test writes."""

    def __init__(self, messages: RosMessages, kinds: Mapping[str, str] | None = None) -> None:
        self.messages, self.kinds = messages, kinds or {}
        self.waiting: dict[str, deque[bytes]] = defaultdict(deque)

    def topics(self) -> Mapping[str, str]:
        return self.kinds

    def inlet(self, topic: str, kind: str, qos: object, kept: int, *, wakes: bool = True) -> Any:
        waiting = self.waiting[topic]

        class Inlet:
            def take(self) -> bytes | None:
                return waiting.popleft() if waiting else None

        return Inlet()

    def send(self, topic: str, message: Any) -> None:
        self.waiting[topic].append(self.messages.encode(message))

    def transform(self, topic: str, parent: str, child: str, T: np.ndarray, at_s: float = 0.0) -> None:
        at_ns = START_NS + round(at_s * 1e9)
        self.send(topic, self.messages.transforms([self.messages.transform(T, at_ns, parent, child)]))


@pytest.fixture(scope="module")
def messages() -> RosMessages:
    return RosMessages("the tests", "ros2")


def moved(x: float, y: float = 0.0, z: float = 0.0) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T


def turned(degrees: float) -> np.ndarray:
    half = np.radians(degrees) / 2
    return se3.compose(np.array([np.cos(half), 0.0, 0.0, np.sin(half)]), np.zeros(3))


def at(poses: RosPoses, at_s: float) -> np.ndarray | None:
    poses.take()
    return poses.at(CAMERA, START_NS * 1e-9 + at_s)


def test_a_chain_of_tf_is_interpolated_at_the_time_of_the_image(messages: RosMessages) -> None:
    topics = Topics(messages)
    poses = RosPoses(topics, messages)
    assert at(poses, 0.0) is None
    topics.transform("/tf_static", "base", CAMERA, moved(0.0, 0.0, 0.5))
    topics.transform("/tf", "map", "odom", turned(90))
    topics.transform("/tf", "odom", "base", moved(0.0))
    topics.transform("/tf", "odom", "base", moved(0.2), 0.1)
    topics.transform("/tf", "map", "odom", turned(90), 0.1)
    found = at(poses, 0.05)
    np.testing.assert_allclose(found, turned(90) @ moved(0.1, 0.0, 0.5), atol=1e-9)
    assert poses.found_world == "map"
    assert poses.is_newer(START_NS * 1e-9 + 0.1)
    assert not poses.is_newer(START_NS * 1e-9 + 0.11)
    assert at(poses, 0.3) is None, "too far from any transform"


def test_an_offset_is_added_to_the_times_of_poses(messages: RosMessages) -> None:
    """Poses 20 ms later: an image gets the pose of 20 ms before, and needs no newer transform."""
    topics = Topics(messages)
    poses = RosPoses(topics, messages, world="map", added_s=0.02)
    topics.transform("/tf", "map", CAMERA, moved(0.0))
    topics.transform("/tf", "map", CAMERA, moved(0.2), 0.1)
    np.testing.assert_allclose(at(poses, 0.07), moved(0.1), atol=1e-6)
    assert poses.is_newer(START_NS * 1e-9 + 0.119)
    assert not poses.is_newer(START_NS * 1e-9 + 0.121)


def test_the_world_may_be_a_frame_within_the_chain(messages: RosMessages) -> None:
    topics = Topics(messages)
    inner, none = RosPoses(topics, messages, world="odom"), RosPoses(Topics(messages), messages, world="elsewhere")
    topics.transform("/tf", "map", "odom", moved(5.0))
    topics.transform("/tf", "odom", CAMERA, moved(0.2))
    np.testing.assert_allclose(at(inner, 0.0), moved(0.2))
    assert inner.found_world == "odom"
    assert at(none, 0.0) is None


def test_a_camera_that_is_fixed_to_the_world_needs_no_moving_transform(messages: RosMessages) -> None:
    topics = Topics(messages)
    poses = RosPoses(topics, messages)
    topics.transform("/tf_static", "world", CAMERA, moved(1.0))
    np.testing.assert_allclose(at(poses, 0.0), moved(1.0))
    np.testing.assert_allclose(at(poses, 9.0), moved(1.0))


def test_old_transforms_are_forgotten_and_a_clock_that_begins_anew_too(messages: RosMessages) -> None:
    topics = Topics(messages)
    poses = RosPoses(topics, messages)
    for k in range(300):
        topics.transform("/tf", "map", CAMERA, moved(k), k / 10)
    np.testing.assert_allclose(at(poses, 25.0), moved(250))
    assert len(poses._moving[CAMERA][1]) <= 101
    topics.transform("/tf", "map", CAMERA, moved(-7.0), 1.0)
    np.testing.assert_allclose(at(poses, 1.0), moved(-7.0))
    assert at(poses, 25.0) is None


def test_odometry_of_another_frame_is_carried_to_the_camera(messages: RosMessages) -> None:
    topics = Topics(messages, {"/odom": "nav_msgs/msg/Odometry"})
    poses = RosPoses(topics, messages, "/odom")
    topics.transform("/tf_static", "base", CAMERA, moved(0.0, 0.0, 0.5))
    make = messages.make
    zero = make("geometry_msgs/Twist", linear=messages.xyz(np.zeros(3)), angular=messages.xyz(np.zeros(3)))
    pose = make("geometry_msgs/PoseWithCovariance", pose=messages.pose(moved(2.0)), covariance=np.zeros(36))
    twist = make("geometry_msgs/TwistWithCovariance", twist=zero, covariance=np.zeros(36))
    header = messages.header("odom", START_NS)
    topics.send("/odom", make("nav_msgs/Odometry", header=header, child_frame_id="base", pose=pose, twist=twist))
    np.testing.assert_allclose(at(poses, 0.0), moved(2.0, 0.0, 0.5))
    assert poses.found_world == "odom"


def test_poses_of_the_camera_itself(messages: RosMessages) -> None:
    topics = Topics(messages, {"/pose": "geometry_msgs/msg/PoseStamped"})
    poses = RosPoses(topics, messages, "/pose")
    for k in range(2):
        header = messages.header("map", START_NS + k * 100_000_000)
        pose = messages.pose(moved(0.2 * k))
        topics.send("/pose", messages.make("geometry_msgs/PoseStamped", header=header, pose=pose))
    np.testing.assert_allclose(at(poses, 0.05), moved(0.1))


@pytest.mark.parametrize(
    ("kinds", "part"), [({}, "nobody publishes it"), ({"/pose": "std_msgs/msg/String"}, "it is std_msgs/msg/String")]
)
def test_a_topic_of_no_poses_is_one_line(messages: RosMessages, kinds: dict[str, str], part: str) -> None:
    with pytest.raises(InputError, match=f"--pose /pose: expected a topic of .*, but {part}"):
        RosPoses(Topics(messages, kinds), messages, "/pose")
