"""A frame of an RGB-D camera, and the pinhole model of the camera."""

from __future__ import annotations

import math
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass
from numbers import Real

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.display import png_of
from cuboid.ground.core.errors import FrameError, InputError, shown
from cuboid.ground.core.values import LATEST_S
from cuboid.ground.geometry.se3 import rigid


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

    Raises
    ------
    InputError
        If a value is not a number, not finite or out of its range.
    """

    width: int
    height: int

    def __post_init__(self) -> None:
        values = (self.fx, self.fy, self.cx, self.cy)
        if not _finite(*values) or self.fx <= 0 or self.fy <= 0:
            raise InputError(f"intrinsics need finite values and fx, fy > 0, got fx, fy, cx, cy = {values}")
        size = (self.width, self.height)
        if not _finite(*size) or min(size) < 1 or any(side != int(side) for side in size):
            raise InputError(f"intrinsics need a positive image size in whole pixels, got {size[0]} x {size[1]}")
        for name in ("fx", "fy", "cx", "cy"):  # kernels are compiled for 64-bit floats, also if NumPy's are given
            object.__setattr__(self, name, float(getattr(self, name)))
        for name in ("width", "height"):
            object.__setattr__(self, name, int(getattr(self, name)))

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
class RigCamera:
    """A camera of a rig: frames of several cameras carry the one that took them.

    Attributes
    ----------
    name : str
        Name in the rig.
    intrinsics : Intrinsics
        Intrinsics of its frames.
    """

    name: str
    intrinsics: Intrinsics

    def downscaled(self, factor: int) -> RigCamera:
        """Return the camera whose pixels are blocks of `factor` x `factor` pixels of this one."""
        return RigCamera(self.name, self.intrinsics.downscaled(factor))


@dataclass(frozen=True, slots=True)
class Rig:
    """Several cameras with one map.

    Attributes
    ----------
    kind : {"fixed", "moving"}
    cameras : tuple of RigCamera
    T_rig_camera : mapping of str to (4, 4) float64
        Pose of each camera in the rig, by name; empty if the frames of each camera have poses in one world.
    """

    kind: str
    cameras: tuple[RigCamera, ...]
    T_rig_camera: Mapping[str, Float64Array]


@dataclass(frozen=True, slots=True)
class Frame:
    """One color image with its aligned depth image and its camera pose, if known.

    Attributes
    ----------
    index : int
        Number of the frame in its recording, a whole number from 0; skipped frames keep their numbers.
    timestamp_s : float
        Time in seconds.
    color : (H, W, 3) uint8
        RGB.
    depth_m : (H, W) float32
        Depth along the optical axis in metres; 0 is no reading. NaN, infinite, negative and masked values become 0.
        An image in which more readings are negative than positive is refused, unless one negative value, such as -1,
        stands for no reading.
    T_world_camera : (4, 4) float64 or None
        Transform from camera coordinates (x right, y down, z forward) to world coordinates. Rounding errors of the
        rotation are removed.
    up_camera : (3,) float64 or None
        Unit vector up (opposite to gravity) in camera coordinates; None if it was not measured.
    camera : RigCamera or None
        The camera that took it; None if all frames are of one camera.

    Raises
    ------
    FrameError
        If the index is no whole number from 0, if an image has another shape or type or no pixel, if most depth
        readings are negative, if the time is not a finite number of seconds, if the pose is not rigid or not finite, or
        if up is zero or not finite.
    """

    index: int
    timestamp_s: float
    color: UInt8Array
    depth_m: Float32Array
    T_world_camera: Float64Array | None = None
    up_camera: Float64Array | None = None
    camera: RigCamera | None = None

    def __repr__(self) -> str:
        height, width = self.depth_m.shape
        posed = "no pose" if self.T_world_camera is None else "posed"
        return f"Frame({self.index} at {self.timestamp_s:.3f} s: {width} x {height}, {posed})"

    def _repr_png_(self) -> bytes:
        """Show color and depth side by side, in a notebook."""
        return png_of(self)

    @property
    def camera_name(self) -> str:
        """Name of its camera in the rig; empty if all frames are of one camera."""
        return "" if self.camera is None else self.camera.name

    def intrinsics_or(self, intrinsics: Intrinsics) -> Intrinsics:
        """Return the intrinsics of its camera in the rig; without a rig, these."""
        return intrinsics if self.camera is None else self.camera.intrinsics

    @property
    def has_depth(self) -> bool:
        """Whether any pixel has a reading."""
        return bool(self.depth_m.any())

    def at(self, T_world_camera: Float64Array) -> Frame:
        """Return the same frame with another pose (4, 4)."""
        placed = copy(self)  # its images have been checked
        placed._set_pose(T_world_camera)
        return placed

    def repeats(self, last: Frame | None) -> bool:
        """Return whether color, depth and pose are exactly those of another frame: it is no new evidence."""
        if last is None:
            return False
        T, T_last = self.T_world_camera, last.T_world_camera
        same_pose = T is T_last or (T is not None and T_last is not None and np.array_equal(T, T_last))
        pairs = (self.depth_m, last.depth_m), (self.color, last.color)
        # Noise makes nearly all frames differ in a few rows already.
        return (
            same_pose
            and all(np.array_equal(a[::64], b[::64]) for a, b in pairs)
            and all(np.array_equal(a, b) for a, b in pairs)
        )

    def __post_init__(self) -> None:
        object.__setattr__(self, "index", whole_index(self.index))
        color, depth_m = self.color, self.depth_m
        if not isinstance(color, np.ndarray) or color.ndim != 3 or color.shape[2] != 3 or color.dtype != np.uint8:
            raise FrameError(f"frame {self.index}: color must be (H, W, 3) uint8, got {_form(color)}")
        if not isinstance(depth_m, np.ndarray) or depth_m.shape != color.shape[:2] or depth_m.dtype != np.float32:
            raise FrameError(
                f"frame {self.index}: depth must be {color.shape[:2]} float32 in metres like the color image, "
                f"got {_form(depth_m)}"
            )
        if not depth_m.size:
            raise FrameError(f"frame {self.index}: images must have pixels, got {_form(color)}")
        object.__setattr__(self, "depth_m", _with_zeros(depth_m, self.index))
        if not _finite(self.timestamp_s) or abs(self.timestamp_s) > LATEST_S:
            raise FrameError(f"frame {self.index}: expected a time in seconds, got {shown(self.timestamp_s)}")
        if self.T_world_camera is not None:
            self._set_pose(self.T_world_camera)
        if self.up_camera is not None:
            try:
                object.__setattr__(self, "up_camera", unit(self.up_camera))
            except FrameError as error:
                raise FrameError(f"frame {self.index}: up is {error}") from None

    def _set_pose(self, T_world_camera: Float64Array) -> None:
        try:
            object.__setattr__(self, "T_world_camera", rigid(T_world_camera))
        except ValueError as error:
            raise FrameError(f"frame {self.index}: {error}") from None


@dataclass(frozen=True, slots=True)
class SkippedFrame:
    """A frame that cannot be used: damaged, without a pose, or taken while the camera was lost.

    Attributes
    ----------
    index : int
        Number of the frame in its recording, a whole number from 0.
    reason : str
        One line, with the name of the file where there is one.

    Raises
    ------
    FrameError
        If the index is no whole number from 0.
    """

    index: int
    reason: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "index", whole_index(self.index))

    @property
    def sightings(self) -> tuple[()]:
        """An empty tuple: loops over all frames can read the sightings of a skipped frame too."""
        return ()


def whole_index(index: object) -> int:
    """Return the number of a frame; raises FrameError if it is not a whole number from 0."""
    if isinstance(index, bool) or not isinstance(index, int | np.integer) or index < 0:
        raise FrameError(f"a frame's index must be a whole number from 0, got {shown(index)}")
    return int(index)


def _finite(*values: object) -> bool:
    """Tell whether all values are finite real numbers, of Python or of NumPy."""
    try:
        return all(isinstance(value, Real) and math.isfinite(value) for value in values)
    except OverflowError:  # a whole number beyond the floats
        return False


def _form(image: object) -> str:
    """Return shape and type of an array, for messages; of any other value its type."""
    return f"{image.shape} {image.dtype}" if isinstance(image, np.ndarray) else type(image).__name__


def _with_zeros(depth_m: Float32Array, index: int) -> Float32Array:
    """Return depth with 0 in place of NaN, infinite, negative and masked values; the array itself if it has none.

    Raises
    ------
    FrameError
        More readings are negative than positive. Pixels with the most negative value may be pixels without a reading.
    """
    if isinstance(depth_m, np.ma.MaskedArray):
        depth_m = depth_m.filled(0)
    if depth_m.min() >= 0 and depth_m.max() < np.inf:  # both are False if there is a NaN
        return depth_m
    positive, finite = depth_m > 0, np.isfinite(depth_m)
    negative = depth_m[finite & (depth_m < 0)]
    if negative.size and np.count_nonzero(negative > negative.min()) > np.count_nonzero(positive & finite):
        raise FrameError(
            f"frame {index}: {negative.size} depth readings are negative (median {np.median(negative):.3g}); expected "
            "metres in front of the camera, and 0 for no reading: change the sign of the depth"
        )
    return np.where(positive & finite, depth_m, np.float32(0))


def unit(vector: npt.ArrayLike) -> Float64Array:
    """Return a direction (3,) as a unit vector; raises FrameError if it is zero, not finite or of another shape."""
    direction = np.asarray(vector, np.float64)
    length = float(np.linalg.norm(direction)) if direction.shape == (3,) else 0.0
    if not np.isfinite(length) or length == 0:
        raise FrameError(f"no direction: {shown(direction.tolist())}")
    return direction / length
