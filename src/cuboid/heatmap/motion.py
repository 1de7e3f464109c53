"""What moves in a picture: readings that lie where the frames of the last two seconds saw free space."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from cuboid.core.frame import Float32Array, Float64Array, UInt8Array
from cuboid.core.tolerances import BIAS_M, DRIFT_M, DRIFT_RAD, JUMP_M
from cuboid.core.working import WorkingImage
from cuboid.geometry.se3 import inverse
from cuboid.heatmap.kernels.motion import grow, mark_freed

# What has rested for this long is still, seconds; frames are remembered at this interval.
REST_S, EVERY_S = 2.0, 0.4
# Every other working pixel is examined, in both directions; fewer of them side by side may be noise.
STEP, MIN_GROUP = 2, 40
# Poses of frames of two seconds err by this part of the motion between them, as far as by twice what a map's do.
POSE_ERROR, MAX_POSE_ERROR_M = 0.2, 2.0 * DRIFT_M
# A camera that has moved by less stands, metres and radians.
STANDS_M, STANDS_RAD = 0.1 * DRIFT_M, 0.1 * DRIFT_RAD
# Pixels that are so near to one that moves, and on the same surface, move with it.
GROWN_PX = 2


@dataclass(frozen=True, slots=True)
class _Reference:
    """An earlier frame: the nearest reading around each examined pixel, as near as noise and as poses may err."""

    time_s: float
    near_m: Float32Array
    nearest_m: Float32Array
    pinhole: Float64Array
    T_camera_world: Float64Array


class Motion:
    """Finds what moves in the frames of a camera whose pose is known.

    A reading moves when a frame of the last two seconds saw free space in its place. What has rested since is still,
    whatever it is; so is what no such frame could see.

    Parameters
    ----------
    noise_per_m : float
        Standard deviation of depth is this times z squared.
    """

    def __init__(self, noise_per_m: float) -> None:
        self._noise_per_m = noise_per_m
        self._references: deque[_Reference] = deque(maxlen=int(REST_S / EVERY_S))

    def forget(self) -> None:
        """Know of no earlier frames: poses were corrected, or time has passed."""
        self._references.clear()

    def find(self, image: WorkingImage, T_world_camera: Float64Array, time_s: float) -> UInt8Array | None:
        """Return which readings (h, w) of the next frame move, as 1; None where none does."""
        while self._references and not 0.0 <= time_s - self._references[0].time_s <= REST_S + EVERY_S:
            self._references.popleft()
        depth_m, pinhole = np.ascontiguousarray(image.depth_m[::STEP, ::STEP]), image.camera.pinhole / STEP
        moving = self._moving(depth_m, pinhole, T_world_camera) if self._references else None
        if not self._references or time_s - self._references[-1].time_s >= EVERY_S:
            self._references.append(_reference(image, pinhole, T_world_camera, time_s))
        if moving is None:
            return None
        height, width = image.depth_m.shape
        return np.ascontiguousarray(moving.repeat(STEP, 0).repeat(STEP, 1)[:height, :width])

    def _moving(self, depth_m: Float32Array, pinhole: Float64Array, T_world_camera: Float64Array) -> UInt8Array | None:
        known = self._references
        T = np.array([one.T_camera_world @ T_world_camera for one in known])
        shift_m = np.linalg.norm(T[:, :3, 3], axis=1)
        turn_rad = np.arccos(np.clip((np.trace(T[:, :3, :3], axis1=1, axis2=2) - 1.0) / 2.0, -1.0, 1.0))
        stands = (shift_m < STANDS_M) & (turn_rad < STANDS_RAD)
        near_m = np.array([one.near_m if still else one.nearest_m for one, still in zip(known, stands, strict=True)])
        # A turn shifts what is a metre away by as many metres as it has radians.
        error_m = JUMP_M + np.minimum(POSE_ERROR * (shift_m + turn_rad), MAX_POSE_ERROR_M)
        freed = np.empty(depth_m.shape, np.uint8)
        cameras = np.array([one.pinhole for one in known])
        mark_freed(depth_m, pinhole, near_m, cameras, T, error_m, self._noise_per_m, freed)
        moving = _without_small(np.minimum(freed, 1, out=freed))
        if moving is not None:
            for _ in range(GROWN_PX):
                before = moving.copy()
                grow(depth_m, before, BIAS_M, self._noise_per_m, moving)
        return moving


def _reference(image: WorkingImage, pinhole: Float64Array, T_world_camera: Float64Array, time_s: float) -> _Reference:
    wide = 1 + int(np.ceil(DRIFT_RAD * image.camera.fx))
    near_m, nearest_m = (_nearest_around(image.depth_m, reach) for reach in (STEP + 1, wide))
    return _Reference(time_s, near_m, nearest_m, pinhole, inverse(T_world_camera))


def _nearest_around(depth_m: Float32Array, reach: int) -> Float32Array:
    """Return the nearest reading around every other pixel; 0 where one is missing."""
    around = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    return np.ascontiguousarray(cv2.erode(depth_m, around)[::STEP, ::STEP], dtype=np.float32)


def _without_small(marked: UInt8Array) -> UInt8Array | None:
    """Return marks (h, w) without groups that may be noise; None where nothing is left."""
    groups = groups_of(marked, MIN_GROUP)
    return np.any(groups, axis=0).astype(np.uint8) if groups else None


def groups_of(marked: UInt8Array, least: int = MIN_GROUP * STEP**2) -> list[npt.NDArray[np.bool_]]:
    """Return the groups (h, w) of at least so many marked pixels side by side."""
    if np.count_nonzero(marked) < least:
        return []
    _, group, table, _ = cv2.connectedComponentsWithStats(marked, connectivity=8)
    large = np.flatnonzero(table[1:, cv2.CC_STAT_AREA] >= least) + 1
    return [group == k for k in large]
