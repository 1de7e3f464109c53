"""The map of a place, shared by threads: lists that are rebuilt after a change, and slow results that are kept.

Slow results (relations, up, vectors) are computed from a second opening of the place, so that other queries do not wait
for them.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Generic, TypeVar

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.results import Relation
from cuboid.method.relations import find_relations
from cuboid.method.text_search import TextModel
from cuboid.results.files.queries import saved_relations
from cuboid.services.queries.snapshot import Snapshot
from cuboid.services.queries.sources import Source, SupportingFurniture

T = TypeVar("T")
# A slow result is computed again after the map has changed, but not before this many times its computing time has
# passed. So computing takes at most a tenth of the time.
REST = 10.0
# With more objects than this, relations are computed only among the objects near those of the query.
SMALL = 300


class SharedMap:
    """The map of a source, from any thread; the methods except `now` must be called without the lock.

    Parameters
    ----------
    source : Source
    model : TextModel or None
        The image-text model of the vectors.

    Attributes
    ----------
    lock, aside_lock : Lock
        Held while `source.map` and `source.aside` are used.
    """

    def __init__(self, source: Source, model: TextModel | None) -> None:
        self.source, self.model = source, model
        self.lock, self.aside_lock = threading.Lock(), threading.Lock()
        self._objects: _Kept[Snapshot] = _Kept(lambda: Snapshot(source))
        self._relations: _Kept[Mapping[int, Sequence[Relation]]] = _Kept(self._find_relations)
        self._up: _Kept[Float64Array | None] = _Kept(lambda: source.aside.up)
        self._furniture: _Kept[Sequence[SupportingFurniture]] = _Kept(lambda: source.furniture())
        self._colors: _Kept[Mapping[int, tuple[str, ...]]] = _Kept(lambda: source.colors())
        self._vectors: _Kept[Mapping[int, Float32Array]] = _Kept(self._find_vectors)

    def now(self) -> Snapshot:
        """Return the present objects; the caller holds the lock."""
        return self._objects.get(self.source.version())

    def snapshot(self) -> Snapshot:
        """Return the present objects."""
        with self.lock:
            return self.now()

    def up(self) -> Float64Array | None:
        """Return up in the world, (3,)."""
        return self._found_aside(self._up)

    def furniture(self) -> Sequence[SupportingFurniture]:
        """Return the furniture that bears supporting planes."""
        return self._found_aside(self._furniture)

    def colors(self) -> Mapping[int, tuple[str, ...]]:
        """Return the color words of the objects' points, by label; an object without points has none."""
        return self._found_aside(self._colors)

    def vectors(self) -> Mapping[int, Float32Array]:
        """Return the vectors of the objects, by label; raise InputError without a model."""
        return self._found_aside(self._vectors)

    def relations(self) -> Mapping[int, Sequence[Relation]]:
        """Return the relations of all present objects, by label."""
        return self._found_aside(self._relations)

    def relations_to(self, targets: Sequence[str]) -> Mapping[int, Sequence[Relation]]:
        """Return the relations of the objects around the named ones.

        In a large map, only the relations around the named objects are computed, unless all relations are available.
        """
        with self.lock:
            now, version, planes = self.now(), self.source.version(), tuple(self.source.map.planes)
            ends = [item for to in targets for item in now.called(to, gone=True)]
            near = now.near(ends)
        all_current = self._relations.current(version, fresh=True)
        if all_current or len(near) == len(now.living) or len(now.living) <= SMALL or not targets:
            return self.relations()
        return saved_relations(near) or find_relations(near, planes, self.up(), ())

    def _found_aside(self, kept: _Kept[T]) -> T:
        with self.lock:
            version = self.source.version()
        current = kept.current(version)
        if current:
            return current[0]
        with self.aside_lock:
            return kept.get(version)

    def _find_relations(self) -> Mapping[int, Sequence[Relation]]:
        with self.lock:
            living, planes = self.now().living, tuple(self.source.map.planes)
        return saved_relations(living) or find_relations(living, planes, self.source.aside.up, self.source.walls())

    def _find_vectors(self) -> Mapping[int, Float32Array]:
        if self.model is None:
            raise InputError("text: this place was opened without an image-text model")
        return self.source.vectors(self.model)


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
