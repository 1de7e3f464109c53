"""The true relations of a synthetic scene, as defined in `cuboid.method.relations`, from the exact bodies."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations
from typing import Any

import cv2
import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.geometry import se3
from cuboid.lab.synthetic.footprint import gap_m, hull, smallest_rectangle
from cuboid.lab.synthetic.scene import Furniture, Scene
from cuboid.method.relations.finding import AGAINST_M, BESIDE_M, MIN_COMMON_FRACTION
from cuboid.results.files.text import DIRECTION, LENGTH, rounded, rounded_list

# Name of wall furniture; a wall faces its own -y.
WALL = "wall"
# Margin, metres, around the limit of a relation in which it counts neither way: the limit is a convention, and sides of
# found boxes have errors of this size.
OPEN_M = 0.02
# The same margin for the fraction of a footprint.
OPEN_FRACTION = 0.2


@dataclass(frozen=True, slots=True)
class _Body:
    """An object in the room: outlines from above of body (K, 2) and box (4, 2), heights of bottom and top."""

    id: int
    outline: Float64Array
    rectangle: Float64Array
    low: float
    high: float

    @property
    def middle(self) -> float:
        return (self.low + self.high) / 2.0


def true_walls(scene: Scene) -> list[dict[str, Any]]:
    """Return the walls of a scene in its world, ready for JSON."""
    planes = [_face(scene.T_world_room @ wall.T_room_model) for wall in _walls(scene)]
    return [{"normal": rounded_list(n, DIRECTION), "offset": rounded(d, LENGTH)} for n, d in planes]


def true_relations(scene: Scene) -> list[dict[str, Any]]:
    """Return the relations of a scene, ready for JSON.

    Each has `from` (an id), `is` (a kind), `to` (an id, "plane:k" or "wall:k") and `judged` (false if undecided).
    """
    bodies = [_body(one.id, one.mesh().vertices) for one in scene.objects]
    found: list[tuple[int, str, int | str]] = []
    open_ones: list[tuple[int, str, int | str]] = []
    for one in scene.objects:
        rests = one.on or one.inside
        found.append((one.id, "in" if one.inside else "on", rests or f"plane:{one.surface}"))
        found += [(rests, "supports", one.id)] if rests else []
    rest = {(one.id, one.on or one.inside) for one in scene.objects}
    for a, b in permutations(bodies, 2):
        common = _common_area(a.outline, b.outline)
        apart = max(common / _area(one.outline) for one in (a, b)) < MIN_COMMON_FRACTION
        if {(a.id, b.id), (b.id, a.id)}.isdisjoint(rest) and apart and _level(a, b):
            # The gap between boxes is at most the gap between the bodies.
            near, far = gap_m(a.rectangle, b.rectangle), gap_m(a.outline, b.outline)
            _sort((a.id, "beside", b.id), near, far, BESIDE_M, OPEN_M, found, open_ones)
        if a.middle < b.low and common > 0.0:
            boxes = _common_area(a.rectangle, b.rectangle) / _area(a.rectangle)
            least, most = sorted((-common / _area(a.outline), -boxes))
            _sort((a.id, "under", b.id), least, most, -MIN_COMMON_FRACTION, OPEN_FRACTION, found, open_ones)
    for a in bodies:
        for k, surface in enumerate(scene.surfaces):
            if surface.height_m > a.middle and surface.contains(a.outline.mean(0)[None], 0.0):
                found.append((a.id, "under", f"plane:{k}"))
        for k, wall in enumerate(_walls(scene)):
            normal, offset = _face(wall.T_room_model)
            near, far = ((one @ normal[:2] + offset).min() for one in (a.rectangle, a.outline))
            _sort((a.id, "against", f"wall:{k}"), near, far, AGAINST_M, OPEN_M, found, open_ones)
    return [
        *({"from": one, "is": kind, "to": to} for one, kind, to in found),
        *({"from": one, "is": kind, "to": to, "judged": False} for one, kind, to in open_ones),
    ]


def _sort(
    relation: tuple[int, str, int | str],
    least: float,
    most: float,
    limit: float,
    margin: float,
    found: list[tuple[int, str, int | str]],
    open_ones: list[tuple[int, str, int | str]],
) -> None:
    """Add a relation with an upper limit to the true ones, to the undecided ones, or to neither list."""
    if most <= limit - margin:
        found.append(relation)
    elif least <= limit + margin:
        open_ones.append(relation)


def _walls(scene: Scene) -> list[Furniture]:
    return [one for one in scene.furniture if one.model.name == WALL]


def _face(T_to_wall: Float64Array) -> tuple[Float64Array, float]:
    """Return normal and offset of the face of a wall with the pose (4, 4)."""
    normal = -T_to_wall[:3, 1]
    return normal, -float(normal @ se3.transform(T_to_wall, (0.0, 0.0, 0.0)))


def _body(number: int, vertices: Float64Array) -> _Body:
    outline = hull(vertices[:, :2])
    center, size, angle = smallest_rectangle(outline)
    along = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    rectangle = center + (np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * size / 2.0) @ along
    return _Body(number, outline, rectangle, float(vertices[:, 2].min()), float(vertices[:, 2].max()))


def _level(a: _Body, b: _Body) -> bool:
    """Tell whether the height ranges of two bodies overlap by most of the smaller range."""
    return min(a.high, b.high) - max(a.low, b.low) >= MIN_COMMON_FRACTION * min(a.high - a.low, b.high - b.low)


def _area(outline: Float64Array) -> float:
    return float(cv2.contourArea(outline.astype(np.float32)))


def _common_area(one: Float64Array, other: Float64Array) -> float:
    """Return the common area of two convex outlines, square metres."""
    return float(cv2.intersectConvexConvex(one.astype(np.float32), other.astype(np.float32))[0])
