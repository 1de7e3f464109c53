"""Changes of a map, in a bounded list: found by comparing old and new objects, or reported by a run."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.results import ObjectEvent, TrackedObject
from cuboid.ground.core.tolerances import DRIFT_M
from cuboid.services.queries.answers import MapChange
from cuboid.services.queries.looking import vector

# Number of the latest changes that are kept, for clients that request the changes after a number.
KEPT_CHANGES = 10_000
# An object has moved when the centre of its box is this far, metres, from its last reported position: while more of an
# object is seen, its box grows and shifts by less.
MOVED_M = 2.0 * DRIFT_M


class ChangeLog:
    """The latest changes of a map, numbered from 1; listeners receive each of them."""

    def __init__(self) -> None:
        self._last_objects: dict[int, TrackedObject] = {}
        self._at: dict[int, Float64Array] = {}
        self._began = False
        self._lock = threading.Lock()
        self._kept: deque[MapChange] = deque(maxlen=KEPT_CHANGES)
        self._listeners: list[Callable[[Sequence[MapChange]], None]] = []
        self.last = 0

    def listen(self, listener: Callable[[Sequence[MapChange]], None]) -> Callable[[], None]:
        """Call a function with all later changes, from any thread; return a function that removes the listener."""
        with self._lock:
            self._listeners.append(listener)
        return lambda: self._listeners.remove(listener)

    def after(self, number: int) -> list[MapChange]:
        """Return the kept changes with larger numbers than the given one."""
        with self._lock:
            return [one for one in self._kept if one.number > number]

    def update(self, objects: Iterable[TrackedObject]) -> None:
        """Compare the present objects with the previous ones, and store the changes; the first call stores none."""
        now = {item.label: item for item in objects}
        found = self._found(now) if self._began else []
        # The reported position stays until the object has moved, since it may drift in small steps.
        moved = {one.label for one in found if one.change == "moved"}
        self._at = {
            label: item.box.center if label in moved else self._at.get(label, item.box.center)
            for label, item in now.items()
        }
        self._last_objects, self._began = now, True
        self._tell(found)

    def add_events(self, events: Iterable[ObjectEvent]) -> None:
        """Store the events that a run reports."""
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
        return self._last_objects[label].name if label in self._last_objects else None

    def _found(self, now: dict[int, TrackedObject]) -> list[MapChange]:
        into = {old: item.label for item in now.values() for old in item.merged_labels}
        found = []
        for label, item in now.items():
            old = self._last_objects.get(label)
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
        for label, old in self._last_objects.items():
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
