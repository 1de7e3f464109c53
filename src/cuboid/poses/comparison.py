"""Two poses of one image compared: which of a keyframe's points the image explains from the one and from the other.

A pose that is nearer the truth explains points all over the image that the other does not, and loses none. A pose that
follows a thing that moves gains the points on this thing and loses points beside it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.core.frame import Float64Array
from cuboid.core.tolerances import MIN_READINGS, SIGMAS
from cuboid.poses.alignment import NOISE, SIGMA_LOW, Alignment, Reference
from cuboid.poses.keyframes import pixels_of
from cuboid.poses.pyramid import Level

# Poses are compared at this level, of 160 pixels: a reading there is the mean of several.
COMPARED_LEVEL = 1
# A reading that differs by more than this from a point, metres, lies on another surface.
OTHER_SURFACE_M = 0.1
# A pose is better than another where it explains this fraction more of the points: the edges of things have fewer.
MIN_GAIN = 0.03
# ... and loses at most this fraction of what it gains. With exact poses and a thing that moves in 30 to 60 % of the
# picture an alignment loses .08 or more, with poses that drift .01 (.03 on the RealSense desk).
MAX_LOSS = 0.05


@dataclass(frozen=True, slots=True)
class Explained:
    """Which points of a reference an image from a pose explains, (N,) bool each.

    Attributes
    ----------
    read
        The point faces the camera, and the image has a reading where it falls.
    near
        This reading is nearer to the point's surface than `OTHER_SURFACE_M`.
    on_surface
        It lies on the surface, within three deviations of the depth's noise.
    alike
        It does, and the intensities are alike within three deviations.
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


def explained(
    reference: Reference, level: Level, T_camera_reference: Float64Array, fit: Alignment | None = None
) -> Explained:
    """Return which points of a reference an image from a pose explains.

    Parameters
    ----------
    reference : Reference
        Of one image.
    level : Level
        The image in the size of `COMPARED_LEVEL`.
    T_camera_reference : (4, 4) float64
    fit : Alignment
        Of the image to the reference: its exposure and the deviation of the intensities.
    """
    T, picked = T_camera_reference.astype(np.float32), reference.levels[COMPARED_LEVEL]
    points, normals = picked.points @ T[:3, :3].T + T[:3, 3], picked.normals @ T[:3, :3].T
    seen, u, v = pixels_of(points, level)
    points, normals, (fx, fy, cx, cy) = points[seen], normals[seen], level.camera
    here, along_u, along_v, depth_m = level.image[v, u].T
    read = (depth_m > 0) & ((normals * points).sum(1) < 0)
    readings = np.column_stack([(u - cx) / fx * depth_m, (v - cy) / fy * depth_m, depth_m])
    off_m = np.abs(((readings - points) * normals).sum(1))
    near = read & (off_m < OTHER_SURFACE_M)
    on_surface = near & (off_m < SIGMAS * (NOISE[0] + NOISE[1] * depth_m**2))
    alike = on_surface
    if fit is not None:
        to_u, to_v = points[:, 0] / points[:, 2] * fx + cx - u, points[:, 1] / points[:, 2] * fy + cy - v
        (gain, bias), deviation = fit.shade[0], max(fit.sigma[0], SIGMA_LOW[0])
        different = gain * (here + along_u * to_u + along_v * to_v) + bias - picked.intensity[seen]
        alike = on_surface & (np.abs(different) < SIGMAS * deviation)
    return Explained(*(_of_all(part, seen) for part in (read, near, on_surface, alike)))


def clearly_better(one: Explained, other: Explained) -> bool:
    """Tell whether a pose explains more points than another, and loses next to none for them."""
    both = int(np.count_nonzero(one.read & other.read))
    gained, lost = _gained(one, other), _gained(other, one)
    return bool(gained > MIN_GAIN * both and lost <= MAX_LOSS * gained)


def as_good(one: Explained, other: Explained) -> bool:
    """Tell whether a pose explains at least as many points as another."""
    return _gained(one, other) >= _gained(other, one)


def _gained(one: Explained, other: Explained) -> int:
    """Return how many points a pose explains that another does not, of those that both place on a reading."""
    return int(np.count_nonzero(one.read & other.read & one.alike & ~other.alike))


def _of_all(part: npt.NDArray[np.bool_], seen: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Spread flags of the seen points over all points."""
    flags = np.zeros(len(seen), np.bool_)
    flags[seen] = part
    return flags
