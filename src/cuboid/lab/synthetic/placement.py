"""Places models on surfaces: at random, side by side with a given gap, or one on another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.lab.synthetic.footprint import gap_m, hull
from cuboid.lab.synthetic.mesh import shift
from cuboid.lab.synthetic.scene import SceneObject, Surface
from cuboid.lab.synthetic.shapes import Model, turned

# Maximum number of random draws for a free place before a model is left out.
TRIES = 300
# Minimum distance of objects from the edge of their support, metres.
EDGE_M = 0.025
# Below this gap (metres) two objects count as touching: depth cameras cannot resolve it.
TOUCH_M = 0.002


class Arrangement:
    """The surfaces of a scene and the objects on them so far.

    Parameters
    ----------
    surfaces : sequence of Surface
    rng : numpy.random.Generator
    objects : sequence of SceneObject
        Objects that are already placed.
    """

    def __init__(
        self, surfaces: tuple[Surface, ...], rng: np.random.Generator, objects: Sequence[SceneObject] = ()
    ) -> None:
        self.surfaces = surfaces
        self.objects: list[SceneObject] = list(objects)
        self._outlines: dict[int, Float64Array] = {o.id: hull(o.mesh().vertices[:, :2]) for o in objects}
        self._rng = rng

    def put(
        self, model: Model, surface: int, gap: float, within: float = 1.0, number: int | None = None
    ) -> SceneObject | None:
        """Put a model anywhere on a surface, at least `gap` metres from all others.

        `within` is the fraction of the surface, around its middle, where the model's centre may lie; `number` is the
        object's id, by default the next one. Returns None if there is no room.
        """
        model = turned(model, self._rng.uniform(0, 2 * np.pi))
        outline = hull(model.mesh().vertices[:, :2])
        for _ in range(TRIES):
            place = self.surfaces[surface].at(*(within * self._rng.uniform(-1, 1, 2)))
            if self._free(outline + place, surface, gap):
                return self._add(model, place, surface, number=number)
        return None

    def take(self, number: int) -> SceneObject:
        """Remove an object and return it."""
        taken = next(o for o in self.objects if o.id == number)
        self.objects = [o for o in self.objects if o is not taken]
        del self._outlines[number]
        return taken

    def restore(self, body: SceneObject) -> None:
        """Add a removed object again, in its own pose."""
        self.objects.append(body)
        self.objects.sort(key=lambda o: o.id)
        self._outlines[body.id] = hull(body.mesh().vertices[:, :2])

    def fits(self, body: SceneObject, gap: float) -> bool:
        """Tell whether there is room for an object in its own pose."""
        return self._free(hull(body.mesh().vertices[:, :2]), body.surface, gap)

    def put_at(self, model: Model, surface: int, place: tuple[float, float]) -> SceneObject:
        """Put a model at a place (coordinates -1..1 of the surface), unrotated."""
        return self._add(model, self.surfaces[surface].at(*place), surface)

    def put_near(
        self,
        model: Model,
        surface: int,
        gap: float,
        place: tuple[float, float],
        spread: tuple[float, float],
        angle_rad: float | None = None,
    ) -> SceneObject | None:
        """Put a model near a place, at least `gap` metres from all others.

        `place` and the largest distance from it, `spread`, are coordinates -1..1 of the surface; the model is turned by
        `angle_rad`, by default a random angle. Returns None if there is no room.
        """
        model = turned(model, self._rng.uniform(0, 2 * np.pi) if angle_rad is None else angle_rad)
        outline = hull(model.mesh().vertices[:, :2])
        for _ in range(TRIES):
            point = self.surfaces[surface].at(*(place + self._rng.uniform(-1, 1, 2) * spread))
            if self._free(outline + point, surface, gap):
                return self._add(model, point, surface)
        return None

    def outlines(self, surface: int) -> list[Float64Array]:
        """Return the convex outlines (K, 2) in the room of the objects of a surface."""
        return [self._outlines[one.id] for one in self.objects if one.surface == surface]

    def put_beside(self, model: Model, other: SceneObject, gap: float, others_gap: float) -> SceneObject | None:
        """Put a model `gap` metres from another object on the same surface, and `others_gap` from the rest."""
        for _ in range(TRIES // 5):
            model = turned(model, self._rng.uniform(0, 2 * np.pi))
            outline = hull(model.mesh().vertices[:, :2])
            angle = self._rng.uniform(0, 2 * np.pi)
            away = np.array([np.cos(angle), np.sin(angle)])
            near = self._outlines[other.id]
            start, low, high = other.T_room_model[:2, 3], 0.0, 1.0
            while high - low > 1e-5:
                middle = (low + high) / 2
                if gap_m(outline + start + middle * away, near) > max(gap, TOUCH_M / 4):
                    high = middle
                else:
                    low = middle
            place = start + high * away
            if self._free(outline + place, other.surface, others_gap, ignoring=other.id):
                added = self._add(model, place, other.surface)
                return self._touching(added, other) if gap < TOUCH_M else added
        return None

    def put_on(self, model: Model, other: SceneObject) -> SceneObject:
        """Put a model on the flat top of another."""
        top = float(other.mesh().vertices[:, 2].max())
        added = self._add(model, other.T_room_model[:2, 3], other.surface, top)
        added = replace(self._touching(added, other), on=other.id)
        self.objects[added.id - 1] = added
        return added

    def put_in(self, model: Model, other: SceneObject, inside: Surface, gap: float) -> SceneObject | None:
        """Put a model anywhere on the floor of a container, `gap` metres from its walls and from others in it.

        Returns None if there is no room.
        """
        model = turned(model, self._rng.uniform(0, 2 * np.pi))
        outline = hull(model.mesh().vertices[:, :2])
        within = [self._outlines[o.id] for o in self.objects if o.inside == other.id]
        for _ in range(TRIES):
            place = inside.at(*self._rng.uniform(-1, 1, 2))
            placed = outline + place
            if inside.contains(placed, gap) and all(gap_m(placed, one) >= gap for one in within):
                added = self._add(model, place, other.surface, inside.height_m)
                added = replace(self._touching(added, other), inside=other.id)
                self.objects[added.id - 1] = added
                return added
        return None

    def not_judged(self, *ids: int) -> None:
        """Mark objects as counting neither way."""
        self.objects = [replace(o, judged=o.judged and o.id not in ids) for o in self.objects]

    def _free(self, outline: Float64Array, surface: int, gap: float, ignoring: int = 0) -> bool:
        if not self.surfaces[surface].contains(outline, EDGE_M):
            return False
        return all(
            _boxes_apart(outline, self._outlines[other.id], gap) or gap_m(outline, self._outlines[other.id]) >= gap
            for other in self.objects
            if other.surface == surface and other.id != ignoring
        )

    def _add(
        self,
        model: Model,
        place: Float64Array,
        surface: int,
        bottom: float | None = None,
        number: int | None = None,
    ) -> SceneObject:
        height = self.surfaces[surface].height_m if bottom is None else bottom
        number = len(self.objects) + 1 if number is None else number
        added = SceneObject(model, shift((*place, height)), id=number, surface=surface)
        self.objects.append(added)
        self._outlines[added.id] = hull(model.mesh().vertices[:, :2]) + place
        return added

    def _touching(self, first: SceneObject, second: SceneObject) -> SceneObject:
        for one, other in ((first, second), (second, first)):
            now = self.objects[one.id - 1]
            self.objects[one.id - 1] = replace(now, touches=(*now.touches, other.id))
        return self.objects[first.id - 1]


def _boxes_apart(first: Float64Array, second: Float64Array, gap: float) -> bool:
    """Tell whether the level bounding boxes of two outlines are more than `gap` apart: then so are the outlines."""
    between = np.maximum(first.min(0) - second.max(0), second.min(0) - first.max(0))
    return bool(between.max() > gap)
