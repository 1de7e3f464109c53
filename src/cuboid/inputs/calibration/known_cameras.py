"""Depth cameras in wide use, whose two images are not aligned: which of them fits the edges of a recording.

Fields of view and distances of the two cameras are those of the makers' data sheets; focal lengths of single devices
differ by about 3 %. A layout only counts if the edges of depth, registered by it, agree with those of color.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from cuboid.ground.core.errors import InputError
from cuboid.ground.geometry.se3 import assembled
from cuboid.inputs.calibration.registering import WORTH_A_WARNING, misregistration_of
from cuboid.inputs.readers import Calibration, DepthCamera, Recording

# A width times a height of this ratio is 16:9, of the other 4:3; sizes in use differ from them by less than 2 %.
WIDE_RATIO, NARROW, SAME_SHAPE = 16.0 / 9.0, 4.0 / 3.0, 0.02


@dataclass(frozen=True, slots=True)
class KnownCamera:
    """The layout of a device.

    Attributes
    ----------
    name : str
    depth, color : mapping of (int, int) or float to float
        Horizontal field of view, degrees, by the size of the image, or by the ratio of its sides.
    apart_m : float
        x of the depth camera in the color camera's axes, metres.
    units : float
        Depth units per metre that its tools write.
    """

    name: str
    depth: dict[tuple[int, int] | float, float]
    color: dict[tuple[int, int] | float, float]
    apart_m: float
    units: float = 1000.0


CAMERAS = (
    KnownCamera("Intel RealSense D435", {WIDE_RATIO: 90.0, NARROW: 79.6}, {WIDE_RATIO: 69.4, NARROW: 55.0}, 0.015),
    KnownCamera("Intel RealSense D415", {WIDE_RATIO: 69.4, NARROW: 55.0}, {WIDE_RATIO: 69.4, NARROW: 55.0}, 0.015),
    KnownCamera("Intel RealSense D455", {WIDE_RATIO: 90.0, NARROW: 79.6}, {WIDE_RATIO: 90.0, NARROW: 73.7}, 0.059),
    KnownCamera("Intel RealSense L515", {NARROW: 70.0}, {WIDE_RATIO: 70.4, NARROW: 55.0}, 0.0, 4000.0),
    KnownCamera("Kinect for Xbox 360", {NARROW: 57.3}, {NARROW: 62.7}, -0.025),
    KnownCamera("Kinect for Xbox One", {(512, 424): 70.1}, {(1920, 1080): 84.1}, -0.052),
    KnownCamera(
        "Azure Kinect",
        {(640, 576): 64.8, (320, 288): 64.8, (512, 512): 90.9, (1024, 1024): 90.9},
        {WIDE_RATIO: 92.9, NARROW: 92.9},
        0.032,
    ),
    KnownCamera("OAK-D", {1.6: 71.9, (1280, 720): 71.9}, {(1920, 1080): 68.8, (3840, 2160): 68.8}, 0.0375),
    KnownCamera("Asus Xtion or Structure Sensor", {NARROW: 58.0}, {NARROW: 62.7}, -0.025),
)


def layouts(color: tuple[int, int], depth: tuple[int, int]) -> Iterator[tuple[KnownCamera, Calibration]]:
    """Yield the known cameras that take images of these sizes (width, height), each with its calibration."""
    for camera in CAMERAS:
        of_color, of_depth = _focal(camera.color, color), _focal(camera.depth, depth)
        if of_color is None or of_depth is None:
            continue
        K_depth = of_depth, of_depth, (depth[0] - 1) / 2, (depth[1] - 1) / 2
        depth_camera = DepthCamera(*K_depth, depth, assembled(np.eye(3), (camera.apart_m, 0.0, 0.0)))
        center = (color[0] - 1) / 2, (color[1] - 1) / 2
        yield camera, Calibration(of_color, of_color, *center, color, camera.name, depth_camera=depth_camera)


def _focal(fields: dict[tuple[int, int] | float, float], size: tuple[int, int]) -> float | None:
    """Return the focal length of images of a size, pixels; None if the camera takes no such images."""
    for form, angle_deg in fields.items():
        same = form == size if isinstance(form, tuple) else abs(size[0] / size[1] / form - 1.0) < SAME_SHAPE
        if same:
            return size[0] / 2.0 / math.tan(math.radians(angle_deg) / 2.0)
    return None


def fitting_camera(
    opened: Callable[[Calibration, float], Recording], color: tuple[int, int], depth: tuple[int, int]
) -> tuple[KnownCamera, Recording] | None:
    """Return the known camera whose layout fits the edges best, and the recording opened with it; None if none fits.

    Images that are aligned already fit none.

    Parameters
    ----------
    opened : callable
        Opens the recording with a calibration and a number of depth units per metre; raises InputError.
    color, depth : (int, int)
        Width and height of the images.
    """
    if color == depth and _is_aligned(opened, color):
        return None
    best: tuple[float, KnownCamera, Recording] | None = None
    for camera, calibration in layouts(color, depth):
        try:
            recording = opened(calibration, camera.units).without_poses()
        except InputError:
            continue
        found = misregistration_of(recording.read, range(len(recording)))
        if found is None or found.off_px >= WORTH_A_WARNING * color[0]:
            continue
        if best is None or found.off_px < best[0]:
            best = found.off_px, camera, recording
    return None if best is None else best[1:]


def _is_aligned(opened: Callable[[Calibration, float], Recording], size: tuple[int, int]) -> bool:
    """Return whether depth and color of one size show no clear displacement."""
    width, height = size
    plain = Calibration(float(width), float(width), (width - 1) / 2, (height - 1) / 2, size, "any")
    try:
        recording = opened(plain, 1000.0).without_poses()
        found = misregistration_of(recording.read, range(len(recording)))
    except InputError:
        return False
    return found is not None and not (found.clear and found.off_px >= WORTH_A_WARNING * width)


def camera_text(recording: Recording) -> str:
    """Return the `camera.json` of a recording with a depth camera, in one line."""
    K, depth_camera = recording.intrinsics, recording.depth_camera
    document: dict[str, object] = {name: round(getattr(K, name), 1) for name in ("fx", "fy", "cx", "cy")}
    document |= {"width": K.width, "height": K.height, "depth_units_per_metre": recording.depth_units_per_metre}
    if depth_camera is not None:
        document |= depth_camera.document()
    return json.dumps(document)
