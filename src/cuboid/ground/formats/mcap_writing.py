"""Writes frames as a bag of ROS 2 (MCAP), as RViz, Foxglove and `ros2 bag` open it."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Self

import numpy as np

from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.formats.ros_messages import COLOR, DEPTH, OPTICAL_FRAME, TRANSFORMS, RosBag, nanoseconds

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
    MissingExtraError
        `rosbags` is not installed.
    """

    def __init__(self, folder: Path, intrinsics: Intrinsics, units_per_metre: float) -> None:
        self._bag = RosBag(folder / BAG, "writing a bag")
        self._intrinsics = intrinsics
        self._whole = units_per_metre == MILLIMETRES

    def __enter__(self) -> Self:
        self._bag.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._bag.__exit__(*error)

    def add(self, frame: Frame) -> None:
        """Write the messages of a frame."""
        bag, time_ns = self._bag, nanoseconds(frame.timestamp_s)
        if frame.T_world_camera is not None:
            bag.publish(TRANSFORMS, bag.transforms([bag.transform(frame.T_world_camera, time_ns)]), time_ns)
        for topic in (COLOR, DEPTH):
            bag.publish(f"{topic}/camera_info", bag.camera_info(self._intrinsics, time_ns), time_ns)
        bag.publish(f"{COLOR}/image_raw", self._image(frame.color, "rgb8", time_ns), time_ns)
        if self._whole:
            depth, encoding = np.rint(frame.depth_m * np.float32(MILLIMETRES)).astype(np.uint16), "16UC1"
        else:
            depth, encoding = frame.depth_m, "32FC1"
        bag.publish(f"{DEPTH}/image_raw", self._image(depth, encoding, time_ns), time_ns)

    def finish(self) -> None:
        """Nothing is left: the bag ends when it is closed."""

    def _image(self, pixels: Any, encoding: str, time_ns: int) -> Any:
        height, width = pixels.shape[:2]
        data = np.ascontiguousarray(pixels).view(np.uint8).reshape(-1)
        return self._bag.make(
            "sensor_msgs/Image",
            header=self._bag.header(OPTICAL_FRAME, time_ns),
            height=height,
            width=width,
            encoding=encoding,
            is_bigendian=0,
            step=data.size // height,
            data=data,
        )
