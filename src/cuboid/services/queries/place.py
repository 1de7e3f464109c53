"""Queries of one place: the layer below `cuboid find`, the HTTP server and the MCP server."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from threading import Lock

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import InputError, shown
from cuboid.ground.core.results import Relation, SupportPlane, TrackedObject
from cuboid.method.relations import Branch, SurfaceKind, place_tree, surface_kinds
from cuboid.method.relations.levels import plane_area_m2
from cuboid.method.relations.tree import number_of, plane_heights_m
from cuboid.method.shapes import ObjectMesh
from cuboid.method.text_search import TextModel, TextQuery
from cuboid.results.files.queries import PointCloud
from cuboid.services.queries.answers import About, Answer, FoundObject, FreePlace, History, Surface, TreeNode
from cuboid.services.queries.changes import ChangeLog
from cuboid.services.queries.filters import LIMIT, Filters, is_surface
from cuboid.services.queries.free import free_place
from cuboid.services.queries.looking import vector
from cuboid.services.queries.parameters import text_query
from cuboid.services.queries.place_objects import PlaceObjects, answer_of
from cuboid.services.queries.questions import answer, counts_without, find, last_seen, no_such_name, understood_with
from cuboid.services.queries.shared_map import SharedMap
from cuboid.services.queries.snapshot import Snapshot
from cuboid.services.queries.sources import Source, SupportingFurniture
from cuboid.services.queries.standing import standing_in_words, surface_words
from cuboid.services.queries.words import place

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
        self._shared = SharedMap(source, model)
        self.changes = ChangeLog()
        self._compared: Snapshot | None = None
        self._page: tuple[object, str | None] | None = None  # the 3D page, and the version of the map in it
        self._page_lock = Lock()  # building a page takes seconds; other questions must not wait
        self.refresh()

    def refresh(self) -> None:
        """Compare the map with its previous state, and record the changes; servers call it at intervals."""
        with self._shared.lock:
            now = self._shared.now()
            if now is not self._compared:
                self.changes.update(now.living)
                self._compared = now

    def about(self) -> About:
        """Return title, kind and state of the place."""
        up = self._shared.up()
        with self._shared.lock:
            found = self._shared.now().living
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
        return find(self._objects_for(filters), filters)

    def object(self, label: int) -> FoundObject:
        """Return one object with its relations, by its label or by a label that was merged into it.

        Raises
        ------
        InputError
            No object has, or had, the label.
        """
        relations, colors = self._shared.relations_to([str(self._item(label).label)]), self._shared.colors()
        with self._shared.lock:
            now = self._shared.now()
            item, state = now.find(label)
            return answer_of(self._source, now, item, state, colors, relations if state == "present" else None)

    def last_seen(self, label_or_name: str) -> list[FoundObject]:
        """Return the last sightings of objects with a label or name, gone objects included, the latest first.

        Raises
        ------
        InputError
            No object has, or had, the label or name.
        """
        return last_seen(PlaceObjects(self._shared), label_or_name)

    def names(self) -> list[str]:
        """Return the names and likely classes that objects have, in lower case."""
        return PlaceObjects(self._shared).names()

    def no_such_name(self, name: str | None) -> str | None:
        """Return why no object is found by a name, in one line; None if that is not the reason."""
        return no_such_name(PlaceObjects(self._shared), name)

    def ask(self, question: str, limit: int = LIMIT, also: Filters | None = None) -> Answer:
        """Return the answer to a question in English, such as "the blue bin beside the chair".

        Parameters
        ----------
        question : str
            In the grammar of `cuboid.services.queries.english`; an empty one has no conditions.
        limit : int
            Maximum number of objects.
        also : Filters, optional
            Further conditions; their limit does not count.

        Raises
        ------
        InputError
            A part of the question is not understood; or as `find` and `last_seen`.
        """
        also = replace(also or Filters(), limit=limit)
        asked = understood_with(self._objects_for, question, also)
        found, note = answer(self._objects_for, asked, also)
        return Answer(asked.said, tuple(found), note)

    def without(self, question: str, also: Filters) -> tuple[Filters, Mapping[str, int] | None]:
        """Return all conditions of a question, and how many objects there are without each, by field of the filters.

        There are no such numbers, None, for a question of where one object is.
        """
        asked = understood_with(self._objects_for, question, also)
        return asked.filters, counts_without(self._objects_for, asked.filters) if asked.last is None else None

    def _objects_for(self, filters: Filters) -> PlaceObjects:
        return PlaceObjects(self._shared, [to for _, to in filters.related()])

    def history(self, label: int, limit: int = SIGHTINGS) -> History:
        """Return the sightings of an object, and its past relations; raises the errors of `object`."""
        with self._shared.lock:
            item, _ = self._shared.now().find(label)
            seen = self._source.sightings(item)
            chosen = np.unique(np.linspace(0, len(seen) - 1, min(max(limit, 1), len(seen))).round().astype(int))
            past = self._source.past_relations(item)
            shown = tuple(seen[k] for k in chosen.tolist())
            return History(item.label, item.merged_labels, len(seen), shown, tuple(past))

    def surfaces(self) -> list[Surface]:
        """Return the supporting planes."""
        up, pieces, relations = self._shared.up(), _by_plane(self._shared.furniture()), self._shared.relations()
        with self._shared.lock:
            planes = tuple(self._source.map.planes)
            heights, kinds = plane_heights_m(planes, up), surface_kinds(planes, up)
            return [
                _surface(k, plane, heights[k], kinds[k], relations, pieces.get(k)) for k, plane in enumerate(planes)
            ]

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
        with self._shared.lock:
            planes, now = self._source.map.planes, self._shared.now()
            if not (surface.startswith("plane:") and is_surface(surface) and number_of(surface) < len(planes)):
                raise InputError(f"expected a surface, plane:0 to plane:{len(planes) - 1}, got {shown(surface)}")
            plane, boxes = planes[number_of(surface)], [item.box for item in now.living]
            return free_place(surface, plane, boxes, (length_m, width_m, height_m), self._near(now, near))

    def surface_words(self) -> dict[str, str]:
        """Return the supporting planes in words, such as "a table, 0.72 m high", by "plane:k"."""
        up, pieces = self._shared.up(), _by_plane(self._shared.furniture())
        with self._shared.lock:
            return surface_words(tuple(self._source.map.planes), up, pieces)

    def standing_on(self, labels: Sequence[int]) -> dict[int, str]:
        """Return on or in what objects are, in words, by label; objects for which that is not known are omitted."""
        if not labels:
            return {}
        relations, surfaces = self._shared.relations_to([str(label) for label in labels]), self.surface_words()
        names = self._shared.snapshot().names
        found = {label: standing_in_words(relations.get(label, ()), surfaces, names) for label in labels}
        return {label: words for label, words in found.items() if words is not None}

    def page(self) -> str | None:
        """Return the 3D page of the place, as HTML; None during a run."""
        with self._shared.lock:
            version = self._source.version()
        with self._page_lock:
            if self._page is None or self._page[0] != version:
                self._page = version, self._source.page()
            return self._page[1]

    def tree(self) -> tuple[TreeNode, ...]:
        """Return the tree of the place: surfaces, the objects on them, and the objects on and in those."""
        relations, up = self._shared.relations(), self._shared.up()
        pieces = _by_plane(self._shared.furniture())
        with self._shared.lock:
            now = self._shared.now()
            found = place_tree(now.living, relations, self._source.map.planes, up)
            names: dict[int | str, str | None] = {f"plane:{k}": piece.name for k, piece in pieces.items()}
            names |= dict(now.names.items())
            return tuple(_node(branch, names) for branch in found)

    def picture(self, label: int, *, last: bool = False) -> bytes | None:
        """Return the best picture of an object, or that of its last sighting, JPEG; None if there is none.

        Raises the errors of `object`.
        """
        item = self._item(label)
        with self._shared.aside_lock:
            found = self._source.last_picture(item) if last else None
            return found or self._source.picture(item)

    def cloud(self, label: int) -> PointCloud:
        """Return the points of a present object; raises InputError for other objects."""
        label = self._item(label).label
        with self._shared.aside_lock:
            return self._source.aside.cloud(label)

    def mesh(self, label: int, *, close: bool = False, complete: bool = False) -> ObjectMesh:
        """Return the surface of an object, as `MapQueries.mesh` does."""
        label = self._item(label).label
        with self._shared.aside_lock:
            return self._source.aside.mesh(label, close=close, complete=complete)

    def _item(self, label: int) -> TrackedObject:
        with self._shared.lock:
            return self._shared.now().find(label)[0]

    def _near(self, now: Snapshot, near: str | None) -> Float64Array | None:
        if near is None:
            return None
        if "," in near:
            try:
                return np.array(place(near))
            except ValueError as error:
                raise InputError(f"near: {error}") from None
        return np.asarray(now.called(near)[0].box.center)


def _by_plane(pieces: Sequence[SupportingFurniture]) -> dict[int, SupportingFurniture]:
    """Return the furniture by the planes that it bears; of several labels of a piece the oldest."""
    oldest_last = sorted(pieces, key=lambda piece: piece.label, reverse=True)
    return {k: piece for piece in oldest_last for k in piece.planes}


def _surface(
    k: int,
    plane: SupportPlane,
    height_m: float,
    kind: SurfaceKind | None,
    relations: Mapping[int, Sequence[Relation]],
    piece: SupportingFurniture | None,
) -> Surface:
    center = plane.extent.mean(0) if len(plane.extent) else -plane.offset * plane.normal
    to = f"plane:{k}"
    labels = tuple(
        label for label, found in relations.items() if any(one.kind == "on" and one.to == to for one in found)
    )
    furniture, name = (None, None) if piece is None else (piece.label, piece.name)
    measured = vector(center), vector(plane.normal), round(height_m, 4), round(plane_area_m2(plane), 4)
    return Surface(to, *measured, labels, furniture, name, kind)


def _node(branch: Branch, names: Mapping[int | str, str | None]) -> TreeNode:
    name = names.get(branch.of)
    height_m = None if branch.height_m is None else round(branch.height_m, 4)
    return TreeNode(branch.of, name, branch.kind, height_m, tuple(_node(child, names) for child in branch.children))
