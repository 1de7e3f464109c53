"""The registry of named detectors."""

from __future__ import annotations

from collections.abc import Callable

from cuboid.ground.core.registry import Registry
from cuboid.method.detection.types import Detector

# A factory takes the OPTIONS of NAME:OPTIONS, or None without a colon.
DetectorFactory = Callable[[str | None], Detector]

DETECTORS: Registry[DetectorFactory] = Registry("detector", "cuboid.detectors")
