"""Bags of ROS 1 (.bag) and ROS 2 (.db3, .mcap, or the folder that ``ros2 bag record`` writes).

Expected tree::

    walk.bag                     one file; or
    walk/                        <- the recording
      metadata.yaml              may be absent
      walk_0.db3 ...             or walk_0.mcap ...; several follow each other

Of the topics, color and depth are chosen by type, name and encoding (``sensor_msgs/Image`` or ``CompressedImage``),
depth aligned to color before other depth; the cameras come from the ``CameraInfo`` beside them, the camera's poses and
the transform between the cameras from ``tf``; an accelerometer (``sensor_msgs/Imu``) that ``tf`` fixes to the camera
tells where up is. Options choose them: ``color=``, ``depth=``, ``pose=`` (a topic of
``PoseStamped`` or ``Odometry`` that gives the color camera).
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.formats.reading import names_in
from cuboid.inputs.readers.bag import Bag, is_bag_file
from cuboid.inputs.readers.bag_cameras import camera_of
from cuboid.inputs.readers.bag_gravity import Gravity, measures_gravity
from cuboid.inputs.readers.bag_images import COMPRESSED, RAW, color_of, depth_of, is_depth, units_per_metre
from cuboid.inputs.readers.bag_transforms import STAMPED_TYPES, Transforms, frame_name, stamp_s
from cuboid.inputs.readers.depth_camera import DepthCamera
from cuboid.inputs.readers.reader import READERS, Calibration, FrameEntry, Listing, Reader
from cuboid.inputs.readers.realsense_bag import is_realsense
from cuboid.inputs.readers.tum import associate

OPTIONS = ("color", "depth", "pose")
CAMERA_INFO, IMU = "sensor_msgs/msg/CameraInfo", "sensor_msgs/msg/Imu"
# Maximum time between color and depth of one frame, or half the time between two images if that is more.
WITHIN_S = 0.02
# Words in names of preferred topics, the best first, and words in names of topics that are neither color nor depth.
DEPTH_WORDS = ("aligned_depth_to_color", "depth_registered", "depth")
COLOR_WORDS = ("color", "rgb", "image")
NEITHER = ("infra", "/ir/", "confidence", "mask", "fisheye", "theora", "ffmpeg")
# Maximum difference between header times and log times from the same clock.
SAME_LOG_CLOCK_S = 5.0


def recognises(path: Path) -> bool:
    """Tell whether this is a bag, or a folder with files of one."""
    if path.is_dir():
        return any(is_bag_file(file) for file in _files(path))
    return is_bag_file(path) and not is_realsense(path)


def _files(path: Path) -> list[Path]:
    if not path.is_dir():
        return [path]
    return [path / name for name in sorted(names_in(path)) if name.endswith((".db3", ".mcap"))]


def read(path: Path) -> Listing:
    """List the frames of the topics that are found."""
    return read_topics(path, {})


def read_topics(path: Path, topics: Mapping[str, str]) -> Listing:
    """List the frames of given topics; raise InputError if there are none, or several candidates."""
    for kind in topics:
        if kind not in OPTIONS:
            raise InputError(f"topics are chosen with {'=, '.join(OPTIONS)}=, got '{kind}='")
    bag = Bag([file for file in _files(path) if is_bag_file(file)])
    for kind, topic in topics.items():
        if topic not in bag.types:
            raise InputError(f"{path}: has no topic '{topic}' ({kind}); it has {', '.join(sorted(bag.types))}")
    color_topic, depth_topic = _image_topics(bag, path, topics)
    color, depth = bag.first(color_topic), bag.first(depth_topic)
    if color is None or depth is None:
        raise InputError(f"{path}: no image of {depth_topic if color is not None else color_topic} can be read")
    transforms = Transforms(bag, topics.get("pose") or _pose_topic(bag))
    frame = frame_name(color.header.frame_id)
    has_poses = transforms.moves(frame, int(bag.times(color_topic)[0]))
    calibration = _calibration(bag, transforms, (color_topic, color), (depth_topic, depth))
    return Listing(
        _entries(bag, color_topic, depth_topic, transforms if has_poses else None, _gravity(bag, transforms, frame)),
        units_per_metre(depth),
        calibration,
        camera_folders=(path if path.is_dir() else path.parent,),
    )


def _image_topics(bag: Bag, path: Path, topics: Mapping[str, str]) -> tuple[str, str]:
    """Return the topics of color and depth."""
    images: dict[bool, list[str]] = {True: [], False: []}
    for topic, kind in bag.types.items():
        if kind not in (RAW, COMPRESSED) or any(word in topic.lower() for word in NEITHER) or not len(bag.times(topic)):
            continue
        first = bag.first(topic)
        holds_depth = None if first is None else is_depth(first)
        if holds_depth is not None:
            images[holds_depth].append(topic)
    return (
        topics.get("color") or _best(images[False], COLOR_WORDS, bag, path, "color"),
        topics.get("depth") or _best(images[True], DEPTH_WORDS, bag, path, "depth"),
    )


def _best(candidates: list[str], words: tuple[str, ...], bag: Bag, path: Path, what: str) -> str:
    """Return the topic with the preferred name; in a tie the raw one, then the one with the most messages."""
    if not candidates:
        raise InputError(f"{path}: has no topic with {what} images; it has {', '.join(sorted(bag.types))}")

    def rank(topic: str) -> tuple[int, bool, int]:
        place = next((k for k, word in enumerate(words) if word in topic.lower()), len(words))
        return place, bag.types[topic] == COMPRESSED, -len(bag.times(topic))

    first, *others = sorted(candidates, key=lambda topic: (rank(topic), topic))
    if others and rank(others[0]) == rank(first):
        names = ", ".join(sorted(candidates))
        raise InputError(f"{path}: {what} may be any of {names}; name one: --topics {what}={first},...")
    return first


def _pose_topic(bag: Bag) -> str | None:
    """Return the only topic of poses of a bag that has no transforms."""
    if any("TFMessage" in kind or "tfMessage" in kind for kind in bag.types.values()):
        return None
    found = [topic for topic, kind in bag.types.items() if kind in STAMPED_TYPES]
    return found[0] if len(found) == 1 else None


def _gravity(bag: Bag, transforms: Transforms, frame: str) -> Gravity | None:
    """Return the first accelerometer that is fixed to the camera, as a gravity sensor, or None."""
    for topic in sorted(topic for topic, kind in bag.types.items() if kind == IMU):
        first = bag.first(topic) if len(bag.times(topic)) else None
        if first is None or not measures_gravity(first):
            continue
        T_color_imu = transforms.between(frame, frame_name(first.header.frame_id))
        if T_color_imu is not None:
            return Gravity(bag, topic, T_color_imu[:3, :3])
    return None


def _entries(
    bag: Bag, color_topic: str, depth_topic: str, transforms: Transforms | None, gravity: Gravity | None
) -> list[FrameEntry]:
    colors, depths = bag.times(color_topic), bag.times(depth_topic)
    step_s = float(np.median(np.diff(colors))) * 1e-9 if len(colors) > 1 else 0.0
    within_s = max(WITHIN_S, step_s / 2)
    begin = int(min(colors[0], depths[0]))  # nanoseconds since 1970 are too many digits for a float
    pairs = associate(((colors - begin) * 1e-9).tolist(), ((depths - begin) * 1e-9).tolist(), within_s)
    entries = []
    for k, time_ns in enumerate(colors.tolist()):
        depth_ns = int(depths[pairs[k]]) if k in pairs else None
        entries.append(
            FrameEntry(
                color=partial(_color, bag, color_topic, time_ns),
                depth=None if depth_ns is None else partial(_depth, bag, depth_topic, depth_ns),
                timestamp_s=time_ns * 1e-9,
                pose=None if transforms is None else partial(_pose, bag, color_topic, time_ns, transforms),
                pose_after=None if transforms is None else partial(_pose, bag, color_topic, time_ns, transforms),
                up_camera=None if gravity is None else partial(gravity.up_at, time_ns),
                fault=None
                if k in pairs
                else f"color without depth: none within {1000 * within_s:.0f} ms of {color_topic}",
            )
        )
    return entries


def _color(bag: Bag, topic: str, time_ns: int) -> Any:
    return color_of(bag.read(topic, time_ns), f"image of {topic} at {time_ns} ns")


def _depth(bag: Bag, topic: str, time_ns: int) -> Any:
    return depth_of(bag.read(topic, time_ns), f"image of {topic} at {time_ns} ns")


def _pose(bag: Bag, topic: str, time_ns: int, transforms: Transforms, after_s: float = 0.0) -> Float64Array:
    message = bag.read(topic, time_ns)
    taken_s = stamp_s(message)
    time_s = taken_s if abs(taken_s - time_ns * 1e-9) < SAME_LOG_CLOCK_S else time_ns * 1e-9
    return transforms.pose(frame_name(message.header.frame_id), time_ns + round(1e9 * after_s), time_s + after_s)


def _calibration(
    bag: Bag, transforms: Transforms, color: tuple[str, Any], depth: tuple[str, Any]
) -> Calibration | None:
    """Return the cameras; None if the color camera is unknown."""
    info, depth_info = _camera_info(bag, color[0]), _camera_info(bag, depth[0])
    if info is None:
        return None
    K, distortion = camera_of(info, "rect" in color[0].rsplit("/", 2)[-1], f"{color[0]} in {bag.name}")
    size = (int(info.width), int(info.height))
    found = Calibration(*K, size, f"CameraInfo of {color[0]}", distortion)
    if depth_info is None or any(word in depth[0] for word in DEPTH_WORDS[:2]):
        return found
    depth_K, depth_distortion = camera_of(
        depth_info, "rect" in depth[0].rsplit("/", 2)[-1], f"{depth[0]} in {bag.name}"
    )
    depth_size = (int(depth_info.width), int(depth_info.height))
    frames = [frame_name(message.header.frame_id) for _, message in (color, depth)]
    if depth_size == size and (frames[0] == frames[1] or np.allclose(depth_K, K, atol=1e-3)):
        return found
    T_color_depth = transforms.between(*frames)
    camera = DepthCamera(*depth_K, depth_size, np.eye(4) if T_color_depth is None else T_color_depth, depth_distortion)
    return Calibration(*K, size, found.source, distortion, camera)


def _camera_info(bag: Bag, topic: str) -> Any:
    """Return the first CameraInfo of the topic that shares the most with an image topic's name."""
    parts = topic.split("/")
    for depth in range(len(parts) - 1, 0, -1):
        name = "/".join([*parts[:depth], "camera_info"])
        if bag.types.get(name) == CAMERA_INFO and (message := bag.first(name)) is not None:
            return message
    return None


READERS.register("ros-bag")(
    Reader("a .bag, .db3 or .mcap file, or a folder of them", recognises, read, read_topics, (".bag", ".db3", ".mcap"))
)
