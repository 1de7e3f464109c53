"""What the tests of calibration have in common."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from cuboid.ground.core.frame import Frame, Intrinsics

Posed = Callable[..., list[Frame]]


def scaled(intrinsics: Intrinsics, factor: float) -> Intrinsics:
    """Return intrinsics with another focal length."""
    return replace(intrinsics, fx=intrinsics.fx * factor, fy=intrinsics.fy * factor)
