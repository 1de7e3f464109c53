"""The subsampled image that the tracker works on: each frame uses another pixel offset (phase)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.depth import DepthImage, without_mixed
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.kernels.blocks import take_one
from cuboid.ground.core.kernels.holes import fill_depth

# Offsets of the subsampled grid: at step 2, four frames together use every pixel.
_PHASES = ((0, 0), (1, 1), (1, 0), (0, 1))
# Largest distance over which holes are filled, metres; color difference that counts as one pixel, levels.
HOLE_M = 0.3
COLOR_LEVELS = 12.0


@dataclass(frozen=True, slots=True)
class WorkingImage:
    """Every step-th pixel of a frame.

    Attributes
    ----------
    depth_m : (h, w) float32
        Without mixed pixels.
    color : (h, w, 3) uint8
    camera : Intrinsics
        Intrinsics of this image.
    step : int
    phase : (int, int)
        x and y: pixel (v, u) here is pixel (y + step v, x + step u) of the frame.
    depth : DepthImage
        The depth with the cells that several stages use.
    """

    depth_m: Float32Array
    color: UInt8Array
    camera: Intrinsics
    step: int
    phase: tuple[int, int]
    depth: DepthImage = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "depth", DepthImage(self.depth_m, self.camera))

    def full_rectangles(self, corners: Float64Array | npt.NDArray[np.int64]) -> Float64Array:
        """Return rectangles (N, 4) in pixels of the full image, end exclusive, clipped to it.

        `corners` (N, 4) are the smallest and largest column and row of each in this image: left, top, right, bottom.
        """
        full = np.array([self.camera.width, self.camera.height] * 2) * self.step
        first, end = np.array([*self.phase, *self.phase]), np.array([0, 0, self.step, self.step])
        return np.asarray(np.clip(corners * self.step + first + end, 0, full), dtype=np.float64)


def step_of(intrinsics: Intrinsics, width_px: int) -> int:
    """Return the step of `WorkingImage` for at least `width_px` pixels on the longer side."""
    return max(1, max(intrinsics.width, intrinsics.height) // width_px)


def phase_of(step: int, count: int) -> tuple[int, int]:
    """Return the pixel offset (x, y) of the subsampled image of a frame with `count` earlier frames."""
    x, y = _PHASES[count % len(_PHASES)]
    return x * step // 2, y * step // 2


def thin(frame: Frame, intrinsics: Intrinsics, width_px: int, count: int) -> WorkingImage:
    """Subsample a frame to at least `width_px` pixels on its longer side; the frame counter `count` sets the phase."""
    step = step_of(intrinsics, width_px)
    x, y = phase_of(step, count)
    rows, columns = intrinsics.height // step, intrinsics.width // step
    depth = without_mixed(np.ascontiguousarray(frame.depth_m[y::step, x::step][:rows, :columns]))
    color = np.empty((rows, columns, 3), np.uint8)
    take_one(np.ascontiguousarray(frame.color), step, x, y, color)
    return WorkingImage(
        depth_m=depth,
        color=color,
        camera=Intrinsics(
            intrinsics.fx / step,
            intrinsics.fy / step,
            (intrinsics.cx - x) / step,
            (intrinsics.cy - y) / step,
            columns,
            rows,
        ),
        step=step,
        phase=(x, y),
    )


def filled(image: WorkingImage) -> WorkingImage:
    """Return an image whose holes get the depth of the reading nearest in position and color: an estimate."""
    depth = np.empty_like(image.depth_m)
    fill_depth(image.depth_m, image.color, COLOR_LEVELS, HOLE_M, image.camera.fx, depth)
    return replace(image, depth_m=depth)


def without(image: WorkingImage, left_out: UInt8Array | None) -> WorkingImage:
    """Return an image without the readings that are marked (h, w); the same image if `left_out` is None."""
    if left_out is None:
        return image
    return replace(image, depth_m=np.where(left_out, np.float32(0.0), image.depth_m))
