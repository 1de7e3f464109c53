"""A run as it goes, in the browser: the map as it grows, the objects, the camera and what it sees."""

from __future__ import annotations

from cuboid.views.live.server import LiveServer
from cuboid.views.live.watch import LiveView

__all__ = ["LiveServer", "LiveView"]
