"""Recordings of rigs with two cameras of different sizes around a few boxes, cast ray by ray."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cuboid.ground.core.frame import Frame, Intrinsics
from made_scenes import cast, look_at, upright, write_plain

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
    frames = []
    for k, (T, time_s) in enumerate(zip(poses, times_s, strict=True)):
        depth, hit = cast((TABLE, *THINGS), T, camera)
        rng = np.random.default_rng([camera.width, k])
        depth = np.where(depth > 0, depth + rng.normal(size=depth.shape) * 1e-3 * depth**2, 0.0)
        color = ((hit[..., None] * np.array([53, 97, 31]) + 90) % 256).astype(np.uint8)
        frames.append(Frame(k, time_s, color, depth.astype(np.float32), T))
    return write_plain(path, camera, frames, 5000, posed=posed)


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
