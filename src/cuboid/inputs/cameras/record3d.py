"""An iPhone or iPad with the app Record3D, by USB and the package record3d.

Options: ``id=`` which of several (its UDID).

The package is under the LGPL, so it is not part of an extra; see `PIP`. Depth has 192x256 pixels; color is downsampled
by an integer factor. The app sends no timestamps: times of arrival are used. The poses are ARKit's.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import FrameError, InputError
from cuboid.inputs.cameras.driver import CAMERAS, Shot, StreamEndedError, library, refuse_unknown
from cuboid.inputs.readers.phone import T_OPENGL_OPENCV, phone_cameras, shrink_factor, shrunk
from cuboid.inputs.readers.posetext import pose_from_quaternion

NAME = "record3d"
OPTIONS = ("id",)
PIP = "record3d"
# Minimum ARKit confidence (0 low, 1 medium, 2 high) of a reading.
MIN_CONFIDENCE = 1
# Maximum waiting time for the first frame, seconds: the app may first ask its user.
FIRST_FRAME_S = 20.0


class Record3D:
    """A device that runs Record3D in the mode "USB streaming".

    Parameters
    ----------
    options : mapping of str to str

    Raises
    ------
    InputError
        There is no such device, or it sends nothing.
    MissingExtraError
        record3d is not installed.
    """

    has_poses = True
    paced = False
    depth_units_per_metre = 1.0

    def __init__(self, options: Mapping[str, str]) -> None:
        refuse_unknown(NAME, options, OPTIONS)
        record3d = library("record3d", NAME, pip=PIP)
        devices = record3d.Record3DStream.get_connected_devices()
        wanted = options.get("id")
        chosen = next((one for one in devices if wanted in (None, str(one.udid))), None)
        if chosen is None:
            which = "no device" if wanted is None else f"no device '{wanted}'"
            raise InputError(f"--camera {NAME}: {which} is there; connect it by USB and start Record3D's USB streaming")
        self.name = f"Record3D {chosen.udid}"
        self._arrived, self._stopped = threading.Event(), threading.Event()
        self._stream = record3d.Record3DStream()
        self._stream.on_new_frame = self._arrived.set
        self._stream.on_stream_stopped = self._stopped.set
        self._stream.connect(chosen)
        try:
            if not self._arrived.wait(FIRST_FRAME_S):
                raise InputError(f"{self.name}: gave no frame for {FIRST_FRAME_S:g} s; start its USB streaming")
            self.calibration = self._first_calibration()
        except BaseException:
            self.close()
            raise

    def _first_calibration(self) -> Any:
        color, depth = np.asarray(self._stream.get_rgb_frame()), np.asarray(self._stream.get_depth_frame())
        K = self._stream.get_intrinsic_mat()
        size, depth_size = (color.shape[1], color.shape[0]), (depth.shape[1], depth.shape[0])
        self._factor = shrink_factor(size)
        return phone_cameras((K.fx, K.fy, K.tx, K.ty), size, depth_size, "the app")

    def take(self, wait_s: float) -> Shot | None:
        """Return the newest frame; None if none arrives within that time."""
        if not self._arrived.wait(wait_s):
            if self._stopped.is_set():
                raise StreamEndedError
            return None
        self._arrived.clear()
        arrived_s, stream = time.time(), self._stream
        color = shrunk(np.array(stream.get_rgb_frame(), np.uint8, order="C"), self._factor)
        depth = np.array(stream.get_depth_frame(), np.float32)
        sure = np.asarray(stream.get_confidence_frame())
        if sure.shape == depth.shape:  # the front camera has none
            depth[sure < MIN_CONFIDENCE] = 0.0
        return Shot(arrived_s, color, depth, _pose(stream.get_camera_pose()))

    def close(self) -> None:
        """Close the device."""
        self._stream.disconnect()


def _pose(pose: Any) -> Float64Array | None:
    """Return the pose of the camera with OpenCV's axes; None while ARKit has none."""
    try:
        T = pose_from_quaternion((pose.qw, pose.qx, pose.qy, pose.qz), (pose.tx, pose.ty, pose.tz), "the pose")
    except FrameError:
        return None
    return T @ T_OPENGL_OPENCV


CAMERAS.register(NAME)(Record3D)
