"""A run in progress, in the browser: the growing map, the objects, the camera and its picture."""

from __future__ import annotations

from cuboid.results.views.live.server import LiveServer
from cuboid.results.views.live.watch import LiveView

__all__ = ["LiveServer", "LiveView"]
