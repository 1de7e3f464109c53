"""The box of an object without depth, from the rectangles of a detector; see `without_depth`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.geometry.box import Box
from cuboid.method.objects.entry import ObjectWithoutDepth

# An object lies flat on a plane if its centre is at most this high above it, and then has this thickness, metres.
FLAT_ABOVE_M, THIN_M = 0.05, 0.02
# Cosine of the largest angle between the normal of a plane and up at which things stand on it.
UPRIGHT = 0.98
# Smallest sine of the angle from which a flat object is seen: at grazing angles its rectangle does not show its
# extent.
MIN_SINE = 0.2
# Shortest side, metres.
MIN_SIDE_M = 0.01
# Standard deviation of the sides of a detector's rectangle, as a fraction of them: small detectors' are off by a tenth.
SIDE = 0.1
# A rectangle does not show the rotation of an object about up: its width may be that of a side half as long. Standard
# deviation of a side that is uniformly distributed between the two, as a fraction of the width.
TURNED = 0.5 / 3**0.5
# A flat object is up to twice `FLAT_ABOVE_M` thick. Root mean square difference of `THIN_M` from a thickness that is
# uniformly distributed up to there.
THICKNESS_M = ((FLAT_ABOVE_M - THIN_M) ** 2 + (2.0 * FLAT_ABOVE_M) ** 2 / 12.0) ** 0.5
# The side away from the camera is a guess; its standard deviation is this fraction of it.
GUESSED = 0.5


@dataclass(frozen=True, slots=True)
class Planes:
    """Up direction and supporting planes, in the map.

    Attributes
    ----------
    up : (3,) float64
    supporting : sequence of ((3,) float64, float)
        Normal and offset of each plane: normal.p + offset = 0.
    """

    up: Float64Array
    supporting: Sequence[tuple[Float64Array, float]]


def box_of(entry: ObjectWithoutDepth, planes: Planes) -> tuple[Box, str]:
    """Return the box of an object and its kind: "flat" on a plane, otherwise a "box" that faces its viewers.

    Parameters
    ----------
    entry : ObjectWithoutDepth
    planes : Planes
    """
    if entry.seen_box is not None:
        return _on_plane(entry.seen_box, planes), "box"
    center, (width, height) = entry.center, np.maximum(entry.size_m, MIN_SIDE_M).tolist()
    toward = _toward(entry, planes)
    across = _across(toward, planes)
    rotation = np.column_stack([across, np.cross(planes.up, across), planes.up])
    above_m = [float(normal @ center + offset) for normal, offset in planes.supporting]
    if any(0.0 <= away <= FLAT_ABOVE_M for away in above_m):
        sine = max(float(toward @ planes.up), MIN_SINE)
        reach = max((height - THIN_M * (1.0 - sine)) / sine, MIN_SIDE_M)
        return Box(center, np.array([width, reach, THIN_M]), rotation), "flat"
    return Box(center, np.array([width, min(width, height), height]), rotation), "box"


def _on_plane(box: Box, planes: Planes) -> Box:
    """Return an upright box extended down to the plane just beneath it, if there is one: a foot is seldom seen."""
    below_m = [box.foot_m(normal, offset) for normal, offset in planes.supporting if normal @ planes.up > UPRIGHT]
    near_m = [away for away in below_m if 0.0 < away <= FLAT_ABOVE_M]
    if not near_m:
        return box
    foot_m = min(near_m)
    return Box(box.center - foot_m / 2.0 * planes.up, box.size + np.array([0.0, 0.0, foot_m]), box.rotation)


def size_sigma_of(entry: ObjectWithoutDepth, planes: Planes, kind: str) -> Float64Array:
    """Return the standard deviations (3,) of the sides of the box of an object, metres.

    Those of width and height follow from the scatter of the rectangles, from the error of a rectangle that all frames
    share, and from the uncertainty of the triangulated distance. Two quantities that a rectangle does not show are
    added: the rotation of the object, and its extent away from the camera.

    Parameters
    ----------
    entry : ObjectWithoutDepth
    planes : Planes
    kind : str
        The kind from `box_of`.
    """
    sides = np.maximum(entry.size_m, MIN_SIDE_M)
    width, height = sides.tolist()
    toward = _toward(entry, planes)
    covariance = np.linalg.inv(entry.information)
    along_m = float(np.sqrt(toward @ covariance @ toward))
    relative = np.hypot(SIDE, along_m / max(entry.distance_m, along_m))
    seen = np.sqrt(entry.size_scatter_m2 + (relative * sides) ** 2)
    wide = float(np.hypot(seen[0], TURNED * width))
    sine = max(float(toward @ planes.up), 0.0)
    cosine = float(np.sqrt(max(0.0, 1.0 - sine**2)))
    if kind == "flat":
        # Its thickness is twice the height of its middle above the plane.
        thick = float(np.hypot(THICKNESS_M, 2.0 * np.sqrt(planes.up @ covariance @ planes.up)))
        reach = np.array([seen[1], TURNED * height, thick * cosine]) / max(sine, MIN_SINE)
        return np.array([wide, float(np.linalg.norm(reach)), thick])
    cosine, deep = max(cosine, MIN_SINE), min(width, height)
    # The height of the rectangle is between that of an object without depth and that of one as deep as the box.
    shown = max(abs(height / cosine - height), abs(height - (height - deep * sine) / cosine)) / 3**0.5
    return np.array([wide, GUESSED * deep, float(np.hypot(seen[1], shown))])


def united(first: ObjectWithoutDepth, second: ObjectWithoutDepth, planes: Planes) -> tuple[Float64Array, Float64Array]:
    """Return vector (3,) and size (2,) of the rectangle that holds two objects, seen from the mean direction."""
    toward = _toward(first, planes) + _toward(second, planes)
    toward = toward / max(float(np.linalg.norm(toward)), 1e-9)
    across = _across(toward, planes)
    axes = np.array([across, np.cross(toward, across)])
    information = first.information + second.information
    center = np.linalg.solve(information, first.vector + second.vector)
    half_m = np.array([entry.size_m / 2.0 for entry in (first, second)])
    middle_m = np.array([axes @ entry.center for entry in (first, second)])
    low_m, high_m = (middle_m - half_m).min(axis=0), (middle_m + half_m).max(axis=0)
    center = center + ((low_m + high_m) / 2.0 - axes @ center) @ axes
    return information @ center, high_m - low_m


def _across(toward: Float64Array, planes: Planes) -> Float64Array:
    """Return the horizontal direction (3,) across a line of sight; any horizontal one for a line from above."""
    across = np.cross(planes.up, toward)
    if np.linalg.norm(across) < 1e-3:
        across = np.cross(planes.up, np.eye(3)[int(np.abs(planes.up).argmin())])
    return np.asarray(across / np.linalg.norm(across))


def _toward(entry: ObjectWithoutDepth, planes: Planes) -> Float64Array:
    """Return the mean direction (3,) from an object to the cameras that saw it; up if none is known."""
    toward = entry.views[:, :3].sum(axis=0) if len(entry.views) else planes.up
    return np.asarray(toward / max(float(np.linalg.norm(toward)), 1e-9))
