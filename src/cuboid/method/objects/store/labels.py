"""The life of a label: a candidate is confirmed, retired, moved, merged, or takes over the label of another object."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.state import Record
from cuboid.ground.geometry.box import Box
from cuboid.method.heatmap.voxel_map import VoxelMap
from cuboid.method.objects.affinity import Affinity, AffinityState
from cuboid.method.objects.entry import (
    MapObject,
    ObjectRecord,
    ObjectWithoutDepth,
    State,
    summed_counts,
    with_direction,
)
from cuboid.method.objects.store.boxes import BoxTable
from cuboid.method.objects.store.evidence import limit_sightings
from cuboid.method.objects.store.without_depth import EvidenceWithoutDepth

# The sightings of an object before it was moved have at most this weight: its box is soon fitted at its new place.
MOVED_SIGHTINGS = 1.0


@dataclass(frozen=True, slots=True)
class ObjectStoreState(Record):
    """State of an `ObjectStore`, except for the objects without depth.

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


class ObjectStore(EvidenceWithoutDepth):
    """All objects by number, with or without depth, and all changes of them.

    A label belongs to one object at a time and is never given twice. When two objects turn out to be one, the older
    label stays, and the younger one is recorded in `merged_labels`.

    Parameters
    ----------
    voxels : VoxelMap
        The map whose points store the numbers of their owners.
    """

    NOT_SAVED = frozenset(
        {
            *("_voxels", "_confirmed"),
            # The state of the tracker contains the objects without depth.
            *("_without_depth", "_next_number_without_depth"),
        }
    )

    def __init__(self, voxels: VoxelMap) -> None:
        super().__init__(voxels)
        self._next_number_without_depth = 1

    # --- state -----------------------------------------------------------------------------------------------------

    def state(self) -> ObjectStoreState:
        """Return the current state; it shares the objects, so copy their attributes before the next update."""
        return ObjectStoreState(
            dict(self._objects), self._next_number, self._next_label, self.affinity.state(), self.boxes.copy()
        )

    def state_without_depth(self) -> tuple[ObjectWithoutDepth, ...]:
        """Return copies of the objects without depth; later updates do not change them."""
        return tuple([copy(entry) for entry in self.without_depth()])

    @classmethod
    def from_state(cls, state: ObjectStoreState, voxels: VoxelMap) -> ObjectStore:
        """Return a store that continues from a state; the voxel map is already restored."""
        store = cls(voxels)
        store._objects, store._next_number, store._next_label = state.objects, state.next_number, state.next_label
        store._confirmed = {number: entry for number, entry in state.objects.items() if entry.confirmed}
        store.affinity, store._boxes = Affinity.from_state(state.affinity), BoxTable(state.boxes)
        return store

    def restore_without_depth(self, entries: Sequence[ObjectWithoutDepth]) -> None:
        """Continue with the objects without depth of a state."""
        self._without_depth = {entry.number: entry for entry in entries}
        self._next_number_without_depth = 1 + max(self._without_depth, default=0)

    # --- candidate -------------------------------------------------------------------------------------------------

    def add(self, box: Box, frame: int, keyframe: int = 0) -> MapObject:
        """Add a candidate with depth and return it; its number is higher than all numbers before."""
        entry = MapObject(self._next_number, frame, frame, box, keyframe=keyframe)
        self._next_number += 1
        self._objects[entry.number] = entry
        self.place(entry, box)
        return entry

    def add_without_depth(
        self, information: Float64Array, vector: Float64Array, frame: int, *, by_regions: bool = False
    ) -> ObjectWithoutDepth:
        """Add a candidate without depth at a position, as information matrix (3, 3) and vector (3,), and return it."""
        entry = ObjectWithoutDepth(
            self._next_number_without_depth, frame, frame, information, vector, by_regions=by_regions
        )
        self._next_number_without_depth += 1
        self._without_depth[entry.number] = entry
        return entry

    # --- confirmed -------------------------------------------------------------------------------------------------

    def begin_labels(self, first: int) -> None:
        """Set the smallest label for new objects; labels that were given stay reserved."""
        self._next_label = max(self._next_label, first)

    def next_label(self) -> int:
        """Return a label that nothing ever had; objects and furniture share the labels."""
        self._next_label += 1
        return self._next_label - 1

    def confirm(self, entry: ObjectRecord) -> None:
        """Give a candidate its label."""
        entry.state, entry.label = State.CONFIRMED, self.next_label()
        if isinstance(entry, MapObject):
            self._confirmed[entry.number] = entry

    def replace(self, numbers: Collection[int]) -> None:
        """Set which labelled objects of the map are reported as objects of regions instead."""
        for entry in self._confirmed.values():
            entry.replaced = entry.number in numbers

    # --- retired ---------------------------------------------------------------------------------------------------

    def retire(self, entry: ObjectRecord) -> None:
        """Retire an object: its label is kept and never reused; its points get no owner."""
        self.retire_all([entry])

    def retire_all(self, entries: Sequence[ObjectRecord]) -> None:
        """Retire several objects; see `retire`.

        The store forgets an object that has no label, or no depth.
        """
        self._voxels.stored.release([entry.number for entry in entries if isinstance(entry, MapObject)])
        for entry in entries:
            if isinstance(entry, MapObject):
                self._close(entry)
                if not entry.label:
                    del self._objects[entry.number]
            else:
                entry.state = State.RETIRED
                del self._without_depth[entry.number]

    def _close(self, entry: MapObject) -> None:
        entry.state = State.RETIRED
        self._boxes.clear(entry.number)
        self._confirmed.pop(entry.number, None)
        self.affinity.remove(entry.number)

    # --- moved -----------------------------------------------------------------------------------------------------

    def lift(self, entry: MapObject) -> None:
        """Retire an object that leaves its place, and remove its points from the map; they stay in its record."""
        self._voxels.stored.remove(entry.number)
        self.retire(entry)

    def move(self, entry: MapObject, box: Box, points: Float32Array) -> None:
        """Set the box and points (N, 3) of a retired object that is followed; it stays retired until `set_down`."""
        entry.points = points
        self.place(entry, box)

    def set_down(self, entry: MapObject, box: Box) -> None:
        """Confirm a retired labelled object again, with its label and another box: it was moved and is at rest again.

        All that it stood on is forgotten, sightings elsewhere count little, and the next fit waits for further ones.
        """
        limit_sightings(entry, MOVED_SIGHTINGS)
        entry.state, entry.moved, entry.doubt = State.CONFIRMED, True, 0.0
        self._confirmed[entry.number] = entry
        self.reset_support(entry)
        self.attach(entry, 0, supports_plane=False)
        self.postpone_fit(entry)
        self.set_box(entry, box)

    # --- merged ----------------------------------------------------------------------------------------------------

    def merge(self, first: MapObject, second: MapObject) -> tuple[MapObject, MapObject]:
        """Merge two objects with depth: points, affinities and evidence are united. Return (kept, gone).

        The one with the older label is kept, or else the older one; `survivor` of the other one leads to it.
        """
        kept, gone = sorted((first, second), key=lambda o: (o.label or np.inf, o.number))
        _unite_labels(kept, gone)
        kept.first_frame = min(kept.first_frame, gone.first_frame)
        kept.last_frame = max(kept.last_frame, gone.last_frame)
        kept.frames_seen = max(kept.frames_seen, gone.frames_seen)
        longer = max(kept, gone, key=lambda o: o.sightings)
        kept.sightings, kept.shown = longer.sightings, longer.shown
        kept.agreement, kept.compared = longer.agreement, longer.compared
        kept.whole_log_odds, kept.scored = longer.whole_log_odds, longer.scored
        kept.largest_px = max(kept.largest_px, gone.largest_px)
        kept.probability = max(kept.probability, gone.probability)
        for direction in gone.directions:
            kept.directions = with_direction(kept.directions, direction.astype(np.float64))
        kept.outline = kept.outline + gone.outline
        kept.supports = summed_counts(kept.supports, gone.supports)
        self.merge_names(kept, gone)
        kept.views = np.vstack([kept.views, gone.views])
        kept.fitted = kept.measured = 0
        self._voxels.stored.transfer(gone.number, kept.number)
        self.affinity.transfer(gone.number, kept.number)
        self._close(gone)
        del self._objects[gone.number]
        gone.merged_into = kept
        return kept, gone

    def merge_without_depth(
        self,
        kept: ObjectWithoutDepth,
        gone: ObjectWithoutDepth,
        united: tuple[Float64Array, Float64Array] | None = None,
    ) -> None:
        """Merge two objects without depth: evidence and names are united.

        Parameters
        ----------
        kept : ObjectWithoutDepth
            The one with the older label, or else the older one.
        gone : ObjectWithoutDepth
        united : ((3,) float64, (2,) float64), optional
            Vector and size of the rectangle of both; without it, both have the same one.
        """
        if united is not None:
            self._unite(kept, gone, *united)
        if not gone.partner:
            _unite_labels(kept, gone)
        self.merge_names(kept, gone)
        kept.log_odds, kept.hits = max(kept.log_odds, gone.log_odds), max(kept.hits, gone.hits)
        if gone.score > kept.score:
            kept.looks, kept.regions = gone.looks, gone.regions
        self.retire(gone)

    # --- taken over ------------------------------------------------------------------------------------------------

    def take_over(self, entry: MapObject, old: MapObject) -> None:
        """Let a labelled object take over the label of a retired one that it is; the store forgets the retired one."""
        _unite_labels(entry, old)
        entry.first_frame = min(entry.first_frame, old.first_frame)
        entry.frames_seen += old.frames_seen
        del self._objects[old.number]

    def join_map(self, entry: ObjectWithoutDepth, partner: MapObject) -> None:
        """Note that an object without depth is a labelled object of the map: both have the older one of their labels.

        The object of the map alone has the merged labels.
        """
        entry.partner = partner.number
        if entry.label:
            _unite_labels(partner, entry)
            partner.first_frame = min(partner.first_frame, entry.first_frame)
            entry.label, entry.merged_labels = partner.label, []

    def leave_map(self, entry: ObjectWithoutDepth) -> None:
        """Undo `join_map`, because the object of the map was retired; the label stays with both."""
        entry.partner, entry.meetings = 0, {}


def _unite_labels(kept: ObjectRecord, gone: ObjectRecord) -> None:
    """Give an object the older one of two labels; the younger one is recorded, with all labels merged into both."""
    labels = sorted({kept.label, gone.label} - {0})
    kept.label = labels[0] if labels else 0
    kept.merged_labels = sorted({*kept.merged_labels, *gone.merged_labels, *labels[1:]})
