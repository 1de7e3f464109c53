"""Writes frames as a bag of ROS 2 (MCAP), as RViz, Foxglove and `ros2 bag` open it."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from cuboid.errors import InputError
from cuboid.frame import Float64Array, Frame, Intrinsics
from cuboid.geometry import se3

OPTICAL_FRAME, WORLD_FRAME = "camera_color_optical_frame", "world"
COLOR, DEPTH = "/camera/color", "/camera/aligned_depth_to_color"
BAG = "recording"
# Depth in millimetres is written as whole numbers, other depth in metres (REP 118).
MILLIMETRES = 1000.0


class McapWriter:
    """A bag with images, cameras and transforms.

    Parameters
    ----------
    folder : Path
        Gets the folder of the bag.
    intrinsics : Intrinsics
    units_per_metre : float
        Of the depth of the recording.

    Raises
    ------
    InputError
        `rosbags` is not installed.
    """

    def __init__(self, folder: Path, intrinsics: Intrinsics, units_per_metre: float) -> None:
        try:
            from rosbags.rosbag2 import StoragePlugin, Writer
            from rosbags.typesys import Stores, get_typestore
        except ImportError:
            raise InputError(
                "bags are written with rosbags, which is not installed: pip install 'cuboid[ros]'"
            ) from None
        self._store: Any = get_typestore(Stores.ROS2_HUMBLE)
        self._writer: Any = Writer(folder / BAG, version=9, storage_plugin=StoragePlugin.MCAP)
        self._intrinsics = intrinsics
        self._whole = units_per_metre == MILLIMETRES
        self._connections: dict[str, Any] = {}

    def __enter__(self) -> Self:
        self._writer.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._writer.close()

    def add(self, frame: Frame) -> None:
        """Write the messages of a frame."""
        time_ns = round(frame.timestamp_s * 1e6) * 1000
        if frame.T_world_camera is not None:
            self._publish("/tf", self._transform(frame.T_world_camera, time_ns), time_ns)
        for topic in (COLOR, DEPTH):
            self._publish(f"{topic}/camera_info", self._info(time_ns), time_ns)
        self._publish(f"{COLOR}/image_raw", self._image(frame.color, "rgb8", time_ns), time_ns)
        if self._whole:
            depth, encoding = np.rint(frame.depth_m * np.float32(MILLIMETRES)).astype(np.uint16), "16UC1"
        else:
            depth, encoding = frame.depth_m, "32FC1"
        self._publish(f"{DEPTH}/image_raw", self._image(depth, encoding, time_ns), time_ns)

    def finish(self) -> None:
        """Nothing is left: the bag ends when it is closed."""

    def _publish(self, topic: str, message: Any, time_ns: int) -> None:
        kind = message.__msgtype__
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(topic, kind, typestore=self._store)
        self._writer.write(self._connections[topic], time_ns, self._store.serialize_cdr(message, kind))

    def _make(self, kind: str, **fields: Any) -> Any:
        return self._store.types[kind](**fields)

    def _header(self, frame: str, time_ns: int) -> Any:
        stamp = self._make("builtin_interfaces/msg/Time", sec=time_ns // 10**9, nanosec=time_ns % 10**9)
        return self._make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def _image(self, pixels: Any, encoding: str, time_ns: int) -> Any:
        height, width = pixels.shape[:2]
        data = np.ascontiguousarray(pixels).view(np.uint8).reshape(-1)
        return self._make(
            "sensor_msgs/msg/Image",
            header=self._header(OPTICAL_FRAME, time_ns),
            height=height,
            width=width,
            encoding=encoding,
            is_bigendian=0,
            step=data.size // height,
            data=data,
        )

    def _info(self, time_ns: int) -> Any:
        c = self._intrinsics
        K = np.array([c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1], np.float64)
        whole = self._make(
            "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        )
        return self._make(
            "sensor_msgs/msg/CameraInfo",
            header=self._header(OPTICAL_FRAME, time_ns),
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

    def _transform(self, T_world_camera: Float64Array, time_ns: int) -> Any:
        w, x, y, z = (float(value) for value in se3.quat_wxyz_from_rotation(T_world_camera[:3, :3]))
        tx, ty, tz = (float(value) for value in T_world_camera[:3, 3])
        transform = self._make(
            "geometry_msgs/msg/Transform",
            translation=self._make("geometry_msgs/msg/Vector3", x=tx, y=ty, z=tz),
            rotation=self._make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w),
        )
        stamped = self._make(
            "geometry_msgs/msg/TransformStamped",
            header=self._header(WORLD_FRAME, time_ns),
            child_frame_id=OPTICAL_FRAME,
            transform=transform,
        )
        return self._make("tf2_msgs/msg/TFMessage", transforms=[stamped])
