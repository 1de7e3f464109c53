"""Frames of a textured room corner with boxes, cast ray by ray: exact truth for tests of camera poses."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.geometry.box import Box
from made_scenes import cast, look_at, upright

CAMERA = Intrinsics(265.0, 265.0, 159.5, 119.5, 320, 240)
SCENE = [
    upright((0.0, 0.0), (6.0, 6.0, 0.1), z=-0.1),
    upright((0.0, 2.2), (6.0, 0.1, 2.5)),
    upright((2.4, 0.0), (0.1, 6.0, 2.5)),
    upright((0.0, 0.3), (0.25, 0.35, 0.5), 0.4),
    upright((-0.6, 0.5), (0.4, 0.3, 0.3), -0.3),
    upright((0.5, -0.2), (0.3, 0.3, 0.2), 0.8),
    upright((0.9, 0.7), (0.4, 0.4, 0.8), 0.2),
]


def camera_path(frames: int, angle_deg: float = 60.0, radius_m: float = 1.8) -> list[np.ndarray]:
    """T_world_camera along an arc around the boxes."""
    turn = np.radians(np.linspace(-120.0, -120.0 + angle_deg, frames))
    return [look_at((radius_m * np.cos(a), radius_m * np.sin(a), 1.1), (0.1, 0.3, 0.25)) for a in turn]


def texture(points: np.ndarray, hit: np.ndarray) -> np.ndarray:
    """Grey values of points (..., 3) on boxes: a smooth pattern of waves, another one for each box."""
    value = np.full(hit.shape, 110.0)
    for box in range(int(hit.max()) + 1):
        rng = np.random.default_rng(box)
        mine = hit == box
        for frequency in (7.0, 15.0, 31.0, 60.0):
            direction = rng.normal(size=3)
            direction *= frequency / np.linalg.norm(direction)
            value[mine] += 20.0 * np.sin(points[mine] @ direction + rng.uniform(0, 6.3))
        value[mine] += rng.uniform(-40, 40)
    return value


@lru_cache(512)
def _scene_picture(pose: bytes, index: int, noise: bool) -> Frame:
    return _picture(np.frombuffer(pose).reshape(4, 4), index, noise, SCENE)


def picture(T_world_camera: np.ndarray, index: int, noise: bool = True, boxes: list[Box] = SCENE) -> Frame:
    """A frame with the noise of a structured-light sensor; of `SCENE` the same frame for the same call."""
    if boxes is SCENE:
        return _scene_picture(np.asarray(T_world_camera, float).tobytes(), index, noise)
    return _picture(T_world_camera, index, noise, boxes)


def _picture(T_world_camera: np.ndarray, index: int, noise: bool, boxes: list[Box]) -> Frame:
    depth, hit = cast(boxes, T_world_camera, CAMERA)
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    world = CAMERA.points(u, v, depth) @ T_world_camera[:3, :3].T + T_world_camera[:3, 3]
    gray = texture(world, hit)
    rng = np.random.default_rng(1000 + index)
    if noise:
        gray = gray + rng.normal(size=gray.shape) * 2.0
        depth = np.where(depth > 0, depth + rng.normal(size=depth.shape) * 1.4e-3 * depth**2, 0.0)
    color = np.clip(np.rint(gray), 0, 255).astype(np.uint8)
    return Frame(index, index / 30.0, np.repeat(color[..., None], 3, 2), depth.astype(np.float32))


def black(index: int) -> Frame:
    """A frame of a covered lens."""
    size = (CAMERA.height, CAMERA.width)
    return Frame(index, index / 30.0, np.zeros((*size, 3), np.uint8), np.zeros(size, np.float32))


def ate_m(estimated: list[np.ndarray], true: list[np.ndarray]) -> float:
    """RMSE of the places after the rigid motion that fits them best (Umeyama, without scale)."""
    a, b = (np.array([T[:3, 3] for T in poses]) for poses in (estimated, true))
    left, _, right = np.linalg.svd((b - b.mean(0)).T @ (a - a.mean(0)))
    R = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    away = (a - a.mean(0)) @ R.T - (b - b.mean(0))
    return float(np.sqrt((away**2).sum(1).mean()))
