"""Cuboid: objects that stay found.

Persistent object labels and 3D boxes from an RGB-D video, online, on one CPU core.
"""

from __future__ import annotations

from cuboid.errors import CuboidError
from cuboid.frame import Frame, Intrinsics
from cuboid.geometry.box import Box

__version__ = "0.1.0"

__all__ = ["Box", "CuboidError", "Frame", "Intrinsics", "__version__"]
