"""Writes frames as a bag of ROS 2 (MCAP), as RViz, Foxglove and `ros2 bag` open it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.formats.ros_messages import COLOR, DEPTH, OPTICAL_FRAME, TRANSFORMS, RosBag, nanoseconds

BAG = "recording"
# Depth in millimetres is written as whole numbers, other depth in metres (REP 118).
MILLIMETRES = 1000.0


class McapWriter(RosBag):
    """A bag with images, cameras and transforms; a context manager.

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
        super().__init__(folder / BAG, "writing a bag")
        self._intrinsics = intrinsics
        self._whole = units_per_metre == MILLIMETRES

    def add(self, frame: Frame) -> None:
        """Write the messages of a frame."""
        time_ns = nanoseconds(frame.timestamp_s)
        if frame.T_world_camera is not None:
            self.publish(TRANSFORMS, self.transforms([self.transform(frame.T_world_camera, time_ns)]), time_ns)
        for topic in (COLOR, DEPTH):
            self.publish(f"{topic}/camera_info", self.camera_info(self._intrinsics, time_ns), time_ns)
        self.publish(f"{COLOR}/image_raw", self._image(frame.color, "rgb8", time_ns), time_ns)
        if self._whole:
            depth, encoding = np.rint(frame.depth_m * np.float32(MILLIMETRES)).astype(np.uint16), "16UC1"
        else:
            depth, encoding = frame.depth_m, "32FC1"
        self.publish(f"{DEPTH}/image_raw", self._image(depth, encoding, time_ns), time_ns)

    def finish(self) -> None:
        """Nothing is left: the bag ends when it is closed."""

    def _image(self, pixels: Any, encoding: str, time_ns: int) -> Any:
        height, width = pixels.shape[:2]
        data = np.ascontiguousarray(pixels).view(np.uint8).reshape(-1)
        return self.make(
            "sensor_msgs/Image",
            header=self.header(OPTICAL_FRAME, time_ns),
            height=height,
            width=width,
            encoding=encoding,
            is_bigendian=0,
            step=data.size // height,
            data=data,
        )
