"""A made picture: a box of two colors before a wall."""

from __future__ import annotations

import numpy as np


def picture(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A red box 12 cm before a gray wall at 1 m, half of it blue, with noise; and a hole in depth."""
    random = np.random.default_rng(seed)
    color, depth_m = np.full((48, 64, 3), 120.0), np.ones((48, 64))
    color[10:34, 16:44] = (200.0, 40.0, 40.0)
    color[10:34, 30:44] = (40.0, 40.0, 200.0)
    depth_m[10:34, 16:44] = 0.88
    color += random.normal(0.0, 3.0, color.shape)
    depth_m += random.normal(0.0, 0.001, depth_m.shape)
    depth_m[2:6, 50:56] = 0.0
    return np.clip(color, 0.0, 255.0).astype(np.uint8), depth_m.astype(np.float32)


def enlarged(image: np.ndarray, factor: int) -> np.ndarray:
    return np.ascontiguousarray(image.repeat(factor, 0).repeat(factor, 1))
