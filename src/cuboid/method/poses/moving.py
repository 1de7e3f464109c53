"""Pixels that move while poses are estimated: their readings lie where keyframes saw free space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.tolerances import BIAS_M, DRIFT_M, DRIFT_RAD
from cuboid.ground.geometry import se3
from cuboid.method.poses.alignment import NOISE_PER_M
from cuboid.method.poses.kernels import align as kernel
from cuboid.method.poses.kernels.free_space import mark_freed, mark_unseen, spread
from cuboid.method.poses.pyramid import Level, SmallImage

# Moving pixels are searched at this level, 160 pixels wide: a reading there is the mean of several.
SEARCHED_LEVEL = 1
# Smaller groups of adjacent pixels of this level may be noise.
MIN_GROUP = 40
# Pixels this near to a moving one are left out too: its edge, and its shadow in the depth.
MOVING_MARGIN_PX = 3
# If a larger fraction of the readings seems to move, the pose is wrong instead.
MOST_MOVING = 0.6
# Largest number of keyframes with which an image is compared: the marks of a pixel have this many bits.
MAX_COMPARED = 8


@dataclass(frozen=True, slots=True)
class FreeSpace:
    """The free space that an image shows, at `SEARCHED_LEVEL`.

    Attributes
    ----------
    nearest_m : (h, w) float32
        Smallest depth around each pixel: space is free up to there; 0 where a reading is missing.
    farthest_m : (h, w) float32
        Largest depth around each pixel: space is hidden behind it; 0 where there is no reading.
    """

    nearest_m: Float32Array
    farthest_m: Float32Array


@dataclass(slots=True)
class LeftOut:
    """The moving pixels that were left out of poses.

    Attributes
    ----------
    frames : int
        Number of frames with such pixels.
    fraction : float
        Sum over these frames of the fraction of the image that was left out.
    """

    frames: int = 0
    fraction: float = 0.0

    def add(self, moving: UInt8Array) -> None:
        """Count the moving pixels (H, W) of a frame."""
        self.frames += 1
        self.fraction += float(np.count_nonzero(moving)) / moving.size

    def warnings(self) -> tuple[str, ...]:
        """Return a warning with the number of frames, if there are any."""
        if not self.frames:
            return ()
        percent = max(1, round(100.0 * self.fraction / self.frames))
        frames = "1 frame" if self.frames == 1 else f"{self.frames} frames"
        return (f"something moved in {frames}: {percent} % of their pixels were left out of the camera poses",)


def free_space(levels: Sequence[Level]) -> FreeSpace:
    """Return the free space that an image shows; around each pixel an error of `DRIFT_RAD` of the camera is allowed."""
    import cv2

    level = levels[SEARCHED_LEVEL]
    reach = 1 + int(np.ceil(DRIFT_RAD * level.camera.fx))
    window = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    depth_m = np.maximum(level.image[..., kernel.DEPTH], 0.0)
    return FreeSpace(np.asarray(cv2.erode(depth_m, window)), np.asarray(cv2.dilate(depth_m, window)))


def moving_pixels(
    levels: Sequence[Level], T_world_camera: Float64Array, keyframes: Sequence[tuple[FreeSpace, Float64Array]]
) -> UInt8Array | None:
    """Return which pixels (h, w) of an image move, as 1, at `SEARCHED_LEVEL`; None if none does.

    A pixel moves if its reading lies in free space, or if it continues the surface of such a pixel at a place that no
    keyframe shows.

    Parameters
    ----------
    levels : sequence of Level
    T_world_camera : (4, 4) float64
    keyframes : sequence of (FreeSpace, (4, 4) float64)
        Free space and T_world_camera of at most `MAX_COMPARED` keyframes.
    """
    import cv2

    if not keyframes:
        return None
    level = levels[SEARCHED_LEVEL]
    depth_m, pinhole = np.ascontiguousarray(level.image[..., kernel.DEPTH]), level.camera.pinhole
    T = np.array([se3.inverse(T_keyframe) @ T_world_camera for _, T_keyframe in keyframes])
    nearest_m, cameras = np.array([space.nearest_m for space, _ in keyframes]), np.tile(pinhole, (len(keyframes), 1))
    moving = np.empty(depth_m.shape, np.uint8)
    mark_freed(depth_m, pinhole, nearest_m, cameras, T, np.full(len(keyframes), DRIFT_M), NOISE_PER_M, moving)
    moving = large_groups(moving)
    if not moving.any():
        return None
    farthest_m, unseen = np.array([space.farthest_m for space, _ in keyframes]), np.empty_like(moving)
    mark_unseen(depth_m, pinhole, farthest_m, T, DRIFT_M, NOISE_PER_M, unseen)
    spread(depth_m, moving, unseen, BIAS_M, NOISE_PER_M)
    if np.count_nonzero(moving) > MOST_MOVING * np.count_nonzero(depth_m):
        return None
    return np.asarray(
        cv2.dilate(moving, np.ones((2 * MOVING_MARGIN_PX + 1, 2 * MOVING_MARGIN_PX + 1), np.uint8)), np.uint8
    )


def large_groups(marked: UInt8Array, min_pixels: int = MIN_GROUP) -> UInt8Array:
    """Return the marks (h, w) of groups of at least `min_pixels` adjacent pixels, as 1."""
    import cv2

    if np.count_nonzero(marked) < min_pixels:
        return np.zeros_like(marked)
    _, group, table, _ = cv2.connectedComponentsWithStats(np.minimum(marked, 1), connectivity=8)
    large = table[:, cv2.CC_STAT_AREA] >= min_pixels
    large[0] = False  # the background
    return np.asarray(large[group], np.uint8)


def levels_without(levels: Sequence[Level], moving: UInt8Array) -> tuple[Level, ...]:
    """Return an image whose moving pixels (H, W) have the depth -1: no alignment uses them."""
    still = []
    for k, level in enumerate(levels):
        image = level.image.copy()
        image[..., kernel.DEPTH][_at_level(moving, k, image.shape)] = -1.0
        still.append(Level(image, level.camera))
    return tuple(still)


def keyframe_without(small: SmallImage, moving: UInt8Array) -> SmallImage:
    """Return a keyframe's image without the readings of moving pixels (H, W)."""
    return replace(small, depth=np.where(_at_level(moving, 0, small.depth.shape), np.uint16(0), small.depth))


def _at_level(moving: UInt8Array, k: int, shape: tuple[int, ...]) -> npt.NDArray[np.bool_]:
    """Return the marks of moving pixels at a level of a shape (h, w, ...)."""
    step = 1 << abs(k - SEARCHED_LEVEL)
    resized = moving.repeat(step, 0).repeat(step, 1) if k < SEARCHED_LEVEL else moving[::step, ::step]
    marks = np.zeros(shape[:2], np.bool_)
    height, width = (min(pair) for pair in zip(shape, resized.shape, strict=False))
    marks[:height, :width] = resized[:height, :width] > 0
    return marks
