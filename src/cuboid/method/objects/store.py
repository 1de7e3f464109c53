"""The store of all objects: only it adds, labels, merges and retires them, and it keeps their boxes in a table."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.ground.core.frame import Float64Array
from cuboid.ground.core.limits import SAMPLE_POINTS
from cuboid.ground.core.state import Record
from cuboid.ground.core.tolerances import DRIFT_M
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.kernels.overlap import BATCH, bound, near
from cuboid.ground.geometry.overlap import overlap_min_matrix
from cuboid.method.heatmap.voxel_map import VoxelMap
from cuboid.method.objects.affinity import Affinity, AffinityState
from cuboid.method.objects.distances import points_near
from cuboid.method.objects.entry import MapObject, State, summed_counts
from cuboid.method.objects.naming import merged_evidence

# Two objects overlap in space if their boxes share this fraction of the smaller one, which two solids cannot.
SHARED_FRACTION = 0.5
# An object may lie in the hollow of another one that is at least this high, metres, if its box has at most this
# fraction of the other's volume. Bowls and plates, whose parts may look like objects, are lower.
HOLLOW_HEIGHT_M, HOLLOW_FRACTION = 0.1, 0.2


@dataclass(frozen=True, slots=True)
class ObjectStoreState(Record):
    """State of an `ObjectStore`.

    Attributes
    ----------
    objects : dict of int to MapObject
        The objects by number, with the retired ones that have a label.
    next_number : int
        Number of the next object.
    next_label : int
        Label of the next confirmed object.
    affinity : AffinityState
    boxes : (capacity, 15) float64
        A row per number: centre, size, rotation; NaN without a living object.
    """

    objects: dict[int, MapObject]
    next_number: int
    next_label: int
    affinity: AffinityState
    boxes: Float64Array


class ObjectStore:
    """All objects by number, with their affinities and boxes.

    Parameters
    ----------
    voxels : VoxelMap
        The map whose points store the numbers of their owners.

    Attributes
    ----------
    affinity : Affinity
    boxes : (capacity, 15) float64
        A row for each number, see `pack`; NaN without a living object.
    """

    NOT_SAVED = frozenset({"_voxels", "_confirmed", "_bounds", "_changed"})

    def __init__(self, voxels: VoxelMap) -> None:
        self._voxels = voxels
        self._objects: dict[int, MapObject] = {}
        self._confirmed: dict[int, MapObject] = {}
        self._next_number = self._next_label = 1
        self.affinity = Affinity()
        self.boxes: Float64Array = np.full((BATCH, 15), np.nan)
        # Bounds of batches of boxes, and the batches that have changed since these were computed.
        self._bounds: Float64Array | None = None
        self._changed: set[int] = set()

    def state(self) -> ObjectStoreState:
        """Return the current state; it shares the objects, so copy their attributes before the next update."""
        return ObjectStoreState(
            dict(self._objects), self._next_number, self._next_label, self.affinity.state(), self.boxes.copy()
        )

    @classmethod
    def from_state(cls, state: ObjectStoreState, voxels: VoxelMap) -> ObjectStore:
        """Return a store that continues from a state; the voxel map is already restored."""
        store = cls(voxels)
        store._objects, store._next_number, store._next_label = state.objects, state.next_number, state.next_label
        store._confirmed = {number: entry for number, entry in state.objects.items() if entry.confirmed}
        store.affinity, store.boxes = Affinity.from_state(state.affinity), state.boxes
        return store

    def __getitem__(self, number: int) -> MapObject:
        return self._objects[number]

    def __contains__(self, number: int) -> bool:
        return number in self._objects

    @property
    def numbers(self) -> int:
        """One more than the highest number given so far."""
        return self._next_number

    def boxes_of(self, entries: Sequence[MapObject]) -> Float64Array:
        """Return the boxes (N, 15) of living objects, see `pack`."""
        return self.boxes[[entry.number for entry in entries]]

    def overlapping(self, entries: Sequence[MapObject], others: Sequence[MapObject]) -> npt.NDArray[np.bool_]:
        """Return which living objects overlap in space, (N, M), by half of the smaller box or more.

        An object inside a far larger one must also share half of its points with it: otherwise the larger one is
        hollow, as a tote is.
        """
        found = np.asarray(overlap_min_matrix(self.boxes_of(entries), self.boxes_of(others)) >= SHARED_FRACTION)
        for i, j in zip(*np.nonzero(found), strict=True):
            found[i, j] = not _is_inside_hollow(entries[i], others[j])
        return found

    @property
    def bounds(self) -> Float64Array:
        """Bounds of the boxes of each batch, (M, 7): see `kernels.overlap.bound`."""
        batches = len(self.boxes) // BATCH
        if self._bounds is None or len(self._bounds) != batches:
            self._bounds, self._changed = np.zeros((batches, 7)), set(range(batches))
        for batch in self._changed:
            bound(self.boxes, batch, self._bounds)
        self._changed.clear()
        return self._bounds

    @property
    def labelled(self) -> int:
        """Number of living objects with a label."""
        return len(self._confirmed)

    def living(self) -> list[MapObject]:
        """Return all objects that are not retired, by number."""
        return [o for o in self._objects.values() if o.state is not State.RETIRED]

    def confirmed(self) -> list[MapObject]:
        """Return the living objects with a label, by label."""
        return sorted(self._confirmed.values(), key=lambda o: o.label)

    def ever_labelled(self) -> list[MapObject]:
        """Return all objects with a label, including retired ones, by label."""
        return sorted((o for o in self._objects.values() if o.label), key=lambda o: o.label)

    def begin_labels(self, first: int) -> None:
        """Set the smallest label for new objects."""
        self._next_label = max(self._next_label, first)

    def add(self, box: Box, frame: int, keyframe: int = 0) -> MapObject:
        """Add a new object and return it."""
        entry = MapObject(self._next_number, box, frame, frame, keyframe=keyframe)
        self._next_number += 1
        self._objects[entry.number] = entry
        if entry.number >= len(self.boxes):
            self.boxes = np.concatenate([self.boxes, np.full_like(self.boxes, np.nan)])
        self.place(entry, box)
        return entry

    def place(self, entry: MapObject, box: Box) -> None:
        """Set the box of an object."""
        entry.box = box
        if entry.state is not State.RETIRED:
            row = self.boxes[entry.number]
            row[:3], row[3:6], row[6:] = box.center, box.size, box.rotation.ravel()
            self._changed.add(entry.number // BATCH)

    def confirm(self, entry: MapObject) -> None:
        """Give an object its label."""
        entry.state, entry.label = State.CONFIRMED, self._next_label
        self._next_label += 1
        self._confirmed[entry.number] = entry

    def next_label(self) -> int:
        """Return a new label."""
        self._next_label += 1
        return self._next_label - 1

    def take_label(self, entry: MapObject, label: int, merged_labels: Iterable[int], first_frame: int) -> None:
        """Give a labelled object the label of the unread object that it is, too; the older label stays."""
        older, younger = sorted((entry.label, label))
        entry.merged_labels = sorted({*entry.merged_labels, *merged_labels, younger})
        entry.label, entry.first_frame = older, min(entry.first_frame, first_frame)

    def retire(self, entry: MapObject) -> None:
        """Retire an object: its label is kept and never reused; its points get no owner."""
        self.retire_all([entry])

    def retire_all(self, entries: Sequence[MapObject]) -> None:
        """Retire several objects; see `retire`."""
        self._voxels.stored.release([entry.number for entry in entries])
        for entry in entries:
            self._close(entry)
            if not entry.label:
                del self._objects[entry.number]

    def set_down(self, entry: MapObject, box: Box) -> None:
        """Reactivate a retired labelled object with another box: it was moved and is at rest again."""
        entry.state = State.CONFIRMED
        self._confirmed[entry.number] = entry
        entry.plane, entry.supports, entry.supports_plane, entry.holder = None, {}, False, 0
        entry.fitted, entry.moved = entry.sightings, True
        self.place(entry, box)

    def adopt(self, entry: MapObject, old: MapObject) -> None:
        """Merge a retired object into a labelled one, because it was moved there; its older label stays."""
        entry.merged_labels = sorted({*entry.merged_labels, *old.merged_labels, entry.label})
        entry.label = old.label
        entry.first_frame = min(entry.first_frame, old.first_frame)
        entry.frames_seen += old.frames_seen
        del self._objects[old.number]

    def merge(self, first: MapObject, second: MapObject) -> tuple[MapObject, MapObject]:
        """Merge two objects: the older label stays, the younger one is recorded. Return (kept, gone)."""
        kept, gone = sorted((first, second), key=lambda o: (o.label or np.inf, o.number))
        kept.merged_labels = sorted({*kept.merged_labels, *gone.merged_labels, *([gone.label] if gone.label else [])})
        kept.first_frame = min(kept.first_frame, gone.first_frame)
        kept.last_frame = max(kept.last_frame, gone.last_frame)
        kept.frames_seen = max(kept.frames_seen, gone.frames_seen)
        kept.sightings = max(kept.sightings, gone.sightings)
        kept.log_odds = max(kept.log_odds, gone.log_odds)
        kept.outline = kept.outline + gone.outline
        kept.supports = summed_counts(kept.supports, gone.supports)
        kept.name_log_odds = merged_evidence(kept.name_log_odds, gone.name_log_odds)
        kept.views = np.vstack([kept.views, gone.views])
        kept.fitted = 0
        self._voxels.stored.transfer(gone.number, kept.number)
        self.affinity.transfer(gone.number, kept.number)
        self._close(gone)
        del self._objects[gone.number]
        gone.taken_by = kept
        return kept, gone

    def _close(self, entry: MapObject) -> None:
        entry.state = State.RETIRED
        self.boxes[entry.number] = np.nan
        self._changed.add(entry.number // BATCH)
        self._confirmed.pop(entry.number, None)
        self.affinity.remove(entry.number)

    def near(self, box: Box, gap_m: float) -> list[MapObject]:
        """Return the living objects whose bounding spheres come within a gap of a box's, by number."""
        boxes, found = self.boxes[: self.numbers], np.empty(self.numbers, np.int64)
        count = near(boxes, self.bounds, box.center, 0.5 * math.sqrt(box.size @ box.size), gap_m, found)
        return [self._objects[k] for k in found[:count].tolist()]

    def neighbours(self, entry: MapObject) -> list[MapObject]:
        """Return the other living objects whose bounding spheres overlap an object's, by number."""
        return [o for o in self.near(entry.box, 0.0) if o is not entry]

    def all_of(self, numbers: Iterable[int]) -> list[MapObject]:
        """Return the living ones among some objects, by number."""
        found = map(self._objects.get, sorted(set(numbers)))
        return [o for o in found if o is not None and o.state is not State.RETIRED]


def _is_inside_hollow(first: MapObject, second: MapObject) -> bool:
    """Return whether the smaller one of two objects lies in the hollow of a far larger one."""
    small, large = sorted((first, second), key=lambda entry: entry.box.volume)
    if large.box.size[2] < HOLLOW_HEIGHT_M or small.box.volume > HOLLOW_FRACTION * large.box.volume:
        return False
    if not (len(small.points) and len(large.points)):
        return False
    points = small.points[:: 1 + len(small.points) // SAMPLE_POINTS]
    enough = math.ceil(SHARED_FRACTION * len(points))
    return points_near(points, large.points, DRIFT_M, enough) < enough
