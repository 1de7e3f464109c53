"""Live cameras: one driver per file, imported when its camera is opened.

Other packages can add drivers (entry points ``cuboid.cameras``).
"""

from __future__ import annotations

from cuboid.inputs.cameras import oak, orbbec, realsense, record3d, ros2
from cuboid.inputs.cameras.driver import CAMERAS, Driver, Shot, StreamEndedError
from cuboid.inputs.cameras.live import LiveCamera, open_camera
from cuboid.inputs.cameras.live_rig import LiveRig, open_cameras

__all__ = [
    "CAMERAS",
    "Driver",
    "LiveCamera",
    "LiveRig",
    "Shot",
    "StreamEndedError",
    "oak",
    "open_camera",
    "open_cameras",
    "orbbec",
    "realsense",
    "record3d",
    "ros2",
]
