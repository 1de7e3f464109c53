"""A bag of ROS 2 (MCAP) and the messages that go into it, without ROS: by rosbags (extra ``ros``)."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from cuboid.core.extras import require
from cuboid.core.frame import Float64Array, Intrinsics
from cuboid.geometry import se3

OPTICAL_FRAME, WORLD_FRAME = "camera_color_optical_frame", "world"
COLOR, DEPTH = "/camera/color", "/camera/aligned_depth_to_color"
TRANSFORMS = "/tf"
# The version of the metadata that `ros2 bag` of Humble and later reads.
METADATA_VERSION = 9

# Messages of vision_msgs 4 (Humble and later); rosbags knows only the messages of ROS itself.
VISION = {
    "vision_msgs/msg/ObjectHypothesis": "string class_id\nfloat64 score",
    "vision_msgs/msg/ObjectHypothesisWithPose": (
        "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose"
    ),
    "vision_msgs/msg/BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size",
    "vision_msgs/msg/Detection3D": (
        "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
        "vision_msgs/BoundingBox3D bbox\nstring id"
    ),
    "vision_msgs/msg/Detection3DArray": "std_msgs/Header header\nvision_msgs/Detection3D[] detections",
}


class RosBag:
    """A bag that is written; a context manager.

    Parameters
    ----------
    folder : Path
        Of the bag; gets its name.
    feature : str
        What the user asked for, where rosbags is missing.

    Raises
    ------
    MissingExtraError
        rosbags is not installed.
    """

    def __init__(self, folder: Path, feature: str) -> None:
        rosbag2, typesys = (require(f"rosbags.{name}", feature, "ros") for name in ("rosbag2", "typesys"))
        self._store: Any = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
        for name, text in VISION.items():
            self._store.register(typesys.get_types_from_msg(text, name))
        self._writer: Any = rosbag2.Writer(folder, version=METADATA_VERSION, storage_plugin=rosbag2.StoragePlugin.MCAP)
        self._connections: dict[str, Any] = {}

    def __enter__(self) -> Self:
        self._writer.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._writer.close()

    def publish(self, topic: str, message: Any, time_ns: int) -> None:
        """Write a message."""
        kind = message.__msgtype__
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(topic, kind, typestore=self._store)
        self._writer.write(self._connections[topic], time_ns, self._store.serialize_cdr(message, kind))

    def make(self, kind: str, **fields: Any) -> Any:
        """Return a message, "sensor_msgs/Image" say."""
        package, name = kind.split("/")
        return self._store.types[f"{package}/msg/{name}"](**fields)

    def header(self, frame: str, time_ns: int) -> Any:
        """Return a std_msgs/Header."""
        stamp = self.make("builtin_interfaces/Time", sec=time_ns // 10**9, nanosec=time_ns % 10**9)
        return self.make("std_msgs/Header", stamp=stamp, frame_id=frame)

    def camera_info(self, intrinsics: Intrinsics, time_ns: int) -> Any:
        """Return the sensor_msgs/CameraInfo of a pinhole."""
        c = intrinsics
        K = np.array([c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1], np.float64)
        whole = self.make("sensor_msgs/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
        return self.make(
            "sensor_msgs/CameraInfo",
            header=self.header(OPTICAL_FRAME, time_ns),
            height=c.height,
            width=c.width,
            distortion_model="plumb_bob",
            d=np.zeros(5),
            k=K,
            r=np.eye(3).ravel(),
            p=np.array([*K[:3], 0, *K[3:6], 0, *K[6:], 0]),
            binning_x=0,
            binning_y=0,
            roi=whole,
        )

    def transform(self, T_world_camera: Float64Array, time_ns: int) -> Any:
        """Return the camera's pose as tf2_msgs/TFMessage."""
        pose = self.pose(T_world_camera)
        transform = self.make(
            "geometry_msgs/Transform", translation=self.xyz(T_world_camera[:3, 3]), rotation=pose.orientation
        )
        stamped = self.make(
            "geometry_msgs/TransformStamped",
            header=self.header(WORLD_FRAME, time_ns),
            child_frame_id=OPTICAL_FRAME,
            transform=transform,
        )
        return self.make("tf2_msgs/TFMessage", transforms=[stamped])

    def xyz(self, values: Float64Array, kind: str = "geometry_msgs/Vector3") -> Any:
        """Return three numbers as a message."""
        x, y, z = (float(value) for value in values)
        return self.make(kind, x=x, y=y, z=z)

    def pose(self, T: Float64Array) -> Any:
        """Return a transform (4, 4) as geometry_msgs/Pose."""
        w, x, y, z = (float(value) for value in se3.quat_wxyz_from_rotation(T[:3, :3]))
        turn = self.make("geometry_msgs/Quaternion", x=x, y=y, z=z, w=w)
        return self.make("geometry_msgs/Pose", position=self.xyz(T[:3, 3], "geometry_msgs/Point"), orientation=turn)


def nanoseconds(time_s: float) -> int:
    """Return a time in nanoseconds, rounded to microseconds: a float of seconds since 1970 has no more digits."""
    return round(time_s * 1e6) * 1000
