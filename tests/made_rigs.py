"""Recordings of rigs with two cameras of different sizes around a few boxes, cast ray by ray."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.geometry.se3 import quat_wxyz_from_rotation
from made_scenes import cast, look_at, upright

WIDE, SMALL = Intrinsics(270.0, 270.0, 159.5, 119.5, 320, 240), Intrinsics(200.0, 202.0, 118.0, 92.0, 240, 184)
TABLE = upright((0.0, 0.0), (1.6, 1.2, 0.05), z=-0.05)
THINGS = (
    upright((-0.25, 0.1), (0.14, 0.1, 0.12), 0.3),
    upright((0.2, 0.15), (0.1, 0.1, 0.2), 0.8),
    upright((0.05, -0.2), (0.18, 0.12, 0.08), 1.2),
)
EYES = ((1.0, -0.3, 0.8), (0.2, 1.0, 0.9))
POSES = tuple(look_at(eye, (0.0, 0.0, 0.05)) for eye in EYES)
NAMES = ("left", "right")


def write_camera(
    path: Path, camera: Intrinsics, poses: Sequence[np.ndarray], times_s: Sequence[float], *, posed: bool = False
) -> Path:
    """Write a recording in the plain layout: a frame at each pose and time."""
    for folder in ("color", "depth"):
        (path / folder).mkdir(parents=True)
    lines = []
    for k, T in enumerate(poses):
        depth, hit = cast((TABLE, *THINGS), T, camera)
        rng = np.random.default_rng([camera.width, k])
        depth = np.where(depth > 0, depth + rng.normal(size=depth.shape) * 1e-3 * depth**2, 0.0)
        color = ((hit[..., None] * np.array([53, 97, 31]) + 90) % 256).astype(np.uint8)
        cv2.imwrite(str(path / "color" / f"{k:06d}.png"), color[..., ::-1])
        cv2.imwrite(str(path / "depth" / f"{k:06d}.png"), np.round(depth * 5000).astype(np.uint16))
        w, x, y, z = quat_wxyz_from_rotation(T[:3, :3])
        lines.append(f"{k} " + " ".join(f"{value:.9f}" for value in (*T[:3, 3], x, y, z, w)))
    if posed:
        (path / "poses.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    times = "".join(f"{k} {time_s:.6f}\n" for k, time_s in enumerate(times_s))
    (path / "timestamps.txt").write_text(times, encoding="utf-8")
    pinhole = {name: getattr(camera, name) for name in ("fx", "fy", "cx", "cy", "width", "height")}
    (path / "camera.json").write_text(json.dumps({**pinhole, "depth_units_per_metre": 5000}), encoding="utf-8")
    return path


def rig_document(kind: str = "fixed", poses: Sequence[np.ndarray] | None = POSES) -> dict[str, object]:
    """The content of a rig.json with the recordings "left" and "right"."""
    cameras = [{"name": name, "recording": name} for name in NAMES]
    if poses is not None:
        cameras = [{**one, "T_rig_camera": T.tolist()} for one, T in zip(cameras, poses, strict=True)]  # type: ignore[dict-item]
    return {"format": "cuboid-rig", "version": 1, "kind": kind, "cameras": cameras}


def write_rig(path: Path, seconds: tuple[tuple[float, float], ...] = ((0.0, 0.5), (0.0, 0.5))) -> Path:
    """Write a fixed rig whose cameras run at 20 and 14 frames a second from the first to the second time of each."""
    for name, camera, T, (first_s, last_s), step_s in zip(
        NAMES, (WIDE, SMALL), POSES, seconds, (0.05, 0.07), strict=True
    ):
        times_s = np.arange(first_s, last_s, step_s).tolist()
        write_camera(path / name, camera, [T] * len(times_s), times_s)
    (path / "rig.json").write_text(json.dumps(rig_document()), encoding="utf-8")
    return path
