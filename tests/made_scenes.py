"""Frames of small scenes of boxes, cast ray by ray: exact truth for tests of the tracker."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numba
import numpy as np

from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.geometry.box import Box
from cuboid.inputs.recordings.converting import PlainWriter

CAMERA = Intrinsics(270.0, 270.0, 159.5, 119.5, 320, 240)
# Where no box is, and by the number of the box.
COLORS = ((np.arange(-1, 255)[:, None] * np.array([53, 97, 31]) + 90) % 256).astype(np.uint8)


def upright(center_xy: tuple[float, float], size: tuple[float, float, float], turn: float = 0.0, z: float = 0.0) -> Box:
    """A box that stands at height z, third axis along +z."""
    c, s = np.cos(turn), np.sin(turn)
    return Box(
        np.array([*center_xy, z + size[2] / 2]),
        np.array(size, float),
        np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]),
    )


def look_at(eye: Sequence[float], target: Sequence[float]) -> np.ndarray:
    """T_world_camera of an upright camera at `eye`; the world's z is up."""
    forward = np.subtract(target, eye).astype(float)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    T = np.eye(4)
    T[:3, :3] = np.column_stack([right, np.cross(forward, right), forward])
    T[:3, 3] = eye
    return T


def cast(
    boxes: Sequence[Box], T_world_camera: np.ndarray, camera: Intrinsics = CAMERA
) -> tuple[np.ndarray, np.ndarray]:
    """Depth (H, W) in metres and the number of the box hit (H, W), -1 none; by the slab method."""
    rays = _rays(camera)
    depth, hit = np.full(rays.shape[:2], np.inf), np.full(rays.shape[:2], -1)
    for k, box in enumerate(boxes):
        origin = box.rotation.T @ (T_world_camera[:3, 3] - box.center)
        R_box_camera = box.rotation.T @ T_world_camera[:3, :3]
        _hit_box(rays, R_box_camera, -box.size / 2 - origin, box.size / 2 - origin, k, depth, hit)
    return np.where(np.isfinite(depth), depth, 0.0), hit


@lru_cache
def _rays(camera: Intrinsics) -> np.ndarray:
    """Points (H, W, 3) of the pixels at depth 1, in the camera's frame."""
    v, u = np.mgrid[: camera.height, : camera.width]
    return camera.points(u, v, np.ones(u.shape))


@numba.njit(cache=True, error_model="numpy")
def _hit_box(rays, R_box_camera, low, high, k, depth, hit):  # type: ignore[no-untyped-def]
    """Write depth and number of a box where it is nearer; corners (3,) are in its own axes, rays (H, W, 3) not."""
    for r in range(rays.shape[0]):
        for c in range(rays.shape[1]):
            near, far = -np.inf, np.inf
            for axis in range(3):
                along = 0.0
                for i in range(3):
                    along += R_box_camera[axis, i] * rays[r, c, i]
                inverse = 1.0 / along
                a, b = low[axis] * inverse, high[axis] * inverse
                if np.isnan(a) or np.isnan(b):  # along a side: no hit
                    near, far = np.inf, -np.inf
                near, far = max(near, min(a, b)), min(far, max(a, b))
            if 0 < near < far and near < depth[r, c]:
                depth[r, c], hit[r, c] = near, k


def frame_of(
    boxes: Sequence[Box],
    T_world_camera: np.ndarray,
    index: int,
    noise_per_m: float = 1.0e-3,
    T_shown: np.ndarray | None = None,
) -> Frame:
    """A noisy frame; `T_shown` is the pose that the frame claims, where that is not the true one."""
    depth, hit = cast(boxes, T_world_camera)
    rng = np.random.default_rng(index)
    noisy = depth + rng.normal(size=depth.shape) * noise_per_m * depth**2
    color = COLORS[hit + 1]
    shown = T_world_camera if T_shown is None else T_shown
    return Frame(index, index / 30, color, np.where(depth > 0, noisy, 0).astype(np.float32), shown)


def write_plain(
    path: Path, camera: Intrinsics, frames: Iterable[Frame], units_per_metre: float = 1000, *, posed: bool = True
) -> Path:
    """Write frames as a recording in the plain layout."""
    path.mkdir(parents=True, exist_ok=True)
    writer = PlainWriter(path, camera, units_per_metre)
    for frame in frames:
        writer.add(frame if posed else replace(frame, T_world_camera=None))
    writer.finish()
    return path
