"""Queries of one place: the layer below `cuboid find`, the HTTP server and the MCP server.

Queries of objects use lists that are rebuilt after the map has changed. Slow results (relations, up, vectors, clouds,
meshes) are computed from a second opening of the place, so that other queries do not wait for them.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Generic, TypeVar

import numpy as np

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.errors import InputError, shown
from cuboid.ground.core.results import Relation, SupportPlane, TrackedObject
from cuboid.ground.geometry.se3 import quat_wxyz_from_rotation
from cuboid.method.relations import Branch, find_relations, place_tree
from cuboid.method.relations.tree import number_of, plane_heights_m
from cuboid.method.shapes import ObjectMesh
from cuboid.method.text_search import TextModel, TextQuery, ranked
from cuboid.results.files.queries import PointCloud
from cuboid.services.queries.answers import About, FoundObject, FreePlace, History, Related, State, Surface, TreeNode
from cuboid.services.queries.changes import ChangeLog
from cuboid.services.queries.filters import Filters, is_surface
from cuboid.services.queries.free import free_place
from cuboid.services.queries.parameters import text_query
from cuboid.services.queries.snapshot import Snapshot, color_of_mean, is_called
from cuboid.services.queries.sources import Bearer, Source, vector

T = TypeVar("T")
# A slow result is computed again after the map has changed, but not before this many times its computing time has
# passed. So computing takes at most a tenth of the time.
REST = 10.0
# With more objects than this, relations are computed only among the objects near those of the query.
SMALL = 300
# Default number of sightings in a history.
SIGHTINGS = 20
# Default free height above a footprint, metres: that of most objects on tables.
FREE_HEIGHT_M = 0.3
# Filters that need several recordings, or columns that only a store has.
ONLY_IN_A_STORE = ("recording", "like")


class Place:
    """Queries of a place, from any thread; each sees the map of one moment.

    Parameters
    ----------
    source : Source
    model : TextModel, optional
        The image-text model that ranks objects by a text.

    Attributes
    ----------
    changes : ChangeLog
        The changes of the map since it was opened.
    model : TextModel or None
    """

    def __init__(self, source: Source, model: TextModel | None = None) -> None:
        self._source, self.model = source, model
        self._lock, self._aside_lock = threading.Lock(), threading.Lock()
        self.changes = ChangeLog()
        self._compared: Snapshot | None = None
        self._objects: _Kept[Snapshot] = _Kept(lambda: Snapshot(source))
        self._relations: _Kept[dict[int, tuple[Relation, ...]]] = _Kept(self._find_relations)
        self._up: _Kept[Float64Array | None] = _Kept(lambda: source.aside.up)
        self._furniture: _Kept[Sequence[Bearer]] = _Kept(lambda: source.furniture())
        self._vectors: _Kept[Mapping[int, Float32Array]] = _Kept(self._find_vectors)
        self.refresh()

    def refresh(self) -> None:
        """Compare the map with its previous state, and record the changes; servers call it at intervals."""
        with self._lock:
            now = self._now()
            if now is not self._compared:
                self.changes.update(now.living)
                self._compared = now

    def about(self) -> About:
        """Return title, kind and state of the place."""
        up = self._known_up()
        with self._lock:
            found = self._now().living
            running, last = self._source.running, self.changes.last
            title, kind = self._source.title, self._source.kind
            return About(title, kind, len(found), None if up is None else vector(up), last, running)

    def text_query(self, text: str | None) -> TextQuery | None:
        """Return a text with its vector; None without a text.

        Raises
        ------
        InputError
            The place is a run, or there is no model.
        """
        if text is not None and self._source.kind == "run":
            raise InputError(
                "text: the pictures of objects are embedded at the end of a run; serve its results or scene then, "
                "with --text-model DIR"
            )
        return text_query(text, self.model)

    def find(self, filters: Filters) -> list[FoundObject]:
        """Return the objects that pass the filters, sorted by match with a text, else by distance, else by label.

        Raises
        ------
        InputError
            A named object does not exist, a filter is for stores only, or a text is given without a model or pictures.
        MissingExtraError
            ONNX Runtime or tokenizers is not installed.
        """
        for name in ONLY_IN_A_STORE:
            if getattr(filters, name) is not None:
                raise InputError(f"{name}: this filter needs a store")
        targets = dict(filters.related())  # by the kind of the relation
        bearers = self._found_aside(self._furniture) if targets else ()
        relations = self._relations_to(to for to in targets.values() if not _surfaces(to, bearers)) if targets else {}
        vectors = {} if filters.text is None else self._found_aside(self._vectors)
        with self._lock:
            now = self._now()
            kept = now.passing(filters)
            for kind, to in targets.items():
                ends = _surfaces(to, bearers)
                if not ends or now.is_called(to):
                    ends |= {item.label for item in now.called(to)}
                kept &= np.isin(now.labels, [label for label, found in relations.items() if _holds(found, kind, ends)])
            distances = self._distances(now, filters)
            if distances is not None:
                kept &= distances <= filters.within_m
            rows = np.flatnonzero(kept)
            if distances is not None:
                rows = rows[np.argsort(distances[rows], kind="stable")]
            items, fits = [now.living[k] for k in rows.tolist()], dict[int, float]()
            away = dict(zip(now.labels[rows].tolist(), [] if distances is None else distances[rows], strict=False))
            if filters.text is not None:
                matches = ranked(items, vectors, filters.text)
                items, fits = [match.item for match in matches], {match.item.label: match.score for match in matches}
            return [
                self._answer(
                    now,
                    item,
                    away.get(item.label),
                    relations if targets else None,
                    text_score=fits.get(item.label),
                )
                for item in items[: filters.limit]
            ]

    def object(self, label: int) -> FoundObject:
        """Return one object with its relations, by its label or by a label that was merged into it.

        Raises
        ------
        InputError
            No object has, or had, the label.
        """
        relations = self._relations_to([str(self._item(label).label)])
        with self._lock:
            now = self._now()
            item, state = now.find(label)
            return self._answer(now, item, None, relations if state == "present" else None, state)

    def last_seen(self, label_or_name: str) -> list[FoundObject]:
        """Return the last sightings of objects with a label or name, gone objects included, the latest first.

        Parameters
        ----------
        label_or_name : str
        """
        with self._lock:
            now = self._now()
            found = [
                (item, state)
                for item, state in now.all
                if state in ("present", "gone") and is_called(item, label_or_name)
            ]
            found.sort(key=lambda entry: (entry[0].last_frame, entry[0].label), reverse=True)
            return [self._answer(now, item, None, None, state) for item, state in found]

    def history(self, label: int, limit: int = SIGHTINGS) -> History:
        """Return the sightings of an object, and its past relations; raises the errors of `object`."""
        with self._lock:
            item, _ = self._now().find(label)
            seen = self._source.sightings(item)
            chosen = np.unique(np.linspace(0, len(seen) - 1, min(max(limit, 1), len(seen))).round().astype(int))
            past = self._source.past_relations(item)
            shown = tuple(seen[k] for k in chosen.tolist())
            return History(item.label, item.merged_labels, len(seen), shown, tuple(past))

    def surfaces(self) -> list[Surface]:
        """Return the supporting planes."""
        up, bearers = self._known_up(), _by_plane(self._found_aside(self._furniture))
        with self._lock:
            planes, now = tuple(self._source.map.planes), self._now()
            heights = plane_heights_m(planes, up)
            return [_surface(k, plane, heights[k], now.living, bearers.get(k)) for k, plane in enumerate(planes)]

    def free_place(
        self, surface: str, length_m: float, width_m: float, height_m: float = FREE_HEIGHT_M, near: str | None = None
    ) -> FreePlace | None:
        """Return the nearest free place on a surface for a footprint; None if there is none.

        Parameters
        ----------
        surface : str
            "plane:k".
        length_m, width_m, height_m : float
            Size of the object that needs the place, metres.
        near : str, optional
            "X,Y,Z" in the world, or label or name of an object (default: the centre of the surface).

        Raises
        ------
        InputError
            There is no such surface or object, or a size is not positive.
        """
        with self._lock:
            planes, now = self._source.map.planes, self._now()
            if not (surface.startswith("plane:") and is_surface(surface) and number_of(surface) < len(planes)):
                raise InputError(f"expected a surface, plane:0 to plane:{len(planes) - 1}, got {shown(surface)}")
            plane, boxes = planes[number_of(surface)], [item.box for item in now.living]
            return free_place(surface, plane, boxes, (length_m, width_m, height_m), self._near(now, near))

    def tree(self) -> tuple[TreeNode, ...]:
        """Return the tree of the place: surfaces, the objects on them, and the objects on and in those."""
        relations, up = self._known_relations(), self._known_up()
        bearers = _by_plane(self._found_aside(self._furniture))
        with self._lock:
            now = self._now()
            found = place_tree(now.living, relations, self._source.map.planes, up)
            names: dict[int | str, str | None] = {f"plane:{k}": bearer.name for k, bearer in bearers.items()}
            names |= dict(now.names.items())
            return tuple(_node(branch, names) for branch in found)

    def picture(self, label: int) -> bytes | None:
        """Return the picture of an object, JPEG; None if there is none; raises the errors of `object`."""
        item = self._item(label)
        with self._aside_lock:
            return self._source.picture(item)

    def cloud(self, label: int) -> PointCloud:
        """Return the points of a present object; raises InputError for other objects."""
        label = self._item(label).label
        with self._aside_lock:
            return self._source.aside.cloud(label)

    def mesh(self, label: int, *, close: bool = False, complete: bool = False) -> ObjectMesh:
        """Return the surface of an object, as `MapQueries.mesh` does."""
        label = self._item(label).label
        with self._aside_lock:
            return self._source.aside.mesh(label, close=close, complete=complete)

    def _item(self, label: int) -> TrackedObject:
        with self._lock:
            return self._now().find(label)[0]

    def _now(self) -> Snapshot:
        return self._objects.get(self._source.version())

    def _known_relations(self) -> dict[int, tuple[Relation, ...]]:
        """Return the relations; the caller must not hold the lock."""
        return self._found_aside(self._relations)

    def _relations_to(self, targets: Iterable[str]) -> Mapping[int, Sequence[Relation]]:
        """Return the relations of the objects around the named ones; the caller must not hold the lock.

        In a large map, only the relations around the named objects are computed, unless all relations are available.
        """
        with self._lock:
            now, version, planes = self._now(), self._source.version(), tuple(self._source.map.planes)
            named = list(targets)
            ends = [item for to in named for item in now.called(to, gone=True)]
            near = now.near(ends)
        all_current = self._relations.current(version, fresh=True)
        if all_current or len(near) == len(now.living) or len(now.living) <= SMALL or not named:
            return self._known_relations()
        if any(item.relations for item in near):
            return {item.label: item.relations for item in near}
        return find_relations(near, planes, self._known_up(), ())

    def _known_up(self) -> Float64Array | None:
        """Return the up direction in the world; the caller must not hold the lock."""
        return self._found_aside(self._up)

    def _found_aside(self, kept: _Kept[T]) -> T:
        with self._lock:
            version = self._source.version()
        current = kept.current(version)
        if current:
            return current[0]
        with self._aside_lock:
            return kept.get(version)

    def _find_relations(self) -> dict[int, tuple[Relation, ...]]:
        with self._lock:
            living, planes = self._now().living, tuple(self._source.map.planes)
        if any(item.relations for item in living):
            return {item.label: item.relations for item in living}
        return find_relations(living, planes, self._source.aside.up, self._source.walls())

    def _find_vectors(self) -> Mapping[int, Float32Array]:
        if self.model is None:
            raise InputError("text: this place was opened without an image-text model")
        return self._source.vectors(self.model)

    def _distances(self, now: Snapshot, filters: Filters) -> Float64Array | None:
        """Return the distance of each box from the place or object of the filters, metres, (N,); None without one."""
        if filters.near is not None:
            return now.distances_m(np.array(filters.near))
        if filters.near_object is None:
            return None
        others = now.called(filters.near_object)
        found = np.min([now.distances_m(other.box.center) for other in others], axis=0)
        found[np.isin(now.labels, [other.label for other in others])] = np.inf
        return np.asarray(found)

    def _near(self, now: Snapshot, near: str | None) -> Float64Array | None:
        if near is None:
            return None
        if "," in near:
            from cuboid.services.queries.words import place

            try:
                return np.array(place(near))
            except ValueError as error:
                raise InputError(f"near: {error}") from None
        return np.asarray(now.called(near)[0].box.center)

    def _answer(
        self,
        now: Snapshot,
        item: TrackedObject,
        distance_m: float | None,
        relations: Mapping[int, Sequence[Relation]] | None,
        state: State = "present",
        text_score: float | None = None,
    ) -> FoundObject:
        of_item = None if relations is None else relations.get(item.label, ())
        w, x, y, z = (round(float(value), 6) for value in quat_wxyz_from_rotation(item.box.rotation))
        return FoundObject(
            label=item.label,
            name=item.name,
            state=state,
            kind=item.kind,
            classes=tuple((name, round(score, 3)) for name, score in item.names),
            score=round(item.score, 3),
            center_m=vector(item.box.center),
            size_m=vector(item.box.size),
            quat_wxyz=(w, x, y, z),
            color=color_of_mean(item.mean_color.tobytes()),
            plane=item.plane,
            first_seen=self._source.first_seen(item),
            last_seen=self._source.last_seen(item),
            frames_seen=item.frames_seen,
            distance_m=None if distance_m is None else round(float(distance_m), 4),
            text_score=None if text_score is None else round(text_score, 6),
            relations=None if of_item is None else tuple(_related(relation, now) for relation in of_item),
        )


class _Kept(Generic[T]):
    """A result of the map, computed again when the map has changed and enough time has passed."""

    def __init__(self, find: Callable[[], T]) -> None:
        self._find = find
        self._version: object = None
        self._value: list[T] = []
        self._again_s = 0.0

    def current(self, version: object, *, fresh: bool = False) -> list[T]:
        """Return the result in a list if it need not be computed again; otherwise an empty list.

        With `fresh`, a result of an earlier version is not returned.
        """
        rests = not fresh and time.monotonic() < self._again_s
        return self._value if version == self._version or rests else []

    def get(self, version: object) -> T:
        """Return the result for a version of the map, or a recent result for an earlier version."""
        current = self.current(version)
        if current:
            return current[0]
        begun_s = time.monotonic()
        found = self._find()
        self._value, self._version = [found], version
        self._again_s = begun_s + REST * (time.monotonic() - begun_s)
        return found


def _holds(relations: Sequence[Relation], kind: str, ends: set[int | str]) -> bool:
    return any(relation.kind == kind and relation.to in ends for relation in relations)


def _surfaces(to: str, bearers: Sequence[Bearer]) -> set[int | str]:
    """Return the surfaces that a text names: a surface, or the planes of furniture with this label or name."""
    if is_surface(to):
        return {to.strip()}
    return {f"plane:{k}" for bearer in bearers if bearer.is_called(to) for k in bearer.planes}


def _by_plane(bearers: Sequence[Bearer]) -> dict[int, Bearer]:
    """Return the furniture by the planes that it bears; of several labels of a piece the oldest."""
    oldest_last = sorted(bearers, key=lambda bearer: bearer.label, reverse=True)
    return {k: bearer for bearer in oldest_last for k in bearer.planes}


def _related(relation: Relation, now: Snapshot) -> Related:
    name = now.names.get(relation.to) if isinstance(relation.to, int) else None
    return Related(relation.kind, relation.to, name, round(relation.score, 3))


def _surface(
    k: int, plane: SupportPlane, height_m: float, objects: Sequence[TrackedObject], bearer: Bearer | None
) -> Surface:
    center = plane.extent.mean(0) if len(plane.extent) else -plane.offset * plane.normal
    # twice the area of a polygon in space: the sum of the cross products of successive corners, along the normal
    products = np.cross(plane.extent, np.roll(plane.extent, -1, axis=0)) if len(plane.extent) else np.zeros((1, 3))
    area = 0.5 * abs(float(products.sum(axis=0) @ plane.normal))
    labels = tuple(item.label for item in objects if item.plane == k)
    furniture, name = (None, None) if bearer is None else (bearer.label, bearer.name)
    measured = vector(center), vector(plane.normal), round(height_m, 4), round(area, 4)
    return Surface(f"plane:{k}", *measured, labels, furniture, name)


def _node(branch: Branch, names: Mapping[int | str, str | None]) -> TreeNode:
    name = names.get(branch.of)
    height_m = None if branch.height_m is None else round(branch.height_m, 4)
    return TreeNode(branch.of, name, branch.kind, height_m, tuple(_node(child, names) for child in branch.children))
