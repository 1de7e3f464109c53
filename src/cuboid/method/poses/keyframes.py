"""Keyframes: images with distinct views to which later images are aligned."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.state import TRANSIENT, Record
from cuboid.ground.geometry import se3
from cuboid.method.poses.alignment import Reference, pick
from cuboid.method.poses.kernels import align as kernel
from cuboid.method.poses.moving import FreeSpace, free_space
from cuboid.method.poses.places import Appearance
from cuboid.method.poses.pyramid import Level, SmallImage

# Overlap is measured with the points of this level, one in OVERLAP_EVERY.
OVERLAP_LEVEL, OVERLAP_EVERY = 2, 4
# A frame becomes a keyframe if its view differs by this from those of all keyframes, radians: it still overlaps them
# well.
NEW_VIEW = 0.17
# Points nearer than this to the camera, metres, are not projected.
NEAREST_POINT_M = 0.1
# A point is visible if the reading at its pixel is nearer by at most this fraction of its depth.
SIGHT_FRACTION = 0.05
# Views whose directions differ by more than 60 degrees (cosine) have little in common.
MIN_VIEW_COSINE = 0.5


@dataclass(slots=True)
class Keyframe(Record):
    """A frame to which other frames are aligned.

    Values of attributes are replaced, never changed in place.

    Attributes
    ----------
    number : int
        Number from 0, in order of time.
    frame : int
        Frame of the recording.
    T_world_camera : (4, 4) float64
        Current, corrected pose.
    small : SmallImage
    depth_m : float
        Median depth of its points.
    appearance : Appearance
    submap : int
        Submap of the keyframe: all keyframes of a submap share one world; 0 is the submap of the first frame.
    given : bool
        Whether its pose came with the recording, and is never corrected.
    """

    number: int
    frame: int
    T_world_camera: Float64Array
    small: SmallImage
    depth_m: float
    appearance: Appearance
    submap: int
    given: bool = False
    _reference: Reference | None = field(default=None, metadata=TRANSIENT)
    _free_space: FreeSpace | None = field(default=None, metadata=TRANSIENT)

    @property
    def reference(self) -> Reference:
        """Its points, in its camera frame."""
        if self._reference is None:
            self._reference = pick(self.small.levels())
        return self._reference

    @property
    def free_space(self) -> FreeSpace:
        """The free space that it shows, in its camera frame."""
        if self._free_space is None:
            self._free_space = free_space(self.small.levels())
        return self._free_space


def median_depth_m(reference: Reference) -> float:
    """Return the median depth of an image's points; 1 m if there are none."""
    z = reference.levels[OVERLAP_LEVEL].points[:, 2]
    return float(np.median(z)) if len(z) else 1.0


def overlap(reference: Reference, T_world_keyframe: Float64Array, T_world_camera: Float64Array, level: Level) -> float:
    """Return the fraction of a keyframe's points that an image from a pose would show, 0..1.

    Parameters
    ----------
    reference : Reference
        The keyframe's points.
    T_world_keyframe, T_world_camera : (4, 4) float64
    level : Level
        A level of the image, of any size.
    """
    T = se3.inverse(T_world_camera) @ T_world_keyframe
    if T[2, 2] < MIN_VIEW_COSINE:
        return 0.0
    coarse = reference.levels[OVERLAP_LEVEL]
    if len(coarse.points) == 0:
        return 0.0
    points = coarse.points[::OVERLAP_EVERY] @ T[:3, :3].T + T[:3, 3]
    normals = coarse.normals[::OVERLAP_EVERY] @ T[:3, :3].T
    seen, u, v = pixels_of(points, level)
    facing = (normals[seen] * points[seen]).sum(1) < 0
    reading, z = level.image[v, u, kernel.DEPTH][facing], points[seen, 2][facing]
    hidden = (reading > 0) & (reading < z * (1 - SIGHT_FRACTION))
    return float(np.count_nonzero(~hidden) / len(points))


def pixels_of(
    points: npt.NDArray[np.floating], level: Level
) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return which points (N, 3) of the camera frame lie inside an image, and the column and row of each of these."""
    fx, fy, cx, cy = level.camera.pinhole
    height, width = level.image.shape[:2]
    z = np.maximum(points[:, 2], NEAREST_POINT_M)
    u, v = np.rint(points[:, 0] / z * fx + cx), np.rint(points[:, 1] / z * fy + cy)
    seen = (points[:, 2] > NEAREST_POINT_M) & (u >= 0) & (u < width) & (v >= 0) & (v < height)
    return seen, u[seen].astype(np.int64), v[seen].astype(np.int64)


def view_distances(
    T_world_camera: Float64Array, T_world_keyframes: Float64Array, depth_m: Float64Array
) -> Float64Array:
    """Return the distance of a view to others, as an angle that combines rotation and translation over depth.

    Parameters
    ----------
    T_world_camera : (4, 4) float64
    T_world_keyframes : (N, 4, 4) float64
    depth_m : (N,) float64
        Median depth of each keyframe.

    Returns
    -------
    (N,) float64
        Radians.
    """
    displacement = np.linalg.norm(T_world_keyframes[:, :3, 3] - T_world_camera[:3, 3], axis=1)
    trace = np.einsum("nij,ij->n", T_world_keyframes[:, :3, :3], T_world_camera[:3, :3])
    turn = np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0))
    return np.asarray(np.hypot(turn, displacement / depth_m))
