"""The objects of a place at one moment, and their properties that queries use."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from datetime import datetime
from functools import cache

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import InputError, shown
from cuboid.ground.core.results import TrackedObject
from cuboid.services.queries.answers import State
from cuboid.services.queries.filters import LIKELY, Filters, label_of
from cuboid.services.queries.likeness import color_fractions, color_word
from cuboid.services.queries.sources import Source

# Distance within which objects are near to each other, metres: the relations on, in and beside depend on objects within
# `BESIDE_M`, and on the supports of these.
NEAR_M = 0.3


class Snapshot:
    """The objects of a place at one moment, and arrays of the present ones.

    Parameters
    ----------
    source : Source

    Attributes
    ----------
    all : list of (TrackedObject, str)
        All objects with their states.
    living : list of TrackedObject
        The N present objects.
    labels : (N,) int64
        Their labels.
    names : mapping of int to str or None
        Their names, by label.
    """

    def __init__(self, source: Source) -> None:
        self._source = source
        self.all = source.objects()
        self.living = [item for item, state in self.all if state == "present"]
        self.labels = np.array([item.label for item in self.living], np.int64)
        count = len(self.living)
        self._size = np.array([item.box.size for item in self.living]).reshape(count, 3)
        self._center = np.array([item.box.center for item in self.living]).reshape(count, 3)
        self._rotation = np.array([item.box.rotation for item in self.living]).reshape(count, 3, 3)
        self._score = np.array([item.score for item in self.living])
        self._by_label = {item.label: (item, state) for item, state in self.all}
        self._survivor = {
            old: item.label for item, state in self.all if state != "merged" for old in item.merged_labels
        }
        self.names: Mapping[int, str | None] = {item.label: item.name for item in self.living}
        self._called: dict[str, list[TrackedObject]] = defaultdict(list)
        for item in self.living:
            for name in names_of(item):
                self._called[name].append(item)

    def find(self, label: int) -> tuple[TrackedObject, State]:
        """Return an object and its state, by its label or by a merged label; raises InputError if there is none."""
        found = self._by_label.get(self._survivor.get(label, label))
        if found is None:
            raise InputError(f"no object has the label {label}")
        return found

    def called(self, label_or_name: str, *, gone: bool = False) -> list[TrackedObject]:
        """Return the present objects with a label or a name; with `gone`, former objects with the label too.

        Raises
        ------
        InputError
            There is no such object.
        """
        label = label_of(label_or_name)
        if label is None:
            found = self._called.get(label_or_name.strip().lower(), [])
        else:
            item, state = self._by_label.get(self._survivor.get(label, label), (None, "gone"))
            found = [] if item is None or not (gone or state == "present") else [item]
        if not found:
            raise InputError(f"no present object has the label or the name {shown(label_or_name)}")
        return found

    def is_called(self, label_or_name: str) -> bool:
        """Return whether a present object has a label or a name."""
        label = label_of(label_or_name)
        return label_or_name.strip().lower() in self._called if label is None else label in self.labels

    def near(self, items: Sequence[TrackedObject]) -> list[TrackedObject]:
        """Return the present objects whose boxes are near the given objects, these included."""
        near = np.zeros(len(self.living), bool)
        for item in items:
            near |= self.distances_m(item.box.center) <= NEAR_M + float(np.linalg.norm(item.box.size)) / 2.0
        return [self.living[k] for k in np.flatnonzero(near)]

    def passing(self, filters: Filters) -> npt.NDArray[np.bool_]:
        """Return for each present object, (N,), whether it passes the filters that depend on one object alone."""
        kept = np.ones(len(self.living), bool)
        if filters.size_m is not None and len(kept):
            longest = self._size.max(1)
            kept &= (longest >= filters.size_m[0]) & (longest <= filters.size_m[1])
        if filters.min_score is not None:
            kept &= self._score >= filters.min_score
        if filters.name is not None:
            called = [item.label for item in self._called.get(filters.name.strip().lower(), [])]
            kept &= np.isin(self.labels, called)
        if filters.color is not None:
            kept &= np.array([color_of_mean(item.mean_color.tobytes()) == filters.color for item in self.living], bool)
        if filters.since is not None or filters.until is not None:
            kept &= np.array([self._was_seen(item, filters.since, filters.until) for item in self.living], bool)
        return kept

    def _was_seen(self, item: TrackedObject, since: datetime | None, until: datetime | None) -> bool:
        seen = self._source.last_seen(item).time
        if seen is None:
            raise InputError("since, until: this recording has no calendar times")
        moment = datetime.fromisoformat(seen)
        return (since is None or moment >= since) and (until is None or moment < until)

    def distances_m(self, point: Float64Array) -> Float64Array:
        """Return the distance of a point (3,) from each box, metres, (N,); 0 inside."""
        local = np.abs(np.einsum("ni,nij->nj", point - self._center, self._rotation))
        return np.asarray(np.linalg.norm(np.maximum(local - self._size / 2.0, 0.0), axis=1))


def names_of(item: TrackedObject) -> set[str]:
    """Return the names of an object in lower case: its name, and its likely classes."""
    given = set() if item.name is None else {item.name.lower()}
    return given | {name.lower() for name, score in item.names if score >= LIKELY}


def is_called(item: TrackedObject, label_or_name: str) -> bool:
    """Return whether an object has a label, or had it, or has a name."""
    label = label_of(label_or_name)
    return (
        label_or_name.strip().lower() in names_of(item) if label is None else label in (item.label, *item.merged_labels)
    )


@cache
def color_of_mean(mean_rgb: bytes) -> str | None:
    """Return the color word of a mean color, given as the bytes of a (3,) float64."""
    rgb = np.clip(np.frombuffer(mean_rgb, np.float64).round(), 0, 255).astype(np.uint8)
    return color_word(color_fractions(rgb[None]))
