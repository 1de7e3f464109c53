"""Messages of any type, filled at random."""

from __future__ import annotations

from typing import Any

import numpy as np

from cuboid.ground.formats.ros_messages import RosMessages

# All that a node sends or takes, but for messages of its own.
KINDS = (
    "diagnostic_msgs/msg/DiagnosticArray",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "nav_msgs/msg/Odometry",
    "rosgraph_msgs/msg/Clock",
    "sensor_msgs/msg/CameraInfo",
    "sensor_msgs/msg/CompressedImage",
    "sensor_msgs/msg/Image",
    "sensor_msgs/msg/PointCloud2",
    "std_msgs/msg/String",
    "tf2_msgs/msg/TFMessage",
    "visualization_msgs/msg/MarkerArray",
)
BASE, MESSAGE, ARRAY, SEQUENCE = 1, 2, 3, 4
NUMBERS = {"bool": "?", "byte": "u1", "octet": "u1", "char": "u1"}
# The largest number in a `byte` that rosbags writes.
LARGEST_BYTE = 127


def random_message(messages: RosMessages, kind: str, rng: np.random.Generator) -> Any:
    """Return a message with something in each field."""
    fields = {name: _value(messages, node, rng) for name, node in messages.store.fielddefs[kind][1]}
    return messages.store.types[kind](**fields)


def _value(messages: RosMessages, node: Any, rng: np.random.Generator) -> Any:
    what, described = node
    if what == BASE:
        return _number(described[0], rng)
    if what == MESSAGE:
        return random_message(messages, described, rng)
    (of, inner), length = described[0], described[1]
    count = length if what == ARRAY else int(rng.integers(0, 4))
    if of == BASE and inner[0] != "string":
        return np.array([_number(inner[0], rng) for _ in range(count)], _dtype(inner[0]))
    return [_value(messages, (of, inner), rng) for _ in range(count)]


def _dtype(name: str) -> np.dtype[Any]:
    return np.dtype(NUMBERS.get(name, name))


def _number(name: str, rng: np.random.Generator) -> Any:
    if name == "string":
        return "".join(rng.choice(list("abcé#7"), int(rng.integers(0, 9))))
    dtype = _dtype(name)
    if dtype.kind == "f":
        return float(dtype.type(rng.normal()))
    if dtype.kind == "b":
        return bool(rng.integers(0, 2))
    limits = np.iinfo(dtype)
    most = LARGEST_BYTE if name == "byte" else limits.max
    return int(rng.integers(limits.min, most, dtype=dtype, endpoint=True))
