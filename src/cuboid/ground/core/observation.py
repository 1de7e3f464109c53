"""One posed frame, prepared once for all stages that use it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from cuboid.ground.arrays import Float64Array, UInt8Array
from cuboid.ground.core.working import WorkingImage, without
from cuboid.ground.geometry.se3 import inverse

# A frame has full weight as evidence after this time, seconds, or change of the viewing angle, radians: the noise of
# stereo depth, and the outlines that depend on it, hardly change in a shorter time from the same viewpoint.
NEW_TIME_S, NEW_SIDE_RAD = 1.0 / 3.0, 0.05


def weight_of(elapsed_s: float, angle_rad: float) -> float:
    """Return the weight of a frame as evidence, 0..1: the same for any frame rate, if all frames are summed.

    Parameters
    ----------
    elapsed_s : float
        Time since the previous frame; 0 if unknown or negative.
    angle_rad : float
        Change of the viewing angle since the previous frame: baseline over median depth.
    """
    return min(1.0, max(0.0, elapsed_s) / NEW_TIME_S + angle_rad / NEW_SIDE_RAD)


@dataclass(frozen=True, slots=True)
class Observation:
    """A frame as the heatmap and all later stages receive it.

    Attributes
    ----------
    frame : int
        Index of the frame.
    image : WorkingImage
        The subsampled frame, without mixed pixels.
    solid : WorkingImage
        The same image with its holes filled.
    T_world_camera : (4, 4) float64
    up_camera : (3,) float64 or None
        Measured up direction in camera coordinates; None if not measured.
    keyframe : int
        Keyframe to which the pose is anchored.
    new_viewpoint : bool
        Whether the camera has moved more than the pose error since the last frame from a new viewpoint.
    weight : float
        Weight of the frame as evidence, 0..1; see `weight_of`.
    moving : (h, w) uint8 or None
        1 where a reading lies on something that moves; None if nothing moves.
    camera : str
        Name of its camera in the rig; empty if all frames are of one camera.
    fixed : bool
        Whether the pose is exactly that of the last frame from a new viewpoint: the camera is fixed.
    still : WorkingImage
        The subsampled frame without moving readings.
    """

    frame: int
    image: WorkingImage
    solid: WorkingImage
    T_world_camera: Float64Array
    up_camera: Float64Array | None
    keyframe: int
    new_viewpoint: bool
    weight: float
    moving: UInt8Array | None = None
    camera: str = ""
    fixed: bool = False
    still: WorkingImage = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "still", without(self.image, self.moving))

    @property
    def T_camera_world(self) -> Float64Array:
        """Transform from world to camera coordinates, (4, 4)."""
        return inverse(self.T_world_camera)

    @property
    def eye(self) -> Float64Array:
        """Position of the camera in the world, metres, (3,)."""
        return np.asarray(self.T_world_camera[:3, 3])
