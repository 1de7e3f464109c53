"""The objects of a place at one moment, and their properties that queries use."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from functools import cache

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.results import TrackedObject
from cuboid.ground.core.values import ObjectStatus
from cuboid.services.queries.filters import LIKELY, label_of, not_present
from cuboid.services.queries.likeness import color_fractions, colors_of
from cuboid.services.queries.sources import Source

# Distance within which objects are near to each other, metres: the relations on, in and beside depend on objects within
# `BESIDE_M`, and on the supports of these.
RELATED_M = 0.4

Mask = npt.NDArray[np.bool_]


class Snapshot:
    """The objects of a place at one moment, and arrays of those that are or were there.

    Parameters
    ----------
    source : Source

    Attributes
    ----------
    living : list of TrackedObject
        The present objects.
    known : list of (TrackedObject, str)
        The N present and gone objects, with their states.
    labels : (N,) int64
        Their labels.
    present : (N,) bool
    names : mapping of int to str or None
        The names of the present objects, by label.
    """

    def __init__(self, source: Source) -> None:
        every = source.objects()
        self.living = [item for item, state in every if state == "present"]
        self.known = [(item, state) for item, state in every if state in ("present", "gone")]
        self.labels = np.array([item.label for item, _ in self.known], np.int64)
        self.present = np.array([state == "present" for _, state in self.known], bool)
        count = len(self.known)
        self._size = np.array([item.box.size for item, _ in self.known]).reshape(count, 3)
        self._center = np.array([item.box.center for item, _ in self.known]).reshape(count, 3)
        self._rotation = np.array([item.box.rotation for item, _ in self.known]).reshape(count, 3, 3)
        self._by_label = {item.label: (item, state) for item, state in every}
        self._survivor = {old: item.label for item, state in every if state != "merged" for old in item.merged_labels}
        self.names: Mapping[int, str | None] = {item.label: item.name for item in self.living}
        self._called: dict[str, list[TrackedObject]] = defaultdict(list)
        for item in self.living:
            for name in names_of(item):
                self._called[name].append(item)

    def find(self, label: int) -> tuple[TrackedObject, ObjectStatus]:
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
            raise not_present(label_or_name)
        return found

    def is_called(self, label_or_name: str) -> bool:
        """Return whether a present object has a label or a name."""
        label = label_of(label_or_name)
        return label_or_name.strip().lower() in self._called if label is None else label in self.names

    def near(self, items: Sequence[TrackedObject]) -> list[TrackedObject]:
        """Return the present objects whose boxes are near the given objects, these included."""
        near = np.zeros(len(self.known), bool)
        for item in items:
            near |= self.distances_m(item.box.center) <= RELATED_M + float(np.linalg.norm(item.box.size)) / 2.0
        return [self.known[k][0] for k in np.flatnonzero(near & self.present)]

    def mask(self, holds: Callable[[TrackedObject], bool]) -> Mask:
        """Return for each known object, (N,), whether a condition holds."""
        return np.array([holds(item) for item, _ in self.known], bool)

    def longest_m(self) -> Float64Array:
        """Return the longest side of each box, metres, (N,)."""
        return np.asarray(self._size.max(1, initial=0.0))

    def placed(self, side: str, other: TrackedObject, camera: Float64Array, up: Float64Array) -> Mask:
        """Return the present objects on a side of another one, (N,), as a camera at (3,) in the world saw it.

        Each side is a quarter of the plan: what is farther behind than it is left counts as behind.
        """
        ahead = other.box.center - camera
        ahead = ahead - (ahead @ up) * up
        ahead /= max(float(np.linalg.norm(ahead)), 1e-9)
        away = self._center - other.box.center
        behind, right = away @ ahead, away @ np.cross(ahead, up)
        along = {"left of": -right, "right of": right, "behind": behind, "in front of": -behind}[side]
        across = behind if side in ("left of", "right of") else right
        outside = along > other.box.size[:2].min() / 2.0  # what lies in it or on it is on no side
        return np.asarray(outside & (along >= np.abs(across)) & self.present & (self.labels != other.label))

    def first(self, order: str, rows: npt.NDArray[np.intp], distances_m: Float64Array | None) -> npt.NDArray[np.intp]:
        """Return the first one of some objects (their indices) in an order, one of `ORDERS`; none of none."""
        if not len(rows):
            return rows
        if order == "nearest" and distances_m is not None:
            return rows[[int(np.argmin(distances_m[rows]))]]
        height = np.abs(self._rotation[:, 2, :] * self._size).sum(1) if order in ("tallest", "lowest") else None
        value = self._size.prod(1) if height is None else height
        value = -value if order in ("largest", "tallest") else value
        return rows[[int(np.argmin(value[rows]))]]

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
def colors_of_mean(mean_rgb: bytes) -> tuple[str, ...]:
    """Return the color word of a mean color, given as the bytes of a (3,) float64; no word if it is not known."""
    if np.isnan(np.frombuffer(mean_rgb, np.float64)).any():
        return ()
    rgb = np.clip(np.frombuffer(mean_rgb, np.float64).round(), 0, 255).astype(np.uint8)
    return colors_of(color_fractions(rgb[None]))
