"""A small synthetic recording, which uses all kernels of tracking."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.frame import Frame, Intrinsics

CAMERA = Intrinsics(260.0, 260.0, 159.5, 119.5, 320, 240)
MADE_FRAMES = 20
# The camera moves along an arc around the middle of the table, at this distance and height, metres.
DISTANCE_M, HEIGHT_M = 0.9, 0.7
ARC_RAD = 1.2
# Boxes by low and high corners, metres: table top, floor, three on the table, one that floats above it.
BOXES = np.array(
    [
        [-0.6, -0.4, -0.05, 0.6, 0.4, 0.0],
        [-3.0, -3.0, -0.8, 3.0, 3.0, -0.75],
        [-0.3, -0.1, 0.0, -0.18, 0.06, 0.14],
        [0.15, 0.05, 0.0, 0.27, 0.2, 0.08],
        [0.1, -0.25, 0.0, 0.18, -0.17, 0.2],
        [-0.5, -0.3, 0.12, -0.38, -0.16, 0.2],
    ]
)
# An upright cylinder: position (x, y), radius and height, metres.
CAN = 0.0, 0.12, 0.05, 0.12
# Colors of the boxes and the can: red, green, blue.
COLORS = np.array(
    [[1, 0.9, 0.7], [0.5, 0.5, 0.5], [1, 0.3, 0.2], [0.2, 0.8, 0.4], [0.3, 0.4, 1], [0.7, 0.2, 0.9], [0.9, 0.8, 0.1]]
)


class WarmUpRecording:
    """A table with boxes and a can; the frames, along an arc, are rendered when they are first read.

    Parameters
    ----------
    poses : bool
        Whether the recording has camera poses.
    noise : float
        Standard deviation of depth, as a fraction of the depth.
    """

    path = Path("warm-up")
    format = "made"
    intrinsics = CAMERA
    distortion: tuple[float, ...] = ()
    depth_units_per_metre = 1000.0
    depth_camera = None
    warnings: tuple[str, ...] = ()

    def __init__(self, *, poses: bool = True, noise: float = 0.0) -> None:
        self.has_poses = poses
        self._noise = noise

    def __len__(self) -> int:
        return MADE_FRAMES

    def read(self, index: int) -> Frame:
        """Return a frame."""
        T_world_camera = _pose(index)
        color, depth_m = _rendered(index)
        spread = np.random.default_rng(index).normal(1.0, self._noise, depth_m.shape)
        depth_m = (depth_m * spread).astype(np.float32)
        return Frame(index, index / 30.0, color, depth_m, T_world_camera if self.has_poses else None)

    def pose(self, index: int) -> Float64Array | None:
        """Return a frame's pose."""
        return _pose(index) if self.has_poses else None

    def without_poses(self) -> WarmUpRecording:
        """Return the same recording without its poses."""
        return WarmUpRecording(poses=False, noise=self._noise)


def _pose(index: int) -> Float64Array:
    """Return the pose of a camera that looks at the middle of the table and moves along the arc and back."""
    angle = ARC_RAD * (1.0 - abs(2.0 * index / (MADE_FRAMES - 1) - 1.0)) - np.pi / 2
    eye = np.array([DISTANCE_M * np.cos(angle), DISTANCE_M * np.sin(angle), HEIGHT_M])
    ahead = -eye / np.linalg.norm(eye)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    T_world_camera = np.eye(4)
    T_world_camera[:3, :3] = np.column_stack((right, np.cross(ahead, right), ahead))
    T_world_camera[:3, 3] = eye
    return T_world_camera


@cache
def _rendered(index: int) -> tuple[UInt8Array, Float32Array]:
    """Return color (H, W, 3) and depth (H, W), metres, of a frame without noise."""
    T_world_camera = _pose(index)
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    rays = CAMERA.points(u, v, np.ones(u.shape))
    ways, eye = rays @ T_world_camera[:3, :3].T, T_world_camera[:3, 3]
    hits = np.stack([*(_box_depth(box, eye, ways) for box in BOXES), _can_depth(eye, ways)])
    nearest, depth_m = hits.argmin(axis=0), hits.min(axis=0)
    seen = np.isfinite(depth_m)
    depth_m = np.where(seen, depth_m, 0.0)
    points = eye + ways * depth_m[..., None]
    waves = np.sin(points * (37.0, 41.0, 43.0)).sum(axis=-1) + np.sin(points * (91.0, 83.0, 97.0)).sum(axis=-1)
    tone = 128.0 + 18.0 * waves
    color = tone[..., None] * COLORS[nearest] * seen[..., None]
    return np.clip(color, 0, 255).astype(np.uint8), depth_m.astype(np.float32)


def _box_depth(box: Float64Array, eye: Float64Array, ways: Float64Array) -> Float64Array:
    """Return the depth (H, W) at which rays hit a box, infinite if they miss it."""
    sides = (box.reshape(2, 3) - eye)[..., None, None]
    with np.errstate(divide="ignore"):
        ends = sides / np.ascontiguousarray(np.moveaxis(ways, -1, 0))
    near, far = ends.min(axis=0).max(axis=0), ends.max(axis=0).min(axis=0)
    return np.where((near <= far) & (near > 0), near, np.inf)


def _can_depth(eye: Float64Array, ways: Float64Array) -> Float64Array:
    """Return the depth (H, W) at which rays hit the can, infinite if they miss it."""
    x, y, radius, height = CAN
    across, start = ways[..., :2], eye[:2] - (x, y)
    a, b, c = (across**2).sum(axis=-1), across @ start, start @ start - radius**2
    inside = b**2 - a * c
    side = (-b - np.sqrt(np.maximum(inside, 0.0))) / a
    top = (height - eye[2]) / ways[..., 2]
    on_side = (inside > 0) & (eye[2] + side * ways[..., 2] >= 0) & (eye[2] + side * ways[..., 2] <= height)
    on_top = (((start + top[..., None] * across) ** 2).sum(axis=-1) <= radius**2) & (top > 0)
    return np.minimum(np.where(on_side, side, np.inf), np.where(on_top, top, np.inf))
