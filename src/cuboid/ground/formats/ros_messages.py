"""The messages of ROS 2, their bytes, and a bag (MCAP) of them, without ROS: by rosbags (extra ``ros``)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.extras import require
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.geometry import se3

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

# Our own messages; `ros/cuboid_ros/msg` builds the same for ROS.
OWN = {
    "cuboid_ros/msg/ObjectEvent": (
        "std_msgs/Header header\nstring event\nuint32 label\nstring name\n"
        "geometry_msgs/Point from_position\ngeometry_msgs/Point to_position\nfloat64 score\n"
    ),
}

# Types of the services of the node, beside those of ROS itself; `ros/cuboid_ros/srv` builds the same for ROS.
ANSWER = "bool success\nstring message\n"
SERVICES = {
    "std_srvs/srv/Trigger": ("uint8 structure_needs_at_least_one_member\n", ANSWER),
    "cuboid_ros/srv/Save": ("string folder\n", ANSWER),
    "cuboid_ros/srv/Name": ("uint32 label\nstring name\n", ANSWER),
    "cuboid_ros/srv/Query": (
        "uint32 label\nstring name\ngeometry_msgs/Point near\nfloat64 within_m\n",
        f"{ANSWER}vision_msgs/Detection3DArray objects\n",
    ),
    "cuboid_ros/srv/Cloud": ("uint32 label\n", f"{ANSWER}sensor_msgs/PointCloud2 cloud\n"),
}


class RosMessages:
    """Makes messages of ROS 2, and their bytes as they are on the wire and in bags (CDR).

    Parameters
    ----------
    feature : str
        What the user asked for, where rosbags is missing.
    extra : str
        The extra that brings it.

    Attributes
    ----------
    store :
        What rosbags knows of message types.

    Raises
    ------
    MissingExtraError
        rosbags is not installed.
    """

    def __init__(self, feature: str, extra: str = "ros") -> None:
        typesys = require("rosbags.typesys", feature, extra)
        self.store: Any = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
        definitions = VISION | OWN
        for name, (request, answer) in SERVICES.items():
            definitions |= {request_of(name): request, response_of(name): answer}
        for name, text in definitions.items():
            self.store.register(typesys.get_types_from_msg(text, name))

    def encode(self, message: Any) -> bytes:
        """Return the bytes of a message."""
        return bytes(self.store.serialize_cdr(message, message.__msgtype__))

    def decode(self, data: bytes, kind: str) -> Any:
        """Return the message that bytes hold.

        Parameters
        ----------
        data : bytes
        kind : str
            Its full name, "sensor_msgs/msg/Image" say.

        Raises
        ------
        FrameError
            They hold none.
        """
        try:
            return self.store.deserialize_cdr(data, kind)
        except Exception as error:  # of bytes that are cut short or damaged rosbags raises nearly anything
            raise FrameError(f"a message is no {kind}: {type(error).__name__}: {error}") from None

    def definition(self, kind: str) -> str:
        """Return the text that defines a type of message, with those of the types within it."""
        return str(self.store.generate_msgdef(kind, ros_version=2)[0])

    def make(self, kind: str, **fields: Any) -> Any:
        """Return a message, "sensor_msgs/Image" say."""
        package, name = kind.split("/")
        return self.store.types[f"{package}/msg/{name}"](**fields)

    def header(self, frame: str, time_ns: int) -> Any:
        """Return a std_msgs/Header."""
        stamp = self.make("builtin_interfaces/Time", sec=time_ns // 10**9, nanosec=time_ns % 10**9)
        return self.make("std_msgs/Header", stamp=stamp, frame_id=frame)

    def camera_info(self, intrinsics: Intrinsics, time_ns: int, frame: str = OPTICAL_FRAME) -> Any:
        """Return the sensor_msgs/CameraInfo of a pinhole."""
        c = intrinsics
        K = np.array([c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1], np.float64)
        whole = self.make("sensor_msgs/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
        return self.make(
            "sensor_msgs/CameraInfo",
            header=self.header(frame, time_ns),
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

    def transform(
        self, T_parent_child: Float64Array, time_ns: int, parent: str = WORLD_FRAME, child: str = OPTICAL_FRAME
    ) -> Any:
        """Return the place of a frame, unless named the camera's, in another as geometry_msgs/TransformStamped."""
        translation, pose = self.xyz(T_parent_child[:3, 3]), self.pose(T_parent_child)
        transform = self.make("geometry_msgs/Transform", translation=translation, rotation=pose.orientation)
        return self.make(
            "geometry_msgs/TransformStamped",
            header=self.header(parent, time_ns),
            child_frame_id=child,
            transform=transform,
        )

    def transforms(self, transforms: Sequence[Any]) -> Any:
        """Return a tf2_msgs/TFMessage of the results of `transform`."""
        return self.make("tf2_msgs/TFMessage", transforms=list(transforms))

    def xyz(self, values: Float64Array, kind: str = "geometry_msgs/Vector3") -> Any:
        """Return three numbers as a message."""
        x, y, z = (float(value) for value in values)
        return self.make(kind, x=x, y=y, z=z)

    def pose(self, T: Float64Array) -> Any:
        """Return a transform (4, 4) as geometry_msgs/Pose."""
        w, x, y, z = (float(value) for value in se3.quat_wxyz_from_rotation(T[:3, :3]))
        turn = self.make("geometry_msgs/Quaternion", x=x, y=y, z=z, w=w)
        return self.make("geometry_msgs/Pose", position=self.xyz(T[:3, 3], "geometry_msgs/Point"), orientation=turn)


class RosBag(RosMessages):
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
        super().__init__(feature)
        rosbag2 = require("rosbags.rosbag2", feature, "ros")
        self._writer: Any = rosbag2.Writer(folder, version=METADATA_VERSION, storage_plugin=rosbag2.StoragePlugin.MCAP)
        self._connections: dict[str, Any] = {}

    def __enter__(self) -> Self:
        self._writer.open()
        return self

    def __exit__(self, *error: object) -> None:
        self._writer.close()

    def publish(self, topic: str, message: Any, time_ns: int) -> None:
        """Write a message."""
        if topic not in self._connections:
            kind = message.__msgtype__
            self._connections[topic] = self._writer.add_connection(topic, kind, typestore=self.store)
        self._writer.write(self._connections[topic], time_ns, self.encode(message))


def ros_name(camera: str) -> str:
    """Return the name of a camera of a rig as a part of the name of a topic: letters, digits and underscores."""
    name = "".join(letter if letter.isascii() and letter.isalnum() else "_" for letter in camera)
    return name if name[:1].isalpha() else f"camera_{name}"


def optical_frame(camera: str) -> str:
    """Return the frame of a camera of a rig; without a rig it is `OPTICAL_FRAME`."""
    return OPTICAL_FRAME.replace("camera", ros_name(camera), 1)


def camera_topics(camera: str) -> tuple[str, str]:
    """Return the topics of color and depth of a camera of a rig; without a rig they are `COLOR` and `DEPTH`."""
    color, depth = (topic.replace("camera", ros_name(camera), 1) for topic in (COLOR, DEPTH))
    return color, depth


def request_of(service: str) -> str:
    """Return the name that the request of a type of service ("std_srvs/srv/Trigger") has in rosbags."""
    return f"{service.replace('/srv/', '/srv/msg/')}_Request"


def response_of(service: str) -> str:
    """Return the name that the answer of a type of service has in rosbags."""
    return request_of(service).removesuffix("_Request") + "_Response"


def nanoseconds(time_s: float) -> int:
    """Return a time in nanoseconds, rounded to microseconds: a float of seconds since 1970 has no more digits."""
    return round(time_s * 1e6) * 1000
