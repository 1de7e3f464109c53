"""A recording of three parcels under a fixed camera, with exact sides: for `cuboid measure`."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np

from cuboid.lab.synthetic.recording import encode_color, encode_depth
from made_scenes import CAMERA, cast, look_at, upright

SIDES_M = ((0.2, 0.15, 0.1), (0.14, 0.08, 0.2), (0.12, 0.1, 0.06))
PLACES = ((-0.22, -0.06), (0.05, 0.1), (0.2, -0.1))
FRAMES, UNITS_PER_M = 24, 5000
COLORS = np.array([[120, 110, 100], [90, 90, 90], [200, 40, 40], [40, 160, 60], [50, 60, 190], [0, 0, 0]], np.uint8)


def write_parcels(folder: Path) -> None:
    """Write a plain recording without poses: 0.8 s, the noise of a first Kinect."""
    parcels = [upright(place, sides, 0.3) for place, sides in zip(PLACES, SIDES_M, strict=True)]
    table, floor = upright((0.0, 0.0), (1.6, 1.2, 0.05), z=-0.05), upright((0.0, 0.0), (6.0, 6.0, 0.05), z=-0.8)
    exact_m, surface = cast([table, floor, *parcels], look_at((0.0, 1e-3, 0.9), (0.0, 0.0, 0.0)))
    rng = np.random.default_rng(1)
    # a print of blobs: the estimation of poses needs texture
    blobs = cv2.resize(rng.integers(-40, 40, (60, 80)).astype(np.float32), exact_m.shape[::-1])[..., None]
    color = np.clip(COLORS[surface] + blobs, 0, 255).astype(np.uint8)
    for name in ("color", "depth"):
        (folder / name).mkdir(parents=True)
    for k in range(FRAMES):
        noise_m = 1.4e-3 * exact_m**2 * rng.standard_normal(exact_m.shape)
        depth_m = np.where(exact_m > 0, exact_m + noise_m, 0.0).astype(np.float32)
        (folder / "color" / f"{k:06d}.jpg").write_bytes(encode_color(color))
        (folder / "depth" / f"{k:06d}.png").write_bytes(encode_depth(depth_m))
    camera = {name: getattr(CAMERA, name) for name in ("fx", "fy", "cx", "cy", "width", "height")}
    (folder / "camera.json").write_text(json.dumps(camera | {"depth_units_per_metre": UNITS_PER_M}))
