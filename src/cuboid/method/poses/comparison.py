"""Comparison of two poses of one image by the points of a keyframe that the image explains from each.

A pose that is nearer to the truth explains additional points all over the image and loses none. A pose that follows a
moving object gains the points on this object and loses points beside it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.tolerances import MIN_READINGS, SIGMAS
from cuboid.method.poses.alignment import NOISE, SIGMA_LOW, Alignment, Reference
from cuboid.method.poses.keyframes import pixels_of
from cuboid.method.poses.pyramid import Level

# Poses are compared at this level, 160 pixels wide: a reading there is the mean of several.
COMPARED_LEVEL = 1
# A reading farther than this from the surface of a point, metres, lies on another surface.
OTHER_SURFACE_M = 0.1
# A pose is better than another if it explains this additional fraction of the points: edges of objects have fewer.
MIN_GAIN = 0.03
# ... and loses at most this fraction of its gain. With exact poses and an object that moves in 30 to 60 % of the image
# an alignment loses .08 or more, with drifting poses .01 (.03 on the RealSense desk).
MAX_LOSS = 0.05


@dataclass(frozen=True, slots=True)
class Explained:
    """The points of a reference that an image from a pose explains, (N,) bool each.

    Attributes
    ----------
    read
        The point faces the camera, and the image has a reading at its pixel.
    near
        The reading is nearer than `OTHER_SURFACE_M` to the point's surface.
    on_surface
        The reading lies on the surface, within three standard deviations of depth noise.
    alike
        It lies on the surface, and the intensities agree within three standard deviations.
    """

    read: npt.NDArray[np.bool_]
    near: npt.NDArray[np.bool_]
    on_surface: npt.NDArray[np.bool_]
    alike: npt.NDArray[np.bool_]

    @property
    def fraction(self) -> float:
        """Fraction of the near readings that lie on the surface, 0..1."""
        near = np.count_nonzero(self.near)
        return float(np.count_nonzero(self.on_surface) / near) if near >= MIN_READINGS else 0.0

    @property
    def fraction_alike(self) -> float:
        """Fraction of all readings that agree in depth and intensity, 0..1."""
        read = np.count_nonzero(self.read)
        return float(np.count_nonzero(self.alike) / read) if read >= MIN_READINGS else 0.0


def explained(
    reference: Reference, level: Level, T_camera_reference: Float64Array, fit: Alignment | None = None
) -> Explained:
    """Return the points of a reference that an image from a pose explains.

    Parameters
    ----------
    reference : Reference
        Reference from one image.
    level : Level
        The image at `COMPARED_LEVEL`.
    T_camera_reference : (4, 4) float64
    fit : Alignment
        Alignment of the image to the reference: its exposure and the standard deviation of the intensities.
    """
    T, picked = T_camera_reference.astype(np.float32), reference.levels[COMPARED_LEVEL]
    points, normals = picked.points @ T[:3, :3].T + T[:3, 3], picked.normals @ T[:3, :3].T
    seen, u, v = pixels_of(points, level)
    points, normals, camera = points[seen], normals[seen], level.camera
    intensity, along_u, along_v, depth_m = level.image[v, u].T
    read = (depth_m > 0) & ((normals * points).sum(1) < 0)
    off_m = np.abs(((camera.points(u, v, depth_m) - points) * normals).sum(1))
    near = read & (off_m < OTHER_SURFACE_M)
    on_surface = near & (off_m < SIGMAS * (NOISE[0] + NOISE[1] * depth_m**2))
    alike = on_surface
    if fit is not None:
        to_u, to_v = camera.pixels(points).T - (u, v)
        (gain, bias), deviation = fit.shade[0], max(fit.sigma[0], SIGMA_LOW[0])
        different = gain * (intensity + along_u * to_u + along_v * to_v) + bias - picked.intensity[seen]
        alike = on_surface & (np.abs(different) < SIGMAS * deviation)
    return Explained(*(_of_all(part, seen) for part in (read, near, on_surface, alike)))


def clearly_better(first: Explained, second: Explained) -> bool:
    """Return whether a pose explains more points than another, and loses almost none."""
    both = int(np.count_nonzero(first.read & second.read))
    gained, lost = _gained(first, second), _gained(second, first)
    return bool(gained > MIN_GAIN * both and lost <= MAX_LOSS * gained)


def as_good(first: Explained, second: Explained) -> bool:
    """Return whether a pose explains at least as many points as another."""
    return _gained(first, second) >= _gained(second, first)


def _gained(first: Explained, second: Explained) -> int:
    """Return the number of points that only the first pose explains, among those with a reading from both poses."""
    return int(np.count_nonzero(first.read & second.read & first.alike & ~second.alike))


def _of_all(part: npt.NDArray[np.bool_], seen: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Expand flags of the points inside the image to all points."""
    flags = np.zeros(len(seen), np.bool_)
    flags[seen] = part
    return flags
