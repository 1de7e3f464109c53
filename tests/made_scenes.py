"""Frames of small scenes of boxes, cast ray by ray: exact truth for tests of the tracker."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.geometry.box import Box

CAMERA = Intrinsics(270.0, 270.0, 159.5, 119.5, 320, 240)


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
    v, u = np.mgrid[: camera.height, : camera.width]
    rays = camera.points(u, v, np.ones(u.shape))
    world = rays @ T_world_camera[:3, :3].T
    depth, hit = np.full(u.shape, np.inf), np.full(u.shape, -1)
    for k, box in enumerate(boxes):
        origin = box.rotation.T @ (T_world_camera[:3, 3] - box.center)
        with np.errstate(divide="ignore"):
            inverse = 1.0 / (world @ box.rotation)
        a, b = (-box.size / 2 - origin) * inverse, (box.size / 2 - origin) * inverse
        near = np.maximum.reduce(np.moveaxis(np.minimum(a, b), -1, 0))
        far = np.minimum.reduce(np.moveaxis(np.maximum(a, b), -1, 0))
        better = (near < far) & (near > 0) & (near < depth)
        depth[better], hit[better] = near[better], k
    return np.where(np.isfinite(depth), depth, 0.0), hit


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
    color = ((hit[..., None] * np.array([53, 97, 31]) + 90) % 256).astype(np.uint8)
    shown = T_world_camera if T_shown is None else T_shown
    return Frame(index, index / 30, color, np.where(depth > 0, noisy, 0).astype(np.float32), shown)
