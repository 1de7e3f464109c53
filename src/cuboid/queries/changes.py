"""Changes of a map: found by comparing its objects with those before, or told by a run; kept in a bounded list."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from cuboid.core.frame import Float64Array
from cuboid.core.results import ObjectEvent, TrackedObject
from cuboid.core.tolerances import DRIFT_M
from cuboid.queries.answers import MapChange
from cuboid.queries.sources import vector

# The latest changes that are kept, for clients that ask for those after a number.
KEPT = 10_000
# An object has moved when the middle of its box is this far, metres, from where it was said to be: boxes grow and
# shift by less while more of an object is seen.
MOVED_M = 2.0 * DRIFT_M


class ChangeLog:
    """The latest changes of a map, numbered from 1; those that listen are told of each."""

    def __init__(self) -> None:
        self._known: dict[int, TrackedObject] = {}
        self._at: dict[int, Float64Array] = {}
        self._began = False
        self._lock = threading.Lock()
        self._kept: deque[MapChange] = deque(maxlen=KEPT)
        self._listeners: list[Callable[[Sequence[MapChange]], None]] = []
        self.last = 0

    def listen(self, listener: Callable[[Sequence[MapChange]], None]) -> Callable[[], None]:
        """Call a function with all changes from now on, from any thread; return what ends that."""
        with self._lock:
            self._listeners.append(listener)
        return lambda: self._listeners.remove(listener)

    def after(self, number: int) -> list[MapChange]:
        """Return the changes after the one of this number that are still kept."""
        with self._lock:
            return [one for one in self._kept if one.number > number]

    def update(self, objects: Iterable[TrackedObject]) -> None:
        """Compare the objects that are there with those before, and note what changed; the first time nothing has."""
        now = {item.label: item for item in objects}
        found = self._found(now) if self._began else []
        # Where an object was said to be stays until it has moved: it may drift in small steps.
        moved = {one.label for one in found if one.change == "moved"}
        self._at = {
            label: item.box.center if label in moved else self._at.get(label, item.box.center)
            for label, item in now.items()
        }
        self._known, self._began = now, True
        self._tell(found)

    def add_events(self, events: Iterable[ObjectEvent]) -> None:
        """Note the events that a run told."""
        self._tell(
            [
                MapChange(
                    0,
                    one.event,
                    one.label,
                    self._name(one.label),
                    None if one.from_m is None else vector(one.from_m),
                    None if one.to_m is None else vector(one.to_m),
                )
                for one in events
            ]
        )

    def _name(self, label: int) -> str | None:
        return self._known[label].name if label in self._known else None

    def _found(self, now: dict[int, TrackedObject]) -> list[MapChange]:
        into = {old: item.label for item in now.values() for old in item.merged_labels}
        found = []
        for label, item in now.items():
            old = self._known.get(label)
            if old is item:
                continue
            at = vector(item.box.center)
            if old is None:
                found.append(MapChange(0, "confirmed", label, item.name, None, at))
                continue
            if np.linalg.norm(item.box.center - self._at[label]) > MOVED_M:
                found.append(MapChange(0, "moved", label, item.name, vector(self._at[label]), at))
            if item.name != old.name:
                found.append(MapChange(0, "renamed", label, item.name, None, at))
        for label, old in self._known.items():
            if label in into and label not in now:
                found.append(MapChange(0, "merged", label, old.name, vector(self._at[label]), None, into[label]))
            elif label not in now:
                found.append(MapChange(0, "gone", label, old.name, vector(self._at[label]), None))
        return found

    def _tell(self, found: Iterable[MapChange]) -> None:
        with self._lock:
            numbered = [replace(one, number=self.last + k) for k, one in enumerate(found, 1)]
            self.last += len(numbered)
            self._kept.extend(numbered)
            listeners = list(self._listeners)
        if numbered:
            for listener in listeners:
                listener(numbered)
