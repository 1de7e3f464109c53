"""Furniture that bears supporting planes, such as a table beneath its top or a shelf around its boards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array, UInt8Array
from cuboid.ground.core.results import MapPoints, SupportPlane
from cuboid.ground.core.tolerances import DRIFT_M
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.se3 import level_rotation
from cuboid.method.boxes.fit import fit_box
from cuboid.method.relations.kernels.links import number_parts
from cuboid.method.relations.walls import WALL_CELL_M, Numbers, cubes_of

# Sides and legs of furniture extend beyond the outline of its top by at most this, metres.
RIM_M = 0.06
# Largest gap between points of one piece of furniture, metres: poses drift, and there is one point per cell.
LINK_M = DRIFT_M + WALL_CELL_M
# Furniture was seen at least this far below the plane that it bears, metres; less is the edge of a board.
MIN_FURNITURE_DROP_M = 0.1
# Fraction of stray points that may lie below the box or beside it.
STRAY_POINTS_FRACTION = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Furniture:
    """A piece of furniture.

    Attributes
    ----------
    box : Box
        Box of its seen part, in the world; at most as high as its highest plane.
    planes : tuple of int
        Indices of the supporting planes that it bears.
    plane : int or None
        Index of the plane on which it stands; None if unknown.
    points : (N,) int64
        Indices, in the map, of its points beneath these planes.
    """

    box: Box
    planes: tuple[int, ...]
    plane: int | None
    points: Numbers


@dataclass(frozen=True, slots=True)
class _Area:
    """A supporting plane seen from above.

    Attributes
    ----------
    coefficients : (4,) float64
        The plane is a x + b y + c z + d = 0 in the level frame; (a, b, c) is its unit normal, up.
    corner : (2,) int64
        First cell of its images.
    outline : (N, 3) float64
        In the level frame.
    inside, around : (H, W) uint8
        1 for the cells within its outline, and for the cells within `RIM_M` of it.
    """

    coefficients: Float64Array
    corner: Numbers
    outline: Float64Array
    inside: UInt8Array
    around: UInt8Array

    def height_m(self, points: Float64Array) -> Float64Array:
        """Return the heights of points (N, 3) above the plane, metres."""
        return np.asarray(points @ self.coefficients[:3] + self.coefficients[3])

    def holds(self, image: UInt8Array, points: Float64Array) -> npt.NDArray[np.bool_]:
        """Return which points (N, 3) lie above or below the marked cells of `image` (`inside` or `around`)."""
        x, y = (np.floor(points[:, :2] / WALL_CELL_M).astype(np.int64) - self.corner).T
        in_image = (x >= 0) & (y >= 0) & (x < image.shape[1]) & (y < image.shape[0])
        return np.asarray(in_image & (image[np.where(in_image, y, 0), np.where(in_image, x, 0)] > 0))


def find_furniture(planes: Sequence[SupportPlane], points: MapPoints, up: Float64Array | None) -> tuple[Furniture, ...]:
    """Find the furniture that bears supporting planes: points without an object, beneath a plane and up to it.

    A plane with nothing beneath it, such as the floor, has no furniture. Planes with common points beneath them, such
    as boards between the same two sides, belong to one piece.

    Parameters
    ----------
    planes : sequence of SupportPlane
    points : MapPoints
    up : (3,) float64 or None
        Up in the world; None if it is unknown, and then nothing is found.
    """
    if up is None or not len(planes):
        return ()
    R = level_rotation(up)
    areas = [_area(plane, R) for plane in planes]
    free = np.flatnonzero(points.label == 0)
    local = points.xyz[free].astype(np.float64) @ R.T
    first, cube = cubes_of(local)
    local = local[first]
    heights = np.array([area.height_m(local) for area in areas])
    on = np.array(
        [(np.abs(h) <= DRIFT_M) & area.holds(area.inside, local) for area, h in zip(areas, heights, strict=True)]
    )
    off = ~on.any(axis=0)
    beneath = np.array(
        [off & (h < -DRIFT_M) & area.holds(area.around, local) for area, h in zip(areas, heights, strict=True)]
    )
    used = np.flatnonzero(beneath.any(axis=0))
    if not len(used):
        return ()
    part = _connected(local[used])
    bears = _parts_that_bear(part, beneath[:, used], heights[:, used])
    found = []
    for members, in_piece in _pieces(bears, part):
        cubes = used[in_piece]
        indices = free[np.isin(cube, cubes)]
        tops = np.concatenate([_on(areas[k], local[on[k]], heights[k, on[k]]) for k in members.tolist()])
        plane, foot_m = _stands_on(areas, members, local[cubes])
        found.append(Furniture(_box(local[cubes], tops, foot_m, R), tuple(members.tolist()), plane, indices))
    return tuple(found)


def _area(plane: SupportPlane, R: Float64Array) -> _Area:
    rim = int(np.ceil(RIM_M / WALL_CELL_M))
    outline = plane.extent @ R.T
    cells = np.floor(outline[:, :2] / WALL_CELL_M).astype(np.int64)
    corner = cells.min(axis=0) - rim
    width, height = (cells.max(axis=0) + rim + 1 - corner).tolist()
    inside = np.zeros((height, width), np.uint8)
    cv2.fillPoly(inside, [(cells - corner).astype(np.int32)], 1)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * rim + 1, 2 * rim + 1))
    around = np.asarray(cv2.dilate(inside, disc), np.uint8)
    return _Area(np.append(R @ plane.normal, plane.offset), corner, outline, inside, around)


def _on(area: _Area, points: Float64Array, heights: Float64Array) -> Float64Array:
    """Project points (N, 3), at heights (N,) above a plane, onto it; without points, return its outline."""
    normal = area.coefficients[:3]
    return points - heights[:, None] * normal if len(points) else area.outline


def _connected(points: Float64Array) -> npt.NDArray[np.int32]:
    """Return the number of the connected part of each point (N, 3), (N,): gaps within a part are at most `LINK_M`."""
    part = np.empty(len(points), np.int32)
    number_parts(points, LINK_M, part)
    return part


def _parts_that_bear(
    part: npt.NDArray[np.int32], beneath: npt.NDArray[np.bool_], heights: Float64Array
) -> npt.NDArray[np.bool_]:
    """Return which planes (P,) each part (K,) bears, (P, K): it reaches up to the plane, and far enough down.

    Parameters
    ----------
    part : (N,) int32
        Number of the part of each point, 0..K-1.
    beneath : (P, N) bool
        Points that lie beneath each plane.
    heights : (P, N) float64
        Heights of the points above each plane, metres.
    """
    bears = np.zeros((len(beneath), int(part.max()) + 1), bool)
    for row, below, height in zip(bears, beneath, heights, strict=True):
        row[part[below & (height >= -DRIFT_M - LINK_M)]] = True
        deep = np.zeros(len(row), bool)
        deep[part[below & (height <= -MIN_FURNITURE_DROP_M)]] = True
        row &= deep
    return bears


def _pieces(bears: npt.NDArray[np.bool_], part: npt.NDArray[np.int32]) -> list[tuple[Numbers, npt.NDArray[np.bool_]]]:
    """Return planes and points of each piece of furniture: planes with a common part belong to one piece."""
    pieces = []
    left = bears.any(axis=1)
    while left.any():
        members = np.arange(len(bears)) == np.argmax(left)
        of_it, count = bears[members].any(axis=0), 0
        while count < members.sum():  # the planes of these parts, and then the parts of these planes
            count = members.sum()
            members = bears[:, of_it].any(axis=1)
            of_it = bears[members].any(axis=0)
        pieces.append((np.flatnonzero(members), np.asarray(of_it[part])))
        left &= ~members
    return pieces


def _stands_on(areas: Sequence[_Area], members: Numbers, points: Float64Array) -> tuple[int | None, float]:
    """Return the plane on which furniture stands, None if unknown, and the height of its foot, metres.

    Parameters
    ----------
    areas : sequence of _Area
    members : (M,) int64
        The planes that it bears.
    points : (N, 3) float64
        Its points in the level frame, without the points of the plane on which it stands.
    """
    low_m = float(np.quantile(points[:, 2], STRAY_POINTS_FRACTION))
    feet = points[np.abs(points[:, 2] - low_m) <= WALL_CELL_M]
    found: int | None = None
    least_m = LINK_M
    for k, area in enumerate(areas):
        gap_m = float(np.median(area.height_m(feet)))
        if k not in members and abs(gap_m) <= least_m and np.median(area.holds(area.inside, feet)) > 0:
            found, least_m = k, abs(gap_m)
    foot_m = low_m if found is None else float(np.median(feet[:, 2] - areas[found].height_m(feet)))
    return found, foot_m


def _box(points: Float64Array, tops: Float64Array, foot_m: float, R: Float64Array) -> Box:
    """Return the box of furniture in the world.

    Parameters
    ----------
    points : (N, 3) float64
        Its points beneath the planes that it bears, in the level frame.
    tops : (M, 3) float64
        Points of these planes.
    foot_m : float
        Height of its foot.
    R : (3, 3) float64
        From the world to the level frame.
    """
    up = np.array([0.0, 0.0, 1.0])
    box = fit_box(np.concatenate([points[points[:, 2] >= foot_m], tops]), up, -foot_m, 0.0)
    return Box(R.T @ box.center, box.size, R.T @ box.rotation)
