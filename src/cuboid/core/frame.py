"""A frame of an RGB-D camera, and the pinhole model of the camera."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from cuboid.core.errors import FrameError, shown
from cuboid.geometry.se3 import rigid

Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]
UInt8Array = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Pinhole:
    """The pinhole model: where a point of the camera frame is in the image.

    Attributes
    ----------
    fx, fy : float
        Focal lengths in pixels.
    cx, cy : float
        Principal point in pixels; the centre of the top-left pixel is (0, 0).
    """

    fx: float
    fy: float
    cx: float
    cy: float

    def points(self, u: npt.ArrayLike, v: npt.ArrayLike, depth_m: npt.ArrayLike) -> Float64Array:
        """Return the points (..., 3) of readings in the camera frame, metres; columns, rows and depths are (...) each.

        With depth 1 these are the rays of the pixels.
        """
        u, v, z = (np.asarray(values, np.float64) for values in (u, v, depth_m))
        return np.stack([(u - self.cx) / self.fx * z, (v - self.cy) / self.fy * z, z], axis=-1)

    def pixels(self, points: npt.NDArray[np.floating]) -> Float64Array:
        """Return the columns and rows (..., 2) of points (..., 3) in front of the camera, not rounded."""
        return points[..., :2] / points[..., 2:] * (self.fx, self.fy) + (self.cx, self.cy)


@dataclass(frozen=True, slots=True)
class Intrinsics(Pinhole):
    """A pinhole camera without lens distortion.

    Attributes
    ----------
    fx, fy : float
        Focal lengths in pixels.
    cx, cy : float
        Principal point in pixels; the centre of the top-left pixel is (0, 0).
    width, height : int
        Image size in pixels.
    """

    width: int
    height: int

    def __post_init__(self) -> None:
        values = (self.fx, self.fy, self.cx, self.cy)
        if not all(np.isfinite(values)) or self.fx <= 0 or self.fy <= 0:
            raise ValueError(f"intrinsics need finite values and fx, fy > 0, got fx, fy, cx, cy = {values}")
        if self.width < 1 or self.height < 1:
            raise ValueError(f"intrinsics need a positive image size, got {self.width} x {self.height}")

    @property
    def pinhole(self) -> Float64Array:
        """The focal lengths fx, fy and the principal point cx, cy, (4,)."""
        return np.array([self.fx, self.fy, self.cx, self.cy])

    def downscaled(self, factor: int) -> Intrinsics:
        """Return the pinhole of the image whose pixels are blocks of `factor` x `factor` pixels of this one."""
        shift = (factor - 1) / 2.0
        return Intrinsics(
            fx=self.fx / factor,
            fy=self.fy / factor,
            cx=(self.cx - shift) / factor,
            cy=(self.cy - shift) / factor,
            width=self.width // factor,
            height=self.height // factor,
        )


@dataclass(frozen=True, slots=True)
class Frame:
    """One color image with its aligned depth image and its camera pose, if known.

    Attributes
    ----------
    index : int
        Number of the frame in its recording, from 0; skipped frames keep their numbers.
    timestamp_s : float
        Time in seconds.
    color : (H, W, 3) uint8
        RGB.
    depth_m : (H, W) float32
        Depth along the optical axis in metres; 0 is no reading.
    T_world_camera : (4, 4) float64 or None
        Transform from camera coordinates (x right, y down, z forward) to world coordinates. Rounding errors of the
        rotation are removed.
    up_camera : (3,) float64 or None
        Unit vector up (opposite to gravity) in camera coordinates; None if it was not measured.

    Raises
    ------
    FrameError
        If the pose is not rigid or not finite, or if up is zero or not finite.
    """

    index: int
    timestamp_s: float
    color: UInt8Array
    depth_m: Float32Array
    T_world_camera: Float64Array | None = None
    up_camera: Float64Array | None = None

    def __repr__(self) -> str:
        height, width = self.depth_m.shape
        posed = "no pose" if self.T_world_camera is None else "posed"
        return f"Frame({self.index} at {self.timestamp_s:.3f} s: {width} x {height}, {posed})"

    def _repr_png_(self) -> bytes:
        """Show color and depth side by side, in a notebook."""
        from cuboid.core.display import png_of

        return png_of("frame_png", self)

    def at(self, T_world_camera: Float64Array) -> Frame:
        """Return the same frame with another pose."""
        return replace(self, T_world_camera=T_world_camera)

    def __post_init__(self) -> None:
        if self.color.ndim != 3 or self.color.shape[2] != 3 or self.color.dtype != np.uint8:
            raise ValueError(
                f"frame {self.index}: color must be (H, W, 3) uint8, got {self.color.shape} {self.color.dtype}"
            )
        if self.depth_m.shape != self.color.shape[:2] or self.depth_m.dtype != np.float32:
            raise ValueError(
                f"frame {self.index}: depth must be {self.color.shape[:2]} float32 like the color image, "
                f"got {self.depth_m.shape} {self.depth_m.dtype}"
            )
        if self.T_world_camera is not None:
            try:
                object.__setattr__(self, "T_world_camera", rigid(self.T_world_camera))
            except ValueError as error:
                raise FrameError(f"frame {self.index}: {error}") from None
        if self.up_camera is not None:
            try:
                object.__setattr__(self, "up_camera", unit(self.up_camera))
            except FrameError as error:
                raise FrameError(f"frame {self.index}: up is {error}") from None


@dataclass(frozen=True, slots=True)
class SkippedFrame:
    """A frame that cannot be used: damaged, without a pose, or taken while the camera was lost.

    Attributes
    ----------
    index : int
        Number of the frame in its recording, from 0.
    reason : str
        One line, with the name of the file where there is one.
    """

    index: int
    reason: str

    @property
    def sightings(self) -> tuple[()]:
        """An empty tuple: loops over all frames can read the sightings of a skipped frame too."""
        return ()


def unit(vector: npt.ArrayLike) -> Float64Array:
    """Return a direction (3,) as a unit vector; raises FrameError if it is zero, not finite or of another shape."""
    direction = np.asarray(vector, np.float64)
    length = float(np.linalg.norm(direction)) if direction.shape == (3,) else 0.0
    if not np.isfinite(length) or length == 0:
        raise FrameError(f"no direction: {shown(direction.tolist())}")
    return direction / length
