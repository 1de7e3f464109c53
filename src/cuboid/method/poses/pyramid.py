"""Image pyramid of a frame: the small images by which its pose is estimated, coarse to fine."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, UInt8Array
from cuboid.ground.core.depth import SAME_SURFACE
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.kernels.blocks import halve_depth
from cuboid.ground.core.working import WorkingImage
from cuboid.method.poses.kernels import align as kernel

# Approximate width of the finest level, pixels: at 320 a frame of 640 pixels costs a quarter of the time, and each
# intensity and depth is the average of four readings.
FINEST_WIDTH = 320
# Each level has half the width of the one before; at the coarsest one a fast turn moves the image by a pixel or two.
PYRAMID_LEVELS = 4
# Unit of the depth of stored keyframes, metres: finer than the step of any sensor; 16 bits reach 13 m.
KEPT_UNIT_M = 0.0002


@dataclass(frozen=True, slots=True)
class Level:
    """One size of an image.

    Attributes
    ----------
    image : (h, w, 4) float32
        Packed: intensity 0..255, its derivative along u and v per pixel, depth in metres (0 none).
    camera : Intrinsics
        Of this size.
    """

    image: Float32Array
    camera: Intrinsics


@dataclass(frozen=True, slots=True)
class SmallImage:
    """A stored keyframe: its finest level, compact.

    Attributes
    ----------
    gray : (h, w) uint8
    depth : (h, w) uint16
        In units of `KEPT_UNIT_M`.
    camera : Intrinsics
        Of this image.
    """

    gray: UInt8Array
    depth: npt.NDArray[np.uint16]
    camera: Intrinsics

    def levels(self) -> tuple[Level, ...]:
        """Return the image in all sizes, finest first."""
        return build_levels(self.gray, self.depth * np.float32(KEPT_UNIT_M), self.camera)


def halvings(width: int) -> int:
    """Return how often an image of a width is halved to reach the finest level."""
    return max(0, round(math.log2(width / FINEST_WIDTH)))


def shrink(frame: Frame, intrinsics: Intrinsics) -> tuple[UInt8Array, Float32Array, Intrinsics]:
    """Return gray (h, w) uint8, depth (h, w) float32 in metres, and pinhole of a frame's finest level."""
    import cv2

    levels = halvings(intrinsics.width)
    camera = intrinsics.downscaled(1 << levels)
    height, width = camera.height << levels, camera.width << levels
    gray = cv2.cvtColor(frame.color[:height, :width], cv2.COLOR_RGB2GRAY)
    if levels:
        gray = cv2.resize(gray, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
    depth_m = frame.depth_m[:height, :width]
    for _ in range(levels):
        depth_m = _halved(depth_m)
    return np.asarray(gray, np.uint8), np.ascontiguousarray(depth_m), camera


def build_levels(gray: UInt8Array, depth_m: Float32Array, camera: Intrinsics) -> tuple[Level, ...]:
    """Return an image, gray (H, W) and depth (H, W) in metres, in all sizes, finest first."""
    import cv2

    levels = []
    for k in range(PYRAMID_LEVELS):
        if k:
            camera = camera.downscaled(2)
            cut = gray[: 2 * camera.height, : 2 * camera.width]
            gray = np.asarray(cv2.resize(cut, (camera.width, camera.height), interpolation=cv2.INTER_AREA), np.uint8)
            depth_m = _halved(depth_m)
        image = np.empty((*gray.shape, 4), np.float32)
        kernel.pack(gray, depth_m, image)
        levels.append(Level(image, camera))
    return tuple(levels)


def levels_of(image: WorkingImage) -> tuple[Level, ...]:
    """Return the image that the tracker works on in all sizes, finest first."""
    import cv2

    gray = np.asarray(cv2.cvtColor(image.color, cv2.COLOR_RGB2GRAY), np.uint8)
    return build_levels(gray, np.ascontiguousarray(image.depth_m), image.camera)


def keep(gray: UInt8Array, depth_m: Float32Array, camera: Intrinsics) -> SmallImage:
    """Return the compact image of a keyframe, of gray (H, W) and depth (H, W) in metres, for storage."""
    units = np.clip(np.rint(depth_m / KEPT_UNIT_M), 0, 65535)
    return SmallImage(gray, units.astype(np.uint16), camera)


def _halved(depth_m: Float32Array) -> Float32Array:
    half = np.empty((depth_m.shape[0] // 2, depth_m.shape[1] // 2), np.float32)
    halve_depth(depth_m, SAME_SURFACE, half)
    return half
