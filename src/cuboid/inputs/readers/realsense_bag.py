"""Recordings of the RealSense SDK and its viewer: a ROS 1 bag with special topics.

Expected: a ``.bag`` file with the topics ::

    /device_0/sensor_0/Depth_0/image/data          mono16; .../info/camera_info, .../tf/0 beside it
    /device_0/sensor_0/option/Depth Units/value    metres a unit
    /device_0/sensor_1/Color_0/image/data          rgb8, bgr8, ...
    /device_0/sensor_2/Accel_0/imu/data            tells where up is; may be absent

Depth comes in the depth camera's image: it is registered to color with the calibration in the file. Times start at the
beginning of the recording.
"""

from __future__ import annotations

import re
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.geometry import se3
from cuboid.inputs.readers.bag import ROS1_MAGIC, Bag, is_bag_file
from cuboid.inputs.readers.bag_cameras import camera_of
from cuboid.inputs.readers.bag_gravity import Gravity
from cuboid.inputs.readers.bag_images import WHOLE_UNITS_PER_METRE, color_of, depth_of
from cuboid.inputs.readers.bag_transforms import matrix
from cuboid.inputs.readers.depth_camera import DepthCamera
from cuboid.inputs.readers.reader import READERS, Calibration, FrameEntry, Listing, Reader
from cuboid.inputs.readers.tum import associate

IMAGE = re.compile(r"(/device_\d+/sensor_\d+)/(Depth|Color)_\d+/image/data")
ACCELEROMETER = re.compile(r"/device_\d+/sensor_\d+/Accel_\d+/imu/data")
# Number of bytes at the end of the file, where the index lists the topics, that are examined.
INDEX_BYTES = 1 << 16
# Maximum time between color and depth of one frame, or half the time between two color images.
WITHIN_S = 0.02


def is_realsense(path: Path) -> bool:
    """Tell whether a bag was written by the RealSense SDK, by the names in its index."""
    with suppress(OSError, ValueError), path.open("rb") as file:
        head = file.read(4096)
        at = head.find(b"index_pos=")
        if head.startswith(ROS1_MAGIC) and at >= 0:
            file.seek(int.from_bytes(head[at + 10 : at + 18], "little"))
            return b"topic=/device_0/" in file.read(INDEX_BYTES)
    return False


def recognises(path: Path) -> bool:
    """Tell whether this is a bag with the topics of the RealSense SDK."""
    return path.suffix == ".bag" and is_bag_file(path) and is_realsense(path)


def read(path: Path) -> Listing:
    """List the frames; raise InputError if the file has no color or no depth."""
    bag = Bag([path])
    streams: dict[str, str] = {}
    for topic in sorted(bag.types):
        if (match := IMAGE.fullmatch(topic)) and len(bag.times(topic)):
            streams.setdefault(match[2], topic)
    for stream in ("Color", "Depth"):
        if stream not in streams:
            raise InputError(f"{path}: holds no {stream.lower()} images; both color and depth must have been recorded")
    color, depth = streams["Color"], streams["Depth"]
    calibration = _calibration(bag, color, depth, path)
    return Listing(_entries(bag, color, depth, _gravity(bag, color, path)), _units(bag, depth), calibration)


def _gravity(bag: Bag, color: str, path: Path) -> Gravity | None:
    """Return the camera's accelerometer as a gravity sensor; None if it was not recorded."""
    topic = next((topic for topic in sorted(bag.types) if ACCELEROMETER.fullmatch(topic)), None)
    if topic is None:
        return None
    T_color_imu = _from_reference(bag, color, path) @ se3.inverse(_from_reference(bag, topic, path))
    return Gravity(bag, topic, T_color_imu[:3, :3])


def _entries(bag: Bag, color_topic: str, depth_topic: str, gravity: Gravity | None) -> list[FrameEntry]:
    colors, depths = bag.times(color_topic), bag.times(depth_topic)
    within_s = max(
        WITHIN_S, float(np.median(np.diff(colors))) * 0.5e-9 if len(colors) > 1 else _period_s(bag, color_topic)
    )
    pairs = associate((colors * 1e-9).tolist(), (depths * 1e-9).tolist(), within_s)
    return [
        FrameEntry(
            color=partial(_image, bag, color_topic, time_ns, color_of),
            depth=partial(_image, bag, depth_topic, int(depths[pairs[k]]), depth_of) if k in pairs else None,
            timestamp_s=time_ns * 1e-9,
            fault=None if k in pairs else f"color without depth: none within {1000 * within_s:.0f} ms of {color_topic}",
            up_camera=None if gravity is None else partial(gravity.up_at, time_ns),
        )
        for k, time_ns in enumerate(colors.tolist())
    ]


def _period_s(bag: Bag, topic: str) -> float:
    """Return half the time between two images by the rate that the stream was set to."""
    info = _beside(bag, topic, "info")
    rate = float(getattr(info, "fps", 0) or 0)
    return 0.5 / rate if rate > 0 else 0.0


def _image(bag: Bag, topic: str, time_ns: int, decode: Any) -> Any:
    return decode(bag.read(topic, time_ns), f"image of {topic} at {time_ns * 1e-9:.4f} s")


def _beside(bag: Bag, topic: str, name: str) -> Any:
    """Return the first message of a topic beside the images of a stream; None if there is none."""
    other = topic.removesuffix("image/data") + name
    return bag.first(other) if other in bag.types else None


def _units(bag: Bag, topic: str) -> float:
    match = IMAGE.fullmatch(topic)
    option = f"{match[1]}/option/Depth Units/value" if match else ""
    message = bag.first(option) if option in bag.types else None
    metres = float(message.data) if message is not None else 0.0
    return round(1.0 / metres, 3) if metres > 0 and np.isfinite(metres) else WHOLE_UNITS_PER_METRE


def _calibration(bag: Bag, color: str, depth: str, path: Path) -> Calibration:
    """Return the cameras; both transforms start at one reference stream."""
    cameras = []
    for topic in (color, depth):
        info = _beside(bag, topic, "info/camera_info")
        if info is None:
            raise InputError(f"{path}: has no camera_info beside {topic}; give the color camera with --intrinsics")
        cameras.append((*camera_of(info, False, f"{topic} in {path.name}"), (int(info.width), int(info.height))))
    T_color_depth = _from_reference(bag, color, path) @ se3.inverse(_from_reference(bag, depth, path))
    (color_K, distortion, size), (depth_K, depth_distortion, depth_size) = cameras
    camera = DepthCamera(*depth_K, depth_size, T_color_depth, depth_distortion)
    return Calibration(*color_K, size, "camera_info in the bag", distortion, camera)


def _from_reference(bag: Bag, topic: str, path: Path) -> Float64Array:
    """Return the transform (4, 4) from the coordinates of the reference stream to those of a stream."""
    prefix = topic.removesuffix("data").rpartition("/")[0].rpartition("/")[0] + "/tf/"
    message = next((bag.first(name) for name in sorted(bag.types) if name.startswith(prefix)), None)
    if message is None:
        return np.eye(4)
    T = matrix(message.translation, message.rotation)
    if T is None:
        raise InputError(f"{path}: the transform of {topic} is none")
    return T


READERS.register("realsense-bag")(Reader("a .bag file of the RealSense SDK", recognises, read, files=(".bag",)))
