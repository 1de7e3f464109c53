"""Cuboid: objects that stay found.

Persistent object labels and 3D boxes from an RGB-D video, online, on one CPU core.

>>> import cuboid
>>> recording = cuboid.open_recording("my-recording")  # doctest: +SKIP
>>> tracker = cuboid.Tracker(recording.intrinsics)  # doctest: +SKIP
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from cuboid.errors import CuboidError

if TYPE_CHECKING:
    from cuboid.cameras import open_camera
    from cuboid.config import TrackerConfig
    from cuboid.frame import Frame, Intrinsics, SkippedFrame
    from cuboid.geometry.box import Box
    from cuboid.proposals.types import Proposals
    from cuboid.readers import Recording, open_recording
    from cuboid.results import FrameResult, TrackedObject
    from cuboid.run import track_recording
    from cuboid.scene import Scene
    from cuboid.tracking import Tracker

__version__ = "0.1.0"

# Where each public name is found. They are imported when they are first used: `cuboid --help` answers at
# once, and `--threads` can size the pools of libraries, which read their limits when they are imported.
_PLACES = {
    "Box": "cuboid.geometry.box",
    "Frame": "cuboid.frame",
    "FrameResult": "cuboid.results",
    "Intrinsics": "cuboid.frame",
    "Proposals": "cuboid.proposals.types",
    "Recording": "cuboid.readers",
    "Scene": "cuboid.scene",
    "SkippedFrame": "cuboid.frame",
    "TrackedObject": "cuboid.results",
    "Tracker": "cuboid.tracking",
    "TrackerConfig": "cuboid.config",
    "open_camera": "cuboid.cameras",
    "open_recording": "cuboid.readers",
    "track_recording": "cuboid.run",
}

__all__ = [
    "Box",
    "CuboidError",
    "Frame",
    "FrameResult",
    "Intrinsics",
    "Proposals",
    "Recording",
    "Scene",
    "SkippedFrame",
    "TrackedObject",
    "Tracker",
    "TrackerConfig",
    "__version__",
    "open_camera",
    "open_recording",
    "track_recording",
]


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'cuboid' has no attribute '{name}'")
    value = globals()[name] = getattr(import_module(_PLACES[name]), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_PLACES})
