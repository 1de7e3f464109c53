"""Live cameras: a driver a file, each imported when its camera is asked for.

Other packages add theirs (entry points ``cuboid.cameras``).
"""

from __future__ import annotations

from cuboid.cameras import oak, orbbec, realsense, record3d, ros2
from cuboid.cameras.driver import CAMERAS, Driver, Shot, StreamEndedError
from cuboid.cameras.live import LiveCamera, open_camera

__all__ = [
    "CAMERAS",
    "Driver",
    "LiveCamera",
    "Shot",
    "StreamEndedError",
    "oak",
    "open_camera",
    "orbbec",
    "realsense",
    "record3d",
    "ros2",
]
