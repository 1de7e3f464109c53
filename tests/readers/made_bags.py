"""Frames of a plain folder, written as bags by the library that knows them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from made_recordings import CAMERA, SIZE, color_image, depth_image
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

START_NS = 1_700_000_000_000_000_000
STEP_NS = 33_000_000
ROS2 = get_typestore(Stores.ROS2_HUMBLE)
ROS1 = get_typestore(Stores.ROS1_NOETIC)
ROS1.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
# Publish a message: topic, message, time.
Publish = Callable[[str, Any, int], None]


class Messages:
    """Makes messages of ROS 1 or ROS 2."""

    def __init__(self, ros: int) -> None:
        self.ros = ros
        self.types = (ROS1 if ros == 1 else ROS2).types

    def __call__(self, name: str, **fields: Any) -> Any:
        return self.types[name](**fields)

    def header(self, frame: str, time_ns: int) -> Any:
        stamp = self("builtin_interfaces/msg/Time", sec=time_ns // 10**9, nanosec=time_ns % 10**9)
        more = {"seq": 0} if self.ros == 1 else {}
        return self("std_msgs/msg/Header", stamp=stamp, frame_id=frame, **more)

    def image(self, pixels: np.ndarray, encoding: str, frame: str, time_ns: int) -> Any:
        height, width = pixels.shape[:2]
        data = np.ascontiguousarray(pixels).view(np.uint8).reshape(-1)
        step = data.size // height
        header = self.header(frame, time_ns)
        return self(
            "sensor_msgs/msg/Image",
            header=header,
            height=height,
            width=width,
            encoding=encoding,
            is_bigendian=0,
            step=step,
            data=data,
        )

    def compressed(self, data: bytes, words: str, frame: str, time_ns: int) -> Any:
        header = self.header(frame, time_ns)
        return self("sensor_msgs/msg/CompressedImage", header=header, format=words, data=np.frombuffer(data, np.uint8))

    def info(self, camera: dict[str, float], frame: str, time_ns: int, distortion: tuple[float, ...] = (0,) * 5) -> Any:
        c, K, D, R, P = camera, *(("K", "D", "R", "P") if self.ros == 1 else ("k", "d", "r", "p"))
        matrix = np.array([c["fx"], 0, c["cx"], 0, c["fy"], c["cy"], 0, 0, 1], np.float64)
        roi = self("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
        projection = np.array([*matrix[:3], 0, *matrix[3:6], 0, *matrix[6:], 0])
        fields = {K: matrix, D: np.array(distortion, np.float64), R: np.eye(3).ravel(), P: projection}
        return self(
            "sensor_msgs/msg/CameraInfo",
            header=self.header(frame, time_ns),
            height=int(c["height"]),
            width=int(c["width"]),
            distortion_model="plumb_bob",
            binning_x=0,
            binning_y=0,
            roi=roi,
            **fields,
        )

    def transform(self, parent: str, child: str, time_ns: int, move: tuple[float, ...], turn: tuple[float, ...]) -> Any:
        vector = self("geometry_msgs/msg/Vector3", x=move[0], y=move[1], z=move[2])
        quaternion = self("geometry_msgs/msg/Quaternion", x=turn[0], y=turn[1], z=turn[2], w=turn[3])
        one = self(
            "geometry_msgs/msg/TransformStamped",
            header=self.header(parent, time_ns),
            child_frame_id=child,
            transform=self("geometry_msgs/msg/Transform", translation=vector, rotation=quaternion),
        )
        return self("tf2_msgs/msg/TFMessage", transforms=[one])

    def imu(self, frame: str, time_ns: int, acceleration: tuple[float, ...]) -> Any:
        zero, level = self("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0), np.zeros(9)
        return self(
            "sensor_msgs/msg/Imu",
            header=self.header(frame, time_ns),
            orientation=self("geometry_msgs/msg/Quaternion", x=0, y=0, z=0, w=1),
            orientation_covariance=level,
            angular_velocity=zero,
            angular_velocity_covariance=level,
            linear_acceleration=self(
                "geometry_msgs/msg/Vector3", x=acceleration[0], y=acceleration[1], z=acceleration[2]
            ),
            linear_acceleration_covariance=level,
        )

    def odometry(self, frame: str, time_ns: int, move: tuple[float, ...]) -> Any:
        point = self("geometry_msgs/msg/Point", x=move[0], y=move[1], z=move[2])
        turn = self("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
        pose = self("geometry_msgs/msg/Pose", position=point, orientation=turn)
        return self("geometry_msgs/msg/PoseStamped", header=self.header(frame, time_ns), pose=pose)


@contextmanager
def writing(path: Path, kind: str) -> Iterator[tuple[Messages, Publish]]:
    """Write a bag: kind is "bag", "db3" or "mcap"; gives what makes messages and what publishes them."""
    ros = 1 if kind == "bag" else 2
    messages, store = Messages(ros), ROS1 if ros == 1 else ROS2
    if ros == 1:
        writer: Any = Writer1(path)
        writer.set_compression(Writer1.CompressionFormat.LZ4)
    else:
        plugin = StoragePlugin.SQLITE3 if kind == "db3" else StoragePlugin.MCAP
        writer = Writer2(path, version=9, storage_plugin=plugin)
    with writer:
        connections: dict[str, Any] = {}

        def publish(topic: str, message: Any, time_ns: int) -> None:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, message.__msgtype__, typestore=store)
            serialize = store.serialize_ros1 if ros == 1 else store.serialize_cdr
            writer.write(connections[topic], time_ns, serialize(message, message.__msgtype__))

        yield messages, publish


def encoded(suffix: str, image: np.ndarray) -> bytes:
    stored = image[..., ::-1] if image.ndim == 3 else image
    done, data = cv2.imencode(suffix, np.ascontiguousarray(stored))
    assert done
    return data.tobytes()


def time_of(k: int) -> int:
    return START_NS + k * STEP_NS


def make_bag(path: Path, kind: str, frames: int = 5) -> Path:
    """The frames of `make_plain`, aligned depth, poses of a base that carries the camera."""
    with writing(path, kind) as (make, publish):
        optical = "camera_color_optical_frame"
        publish("/tf_static", make.transform("base", optical, START_NS, (0.0, 0.2, 0.0), (0, 0, 0, 1)), START_NS)
        publish("/camera/color/camera_info", make.info(CAMERA, optical, START_NS), START_NS)
        for k in range(-1, frames + 1):  # transforms come between the images, and around them
            time_ns = time_of(k) + STEP_NS // 2
            move = (0.1 * (k + 0.5), 0.0, 0.0)
            publish("/tf", make.transform("odom", "base", time_ns, move, (0, 0, 0, 1)), max(time_ns, START_NS))
        for k in range(frames):
            t = time_of(k)
            publish("/camera/color/image_raw", make.image(color_image(k), "rgb8", optical, t), t)
            depth = make.image(depth_image(k, 1000.0), "16UC1", optical, t)
            publish("/camera/aligned_depth_to_color/image_raw", depth, t + 4_000_000)
            ir = make.image(np.zeros(SIZE, np.uint8), "mono8", "infra", t)
            publish("/camera/infra1/image_rect_raw", ir, t)
    return path
