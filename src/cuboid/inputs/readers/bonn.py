"""Bonn RGB-D Dynamic (Palazzolo et al., "ReFusion", IROS 2019): the TUM format with other axes.

Expected tree::

    rgbd_bonn_balloon/        <- the recording; its name begins with rgbd_bonn
      rgb.txt, depth.txt      lines "timestamp filename", # begins a comment
      groundtruth.txt         lines "timestamp tx ty tz qx qy qz qw"; may be absent
      rgb/1548266469.88633.png      8-bit color
      depth/1548266469.88246.png    16-bit, 0 is no reading

Differences from TUM: the camera; and the trajectory has the poses of the markers on the camera in the motion capture's
axes. The dataset's page transforms points of the first camera to the world of its laser scan by T_ros T_0 T_ros T_m,
where T_0 is the first line and T_m the calibration of markers and camera; the same formula is used for each line. T_m
also contains a scale, 1.059: depth at the page's 5000 units per metre is too small by this factor compared with the
motion capture and the scan. The reader includes it in the depth scale.

Color and depth are registered, and both have the distortion of the color camera's lens.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.inputs.readers.posetext import Trajectory
from cuboid.inputs.readers.reader import READERS, Calibration, Listing, Reader
from cuboid.inputs.readers.tum import BONN, has_lists, list_frames
from cuboid.inputs.readers.tum import TUM_UNITS_PER_METRE as TUM_UNITS_PER_METRE

# All values are from the dataset's page.
CALIBRATION = Calibration(
    542.822841,
    542.576870,
    315.593520,
    237.756098,
    (640, 480),
    "published for Bonn RGB-D Dynamic",
    (0.039903, -0.099343, -0.000730, -0.000144, 0.0),
)
T_ROS = np.array([[-1.0, 0, 0, 0], [0, 0, 1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
_T_M = np.array(
    [
        [1.0157, 0.1828, -0.2389, 0.0113],
        [0.0009, -0.8431, -0.6413, -0.0098],
        [-0.3009, 0.6147, -0.8085, 0.0111],
        [0.0, 0.0, 0.0, 1.0],
    ]
)
SCALE = float(np.cbrt(np.linalg.det(_T_M[:3, :3])))
TUM_UNITS_PER_METRE = TUM_UNITS_PER_METRE / SCALE


def _without_scale(T: Float64Array) -> Float64Array:
    """Return the rigid transform nearest to a transform with scale and four-digit rounding."""
    rigid = T.copy()
    left, _, right = np.linalg.svd(T[:3, :3])
    rigid[:3, :3] = left @ right
    return rigid


T_MARKERS_CAMERA = _without_scale(_T_M)


def recognises(path: Path) -> bool:
    """Tell whether the folder has the files of TUM and a name of this dataset."""
    return path.name.lower().startswith(BONN) and has_lists(path)


def read(path: Path) -> Listing:
    """List the frames; raise InputError if a line of a list or of the trajectory has another format."""
    return Listing(list_frames(path, _pose_at), TUM_UNITS_PER_METRE, CALIBRATION, camera_folders=(path,))


def _pose_at(trajectory: Trajectory, time_s: float) -> Float64Array:
    T_capture_markers = trajectory.at(time_s)
    return np.asarray(T_ROS @ T_capture_markers @ T_ROS @ T_MARKERS_CAMERA, np.float64)


READERS.register("bonn")(Reader("rgbd_bonn_.../ with rgb.txt, depth.txt", recognises, read))
