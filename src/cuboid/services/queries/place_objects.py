"""The objects of a place at one moment, as a source of the questions: conditions are masks over them.

Gone objects are among them. They meet conditions of size and time, in a scene also of name and color, and none of where
they are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from functools import cached_property

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import InputError, shown
from cuboid.ground.core.results import Relation, TrackedObject
from cuboid.ground.core.values import ObjectStatus, RelationKind
from cuboid.ground.geometry.se3 import quat_wxyz_from_rotation
from cuboid.method.relations import SurfaceKind, surface_kinds
from cuboid.method.relations.levels import plane_area_m2
from cuboid.method.relations.tree import plane_heights_m
from cuboid.method.text_search import ranked
from cuboid.services.queries.answers import FoundObject, Related
from cuboid.services.queries.filters import Filters, is_kind, is_surface
from cuboid.services.queries.looking import vector
from cuboid.services.queries.shared_map import SharedMap
from cuboid.services.queries.snapshot import Mask, Snapshot, colors_of_mean, is_called, names_of
from cuboid.services.queries.sources import Source


class PlaceObjects:
    """The objects of a place at one moment: an `ObjectSource`.

    Parameters
    ----------
    shared : SharedMap
    targets : sequence of str
        The objects and surfaces of all relations that the question has.
    """

    def __init__(self, shared: SharedMap, targets: Sequence[str] = ()) -> None:
        self._shared, self._targets, self._now = shared, targets, shared.snapshot()
        self._distances: Float64Array | None = None

    def sized(self, low_m: float, high_m: float) -> Mask:
        """Return the objects whose longest side is within a range."""
        longest = self._now.longest_m()
        return np.asarray((longest >= low_m) & (longest <= high_m))

    def probable(self, least: float) -> Mask:
        """Return the objects with at least a probability."""
        return self._now.mask(lambda item: item.probability >= least)

    def named(self, name: str) -> Mask:
        """Return the objects with a name or a likely class."""
        return self._now.mask(lambda item: name.strip().lower() in names_of(item))

    def called(self, label_or_name: str) -> Mask:
        """Return the objects with a label or a name."""
        return self._now.mask(lambda item: is_called(item, label_or_name))

    def colored(self, word: str) -> Mask:
        """Return the objects of whose points enough have a color; of those without points, the mean color counts."""
        colors = self._shared.colors()
        return self._now.mask(lambda item: word in _colors(item, colors))

    def seen(self, since: datetime | None, until: datetime | None) -> Mask:
        """Return the objects that were seen last within a range of time."""

        def was_seen(item: TrackedObject) -> bool:
            seen = self._shared.source.last_seen(item).time
            if seen is None:
                raise InputError("since, until: this recording has no calendar times")
            moment = datetime.fromisoformat(seen)
            return (since is None or moment >= since) and (until is None or moment < until)

        with self._shared.lock:
            return self._now.mask(was_seen)

    def near(self, point: tuple[float, float, float], within_m: float) -> Mask:
        """Return the objects near a point."""
        return self._within(self._now.distances_m(np.array(point)), within_m)

    def near_object(self, label_or_name: str, within_m: float) -> Mask:
        """Return the objects near other ones."""
        others = self._now.called(label_or_name)
        distances = np.min([self._now.distances_m(other.box.center) for other in others], axis=0)
        distances[np.isin(self._now.labels, [other.label for other in others])] = np.inf
        return self._within(distances, within_m)

    def _within(self, distances_m: Float64Array, within_m: float) -> Mask:
        """Return the present objects that are near enough; the first distances rank them."""
        self._distances = distances_m if self._distances is None else self._distances
        return np.asarray((distances_m <= within_m) & self._now.present)

    def placed(self, side: str, to: str) -> Mask:
        """Return the objects on a side of other ones, each as the camera of its last sighting saw it."""
        up, found = self._shared.up(), np.zeros(len(self._now.known), bool)
        for other in self._now.called(to):
            with self._shared.lock:
                camera_m = self._shared.source.last_seen(other).camera_m
            if up is None or camera_m is None:
                raise InputError(f"{side}: up, or the camera of the last sighting of {shown(to)}, is not known")
            found |= self._now.placed(side, other, np.array(camera_m), up)
            away = self._now.distances_m(other.box.center)
            self._distances = away if self._distances is None else self._distances
        return found

    def related(self, kind: RelationKind, to: str) -> Mask:
        """Return the objects with a relation to an object or a surface."""
        ends = self._surfaces(to)
        if not ends and is_kind(to) and not self._now.is_called(to):
            raise InputError(self._no_such_surface(to))
        if not ends or self._now.is_called(to):
            ends |= {item.label for item in self._now.called(to)}
        found = [
            label
            for label, relations in self._relations.items()
            if any(relation.kind == kind and relation.to in ends for relation in relations)
        ]
        return np.isin(self._now.labels, found)

    def names(self) -> list[str]:
        """Return the names and likely classes of all known objects, in lower case."""
        return sorted({name for item, _ in self._now.known for name in names_of(item)})

    def recorded(self, pattern: str) -> Mask:
        """Raise InputError: a place has no recordings with names."""
        raise InputError("recording: this filter needs a store")

    def other_than(self, recording: str, label: int) -> Mask:
        """Raise InputError: a place keeps no shapes and colors to compare."""
        raise InputError("like: this filter needs a store")

    @cached_property
    def _relations(self) -> Mapping[int, Sequence[Relation]]:
        return self._shared.relations_to([to for to in self._targets if not self._surfaces(to)])

    def _surfaces(self, to: str) -> set[int | str]:
        """Return the surfaces that a text names: a surface, its kind, or furniture with this label or name."""
        if is_surface(to):
            return {to.strip()}
        kinds = self._kinds if is_kind(to) else []
        found: set[int | str] = {f"plane:{k}" for k, kind in enumerate(kinds) if kind == to.strip().lower()}
        return found | {f"plane:{k}" for piece in self._shared.furniture() if piece.is_called(to) for k in piece.planes}

    @cached_property
    def _kinds(self) -> list[SurfaceKind | None]:
        up = self._shared.up()
        with self._shared.lock:
            return surface_kinds(tuple(self._shared.source.map.planes), up)

    def _no_such_surface(self, to: str) -> str:
        up = self._shared.up()
        with self._shared.lock:
            planes = tuple(self._shared.source.map.planes)
        heights = plane_heights_m(planes, up)
        known = [
            f"plane:{k} ({heights[k]:.2f} m high, {plane_area_m2(plane):.1f} m2)" for k, plane in enumerate(planes)
        ]
        listed = ", ".join(known) or "none"
        return f"no surface is known as the {to.strip().lower()}, and no object is named so; surfaces: {listed}"

    def select(self, conditions: Sequence[Mask], by: Filters) -> list[FoundObject]:
        """Return the objects that meet all conditions, by match with a text, else by distance, else by label.

        Gone objects are last.
        """
        rows = self._rows(conditions)
        if by.order is not None:
            rows = self._now.first(by.order, rows[self._now.present[rows]], self._distances)
        elif self._distances is not None:
            rows = rows[np.argsort(self._distances[rows], kind="stable")]
        chosen, fits = rows.tolist(), dict[int, float]()
        if by.text is not None:
            row_of = {self._now.known[k][0].label: k for k in chosen}
            matches = ranked([self._now.known[k][0] for k in chosen], self._shared.vectors(), by.text)
            fits = {row_of[match.item.label]: match.score for match in matches}
            chosen = list(fits)
        chosen.sort(key=lambda k: not self._now.present[k])
        relations, colors = self._relations if self._targets else None, self._shared.colors()
        with self._shared.lock:
            return [self._answer(k, colors, relations, fits.get(k)) for k in chosen[: by.limit]]

    def latest(self, conditions: Sequence[Mask]) -> list[FoundObject]:
        """Return the objects that meet all conditions, the last seen first."""
        last = [(self._now.known[k][0].last_frame, k) for k in self._rows(conditions).tolist()]
        colors = self._shared.colors()
        with self._shared.lock:
            return [self._answer(k, colors) for _, k in sorted(last, reverse=True)]

    def _rows(self, conditions: Sequence[Mask]) -> npt.NDArray[np.intp]:
        return np.flatnonzero(np.logical_and.reduce([np.ones(len(self._now.known), bool), *conditions]))

    def _answer(
        self,
        k: int,
        colors: Mapping[int, tuple[str, ...]],
        relations: Mapping[int, Sequence[Relation]] | None = None,
        text_score: float | None = None,
    ) -> FoundObject:
        item, state = self._now.known[k]
        distance_m = None if self._distances is None else float(self._distances[k])
        return answer_of(self._shared.source, self._now, item, state, colors, relations, distance_m, text_score)


def answer_of(
    source: Source,
    now: Snapshot,
    item: TrackedObject,
    state: ObjectStatus,
    colors: Mapping[int, tuple[str, ...]],
    relations: Mapping[int, Sequence[Relation]] | None = None,
    distance_m: float | None = None,
    text_score: float | None = None,
) -> FoundObject:
    """Return an object as answers contain it; the caller holds the lock of the source."""
    of_item = None if relations is None else relations.get(item.label, ())
    w, x, y, z = (round(float(value), 6) for value in quat_wxyz_from_rotation(item.box.rotation))
    return FoundObject(
        label=item.label,
        name=item.name,
        state=state,
        kind=item.kind,
        classes=tuple((name, round(score, 3)) for name, score in item.names),
        score=round(item.score, 3),
        probability=round(item.probability, 3),
        center_m=vector(item.box.center),
        size_m=vector(item.box.size),
        quat_wxyz=(w, x, y, z),
        color=next(iter(_colors(item, colors)), None),
        colors=_colors(item, colors),
        plane=item.plane,
        first_seen=source.first_seen(item),
        last_seen=source.last_seen(item),
        frames_seen=item.frames_seen,
        distance_m=None if distance_m is None else round(distance_m, 4),
        text_score=None if text_score is None else round(text_score, 6),
        later=source.later(item, state),
        size_sigma_m=vector(item.size_sigma_m) if item.size_sigma_m else None,
        center_sigma_m=vector(item.center_sigma_m) if item.center_sigma_m else None,
        sides_seen=item.sides_seen if item.size_sigma_m else None,
        relations=None if of_item is None else tuple(_related(relation, now) for relation in of_item),
    )


def _colors(item: TrackedObject, of_points: Mapping[int, tuple[str, ...]]) -> tuple[str, ...]:
    """Return the color words of an object: those of its points, else that of its mean color."""
    return of_points.get(item.label) or colors_of_mean(item.mean_color.tobytes())


def _related(relation: Relation, now: Snapshot) -> Related:
    name = now.names.get(relation.to) if isinstance(relation.to, int) else None
    return Related(relation.kind, relation.to, name, round(relation.score, 3))
