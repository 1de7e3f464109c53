"""Moving readings of an image: they lie where a frame of the last half second saw free space."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.tolerances import BIAS_M, DRIFT_M, DRIFT_RAD, JUMP_M
from cuboid.ground.core.working import WorkingImage
from cuboid.ground.geometry.se3 import inverse
from cuboid.method.heatmap.kernels.motion import grow
from cuboid.method.heatmap.pose_errors import true_motion
from cuboid.method.poses import alignment
from cuboid.method.poses.kernels.free_space import mark_freed
from cuboid.method.poses.moving import large_groups
from cuboid.method.poses.pyramid import Level, levels_of

# A surface that has rested for the first time is still, seconds: a thing that is set down is found within a second, and
# a hand seldom stops for longer. Frames are stored at the second interval, seconds.
REST_S, STORED_EVERY_S = 0.5, 0.1
# Step between the examined pixels, in both directions; a smaller group of adjacent ones may be noise.
STEP, MIN_GROUP = 2, 40
# Two poses within half a second err by this fraction of the motion between them, at most by twice the drift of a map.
POSE_ERROR, MAX_POSE_ERROR_M = 0.2, 2.0 * DRIFT_M
# A camera stands still if it moved by less than this, metres and radians.
STANDS_M, STANDS_RAD = 0.1 * DRIFT_M, 0.1 * DRIFT_RAD
# Pixels within this distance of a moving pixel, on the same surface, move too.
GROWN_PX = 2


@dataclass(frozen=True)
class _View:
    """A frame: its image, its pose, and the data that other frames are compared with."""

    image: WorkingImage
    T_world_camera: Float64Array

    @cached_property
    def depth_m(self) -> Float32Array:
        """Every other reading in both directions."""
        return np.ascontiguousarray(self.image.depth_m[::STEP, ::STEP])

    @cached_property
    def pinhole(self) -> Float64Array:
        """Of `depth_m`: fx, fy, cx, cy."""
        return self.image.camera.pinhole / STEP

    @cached_property
    def levels(self) -> tuple[Level, ...]:
        """Image pyramid that is aligned to other frames."""
        return levels_of(self.image)

    @cached_property
    def points(self) -> alignment.Reference:
        """Points to which other frames are aligned."""
        return alignment.pick(self.levels)


@dataclass
class _Reference:
    """An earlier frame: the nearest reading around each examined pixel, within the error of noise and of poses."""

    time_s: float
    view: _View
    near_m: Float32Array
    nearest_m: Float32Array
    T_camera_world: Float64Array


class Motion:
    """Finds the moving readings in the frames of a camera with known poses.

    A reading moves if a frame of the last `REST_S` saw free space at its place. A surface that has rested since then
    is still; so is a surface that none of these frames could see. If poses jump or drift, still readings lie in free
    space too. In that case another motion of the whole image explains most of them, and the earlier frame gets the pose
    that follows from this motion.

    Parameters
    ----------
    noise_per_m : float
        Standard deviation of depth is this times z squared.
    """

    def __init__(self, noise_per_m: float) -> None:
        self._noise_per_m = noise_per_m
        self._references: deque[_Reference] = deque(maxlen=int(REST_S / STORED_EVERY_S))
        # T_world_camera of the last frame.
        self._T_last: Float64Array = np.eye(4)

    def forget(self) -> None:
        """Drop all earlier frames, because poses were corrected or time has passed."""
        self._references.clear()

    def find(self, image: WorkingImage, T_world_camera: Float64Array, time_s: float) -> UInt8Array | None:
        """Return which readings (h, w) of the next frame move, as 1; None if none does."""
        while self._references and not 0.0 <= time_s - self._references[0].time_s <= REST_S + STORED_EVERY_S:
            self._references.popleft()
        view = _View(image, T_world_camera)
        moving = self._moving(view) if self._references else None
        self._T_last = T_world_camera
        if not self._references or time_s - self._references[-1].time_s >= STORED_EVERY_S:
            self._references.append(_reference(view, time_s))
        if moving is None:
            return None
        height, width = image.depth_m.shape
        return np.ascontiguousarray(moving.repeat(STEP, 0).repeat(STEP, 1)[:height, :width])

    def _moving(self, view: _View) -> UInt8Array | None:
        freed = self._freed(view, list(self._references))
        if self._mend_poses(view, freed):
            freed = self._freed(view, list(self._references))
        moving = large_groups(freed, MIN_GROUP)
        if not moving.any():
            return None
        for _ in range(GROWN_PX):
            before = moving.copy()
            grow(view.depth_m, before, BIAS_M, self._noise_per_m, moving)
        return moving

    def _freed(self, view: _View, references: Sequence[_Reference]) -> UInt8Array:
        """Return which readings (h, w) lie where earlier frames saw free space: bit k stands for the k-th frame."""
        T = np.array([reference.T_camera_world @ view.T_world_camera for reference in references])
        shift_m, turn_rad = _size(T)
        stands = (shift_m < STANDS_M) & (turn_rad < STANDS_RAD)
        near_m = np.array(
            [
                reference.near_m if still else reference.nearest_m
                for reference, still in zip(references, stands, strict=True)
            ]
        )
        freed, cameras = (
            np.empty(view.depth_m.shape, np.uint8),
            np.array([reference.view.pinhole for reference in references]),
        )
        mark_freed(view.depth_m, view.pinhole, near_m, cameras, T, _error_m(T), self._noise_per_m, freed)
        return freed

    def _mend_poses(self, view: _View, freed: UInt8Array) -> bool:
        """Correct the poses of earlier frames that do not fit that of a frame; return whether any was corrected."""
        references, mended, certain = list(self._references), False, np.zeros(freed.shape, np.uint8)
        for k in reversed(range(len(references))):
            marked = np.asarray((freed >> k) & 1, np.uint8)
            # Readings that move according to later frames need no other explanation.
            if not large_groups(marked & ~certain, MIN_GROUP).any():
                continue
            moved = self._moved(view, references[k])
            if moved is not None:
                # All frames before it were shifted as much, or more.
                for reference in references[: k + 1]:
                    reference.T_camera_world = reference.T_camera_world @ inverse(moved)
                freed, mended = self._freed(view, references), True
            elif mended:
                # The poses of these frames are not known anymore.
                self._references = deque(references[k + 1 :], self._references.maxlen)
                break
            marked = np.asarray((freed >> k) & 1, np.uint8)
            certain |= np.asarray(cv2.dilate(marked, np.ones((2 * GROWN_PX + 1,) * 2, np.uint8)), np.uint8)
        return mended

    def _moved(self, view: _View, earlier: _Reference) -> Float64Array | None:
        """Return T_new_old of the world of an earlier frame whose pose is wrong; None if it is right."""
        T_claimed, T_last = (inverse(earlier.T_camera_world @ T) for T in (view.T_world_camera, self._T_last))
        # The camera has hardly moved since the last frame, even if its poses differ.
        T = true_motion(earlier.view.points, view.levels, T_claimed, T_last, self._noise_per_m)
        return None if T is None else view.T_world_camera @ T @ earlier.T_camera_world


def _size(T: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return the shift, metres, and the turn, radians, of motions (..., 4, 4)."""
    cosine = (np.trace(T[..., :3, :3], axis1=-2, axis2=-1) - 1.0) / 2.0
    return np.linalg.norm(T[..., :3, 3], axis=-1), np.arccos(np.clip(cosine, -1.0, 1.0))


def _error_m(T: Float64Array) -> Float64Array:
    """Return the error, metres, of poses with these motions (K, 4, 4) between them."""
    # A turn of one radian shifts a surface at one metre by one metre.
    return np.asarray(JUMP_M + np.minimum(POSE_ERROR * sum(_size(T)), MAX_POSE_ERROR_M))


def _reference(view: _View, time_s: float) -> _Reference:
    wide = 1 + int(np.ceil(DRIFT_RAD * view.image.camera.fx))
    near_m, nearest_m = (_nearest_around(view.image.depth_m, reach) for reach in (STEP + 1, wide))
    return _Reference(time_s, view, near_m, nearest_m, inverse(view.T_world_camera))


def _nearest_around(depth_m: Float32Array, reach: int) -> Float32Array:
    """Return the nearest reading around every other pixel; 0 if a reading around it is missing."""
    window = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    return np.ascontiguousarray(cv2.erode(depth_m, window)[::STEP, ::STEP], dtype=np.float32)


def groups_of(marked: UInt8Array) -> list[npt.NDArray[np.bool_]]:
    """Return the groups (h, w) of adjacent marked pixels that are not too small for a moving thing."""
    min_pixels = MIN_GROUP * STEP**2
    if np.count_nonzero(marked) < min_pixels:
        return []
    _, group, table, _ = cv2.connectedComponentsWithStats(marked, connectivity=8)
    large = np.flatnonzero(table[1:, cv2.CC_STAT_AREA] >= min_pixels) + 1
    return [group == k for k in large]
