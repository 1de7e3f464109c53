"""Conversion of ROS's CameraInfo to a pinhole and lens distortion."""

from __future__ import annotations

from typing import Any

import numpy as np

from cuboid.ground.core.errors import InputError


def camera_of(info: Any, rectified: bool, topic: str) -> tuple[tuple[float, float, float, float], tuple[float, ...]]:
    """Return fx, fy, cx, cy and the distortion of a CameraInfo; raise InputError if it has no camera."""
    K, P, D = (
        np.asarray(getattr(info, name, getattr(info, name.lower(), ())), np.float64).reshape(-1).tolist()
        for name in "KPD"
    )
    if rectified and len(P) == 12 and P[0] > 0:
        K, D = [P[0], P[1], P[2], P[4], P[5], P[6], *K[6:]], []
    numbers = (K[0], K[4], K[2], K[5]) if len(K) >= 9 else (0.0, 0.0, 0.0, 0.0)
    if not np.isfinite([*numbers, *D]).all() or min(numbers[:2]) <= 0:
        raise InputError(f"the CameraInfo of {topic} holds no camera: K is {K}")
    if not any(D):
        return numbers, ()
    model = info.distortion_model.lower()
    if model in ("equidistant", "fisheye", "kannala_brandt4") or len(D) < 4:
        raise InputError(f"the CameraInfo of {topic} has distortion of the kind '{model}'; only plumb_bob is known")
    return numbers, tuple(D[:8] if len(D) >= 8 else D[:5])
