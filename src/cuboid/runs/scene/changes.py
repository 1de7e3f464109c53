"""Changes between two visits: objects that are gone, new, or moved from one place to another.

An object that was only hidden or out of view is not reported as gone: as in the tracker, free-space carving must have
removed its points. If a new object is similar to one that is gone, it is the same object: it was moved.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.values import VisitChange
from cuboid.ground.geometry.box import Box
from cuboid.method.objects.entry import MapObject
from cuboid.method.objects.similarity import MIN_SIMILARITY, MIN_SIMILARITY_RATIO, color_profile_of, similarity
from cuboid.runs.scene.before import Before, OldObject
from cuboid.runs.scene.localisation import JoinedPart
from cuboid.runs.scene.still_there import StillThere, fraction_near, still_there
from cuboid.runs.tracking.posed_tracker import PosedTracker

# An object is unmoved if at least STILL_FRACTION of its old points lie within STILL_M metres of its new points, or if
# its centre has moved by at most STILL_MIDDLE_M metres.
STILL_M, STILL_FRACTION, STILL_MIDDLE_M = 0.025, 0.5, 0.03
# An object is gone if at least CARVED_FRACTION of its old points were carved, less than SEEN_AGAIN_FRACTION of them
# were seen again, and less than REMAINING_FRACTION of it is left: a rim at its foot that looks like its support.
CARVED_FRACTION, SEEN_AGAIN_FRACTION, REMAINING_FRACTION = 0.5, 0.15, 0.3
# An object in the place of an old one is a different object if their similarity is at most this and the old one is
# gone.
UNLIKE = 0.15
# An old object may still be there although the map now has it as two objects, or as part of another one. Its label goes
# to the new object that has at least this fraction of its points.
OWNED_FRACTION = 0.25
# A new object is a piece of another one if at least PIECE_FRACTION of its points lie within PIECE_M metres of an
# unchanged or moved object, or of a larger new one.
PIECE_FRACTION, PIECE_M = 0.5, 0.02
# An object that is not seen is gone if at least this fraction of its points lies inside a new one.
INSIDE_FRACTION = 0.5
# Interval, in frames, at which moved objects are searched for.
EVERY_FRAMES = 10


@dataclass(frozen=True, slots=True)
class Change:
    """The change of an object between two visits.

    Attributes
    ----------
    label : int
    change : str
        "unchanged", "moved", "gone", "new", "found" (its place had not been seen before, or it may have stood there
        without a label) or "not looked at".
    from_m, to_m : (3,) float64 or None
        Old and new position of its centre.
    metres : float or None
        Distance between the two.
    sure : float
        Confidence that a moved object is the same one, 0..1; 1 for other changes.
    """

    label: int
    change: VisitChange
    from_m: Float64Array | None
    to_m: Float64Array | None
    metres: float | None = None
    sure: float = 1.0


class Changes:
    """Compares the map with the scene at the start of a visit.

    Parameters
    ----------
    first_frame : int
        First frame of the visit, in the scene's count.
    before : Before
        The scene at the start of the visit.
    """

    def __init__(self, first_frame: int, before: Before) -> None:
        self._first_frame, self._before = first_frame, before
        # Carving pass and frame of the last comparison with the old scene; 0: compare everything that the visit may
        # have changed.
        self._since = self._since_frame = 0

    def recognise(self, tracker: PosedTracker, frame: int) -> None:
        """Find objects that are gone, that replaced another object, and that were moved.

        Only objects that were in view since the last call are compared.
        """
        old_objects = self._before.objects
        viewed = self._before.labels_in_viewed_cubes(tracker.voxels, self._since)
        for entry in tracker.ever_labelled():
            old = old_objects.get(entry.label)
            seen = entry.last_frame >= max(self._since_frame, self._first_frame)
            if old is not None and entry.confirmed and (seen or entry.label in viewed):
                self._retire_if_gone(tracker, entry, old)
        self._find_old(tracker)
        while self._merge_moved_together(tracker):
            pass
        self._since, self._since_frame = tracker.voxels.stored.carving_passes, frame + 1

    def apply_joins(self, joined: Sequence[JoinedPart]) -> None:
        """Note that the map was corrected, and transform the parts that were connected to the scene."""
        self._before.apply_joins(joined)
        self._since = self._since_frame = 0

    def _retire_if_gone(self, tracker: PosedTracker, entry: MapObject, old: OldObject) -> None:
        """Retire an object whose points were carved, or whose place is taken by other objects."""
        voxels = tracker.voxels
        carved = float((voxels.rows_at(old.points.astype(np.float64)) < 0).mean())
        fitted_anew = entry.box is not old.box and entry.last_frame >= self._first_frame
        in_place = _distance_m(entry.box, old.box) < 0.5 * max(old.box.size.max(), entry.box.size.max())
        replaced = fitted_anew and in_place and self._similarity(entry, old) < UNLIKE
        if carved < CARVED_FRACTION and not replaced and self._is_inside_new(tracker, entry, old):
            tracker.retire(entry, old.box)
            return
        if carved < CARVED_FRACTION and not replaced:
            return
        rows = voxels.stored.rows_of(entry.number)
        again = voxels.stored.xyz(rows[voxels.stored.seen_since(rows, self._first_frame)])
        seen_again = fraction_near(old.points, again, STILL_M)
        gone = (
            seen_again < SEEN_AGAIN_FRACTION
            and carved >= CARVED_FRACTION
            and len(again) < REMAINING_FRACTION * len(entry.points)
        )
        if gone or (replaced and len(again) and not self._still_there(tracker, old).still):
            # The object that stands there now is found anew from later frames, not from the evidence of both visits.
            tracker.retire(entry, old.box)

    def _is_inside_new(self, tracker: PosedTracker, entry: MapObject, old: OldObject) -> bool:
        """Return whether an object that this visit did not see lies inside a new one: solids do not overlap."""
        if entry.last_frame >= self._first_frame:
            return False
        new = [o for o in tracker.ever_labelled() if o.confirmed and o.first_frame >= self._first_frame]
        return any(o.box.contains(old.points, 0.0).mean() >= INSIDE_FRACTION for o in new if o is not entry)

    def _still_there(self, tracker: PosedTracker, old: OldObject) -> StillThere:
        return still_there(tracker.voxels, old, self._first_frame)

    def _find_old(self, tracker: PosedTracker) -> None:
        """Give new objects the labels of old objects: of those that are still there, and of those that were moved."""
        old_objects = self._before.objects
        entries = tracker.ever_labelled()
        ended = [o for o in entries if o.label in old_objects and not o.confirmed]
        new = [o for o in entries if o.confirmed and o.label not in old_objects and len(o.points)]
        new = [o for o in new if o.first_frame >= self._first_frame]
        if not ended or not new:
            return
        gone = []
        for old in ended:
            found = self._still_there(tracker, old_objects[old.label])
            if not found.still:
                gone.append(old)
            elif new:
                fractions = [float((found.owners == o.number).mean()) for o in new]
                if max(fractions) >= OWNED_FRACTION:
                    tracker.take_over(new.pop(int(np.argmax(fractions))), old)
        if gone and new:
            self._find_moved(tracker, gone, new)

    def _find_moved(self, tracker: PosedTracker, gone: Sequence[MapObject], new: Sequence[MapObject]) -> None:
        similarity = np.array([[self._similarity(o, self._before.objects[old.label]) for o in new] for old in gone])
        taken: set[int] = set()
        for k in np.argsort(-similarity.max(1), kind="stable"):
            j = int(np.argmax(similarity[k]))
            row, column = np.delete(similarity[k], j), np.delete(similarity[:, j], k)
            others = max(row.max(initial=0.0), column.max(initial=0.0))
            if (
                similarity[k, j] >= MIN_SIMILARITY
                and similarity[k, j] >= MIN_SIMILARITY_RATIO * others
                and j not in taken
            ):
                tracker.take_over(new[j], gone[k])
                taken.add(j)

    def _merge_moved_together(self, tracker: PosedTracker) -> bool:
        """Merge two objects that lay side by side before and after a move: they are pieces of one object."""
        old_objects = self._before.objects
        moved = [o for o in tracker.ever_labelled() if o.confirmed and o.label in old_objects]
        moved = [o for o in moved if not _in_place(o.box, old_objects[o.label].box)]
        for first, second in combinations(moved, 2):
            first_old, second_old = old_objects[first.label], old_objects[second.label]
            distance_m, distance_before_m = (
                _distance_m(first.box, second.box),
                _distance_m(first_old.box, second_old.box),
            )
            side_by_side = abs(distance_m - distance_before_m) <= STILL_MIDDLE_M and _level(tracker, first, second)
            if (
                side_by_side
                and fraction_near(first.points, second.points, PIECE_M) > 0
                and fraction_near(first_old.points, second_old.points, PIECE_M) > 0
                and all(self._change_of(tracker, o, True).change == "moved" for o in (first, second))
            ):
                tracker.merge(first, second)
                return True
        return False

    def find(self, tracker: PosedTracker, seen: Mapping[int, object]) -> list[Change]:
        """Return the change of each object with at least the probability `min_probability`, by label.

        Parameters
        ----------
        tracker : PosedTracker
        seen : mapping of int to anything
            Labels that the visit saw.
        """
        old_objects, entries = self._before.objects, tracker.ever_labelled()
        found = {}
        for entry in entries:
            if entry.label in old_objects:
                labels = {entry.label, *entry.merged_labels}
                found[entry.label] = self._change_of(tracker, entry, any(label in seen for label in labels))
        points_of = {entry.label: entry.points for entry in entries}
        known = [
            points_of[k] if change.change == "moved" else old_objects[k].points
            for k, change in found.items()
            if change.change != "gone"
        ]
        known_points = np.concatenate([np.zeros((0, 3), np.float32), *known])
        for entry in sorted(entries, key=lambda o: (-float(o.box.size.prod()), o.label)):
            if entry.label not in old_objects and entry.confirmed and entry.first_frame >= self._first_frame:
                is_new = self._before.was_seen(tracker, entry) and not self._before.may_have_stood(tracker, entry)
                is_new = is_new and fraction_near(entry.points, known_points, PIECE_M) < PIECE_FRACTION
                found[entry.label] = Change(
                    entry.label, "new" if is_new else "found", None, tracker.in_world(entry.box).center
                )
                known_points = np.concatenate([known_points, entry.points])
        shown = {entry.label for entry in entries if entry.score >= tracker.config.min_probability}
        return [found[label] for label in sorted(found) if label in shown]

    def _change_of(self, tracker: PosedTracker, entry: MapObject, seen: bool) -> Change:
        old = self._before.objects[entry.label]
        before, now = tracker.in_world(old.box).center, tracker.in_world(entry.box).center
        if not entry.confirmed:
            if self._still_there(tracker, old).still:
                return Change(entry.label, "unchanged", before, before)
            return Change(entry.label, "gone", before, None)
        if not seen:
            return Change(entry.label, "not looked at", before, None)
        metres = _distance_m(entry.box, old.box)
        near = _in_place(entry.box, old.box) or fraction_near(old.points, entry.points, STILL_M) >= STILL_FRACTION
        if near or self._still_there(tracker, old).still:
            return Change(entry.label, "unchanged", before, now)
        return Change(entry.label, "moved", before, now, metres, self._similarity(entry, old))

    def _similarity(self, entry: MapObject, old: OldObject) -> float:
        """Return the similarity of an object to an old one, 0..1, by size and by colors from bottom to top."""
        return similarity(color_profile_of(entry), entry.box, old.profile, old.box)


def _distance_m(box: Box, other: Box) -> float:
    return float(np.linalg.norm(box.center - other.center))


def _in_place(box: Box, other: Box) -> bool:
    return _distance_m(box, other) <= STILL_MIDDLE_M


def _level(tracker: PosedTracker, first: MapObject, second: MapObject) -> bool:
    """Return whether two objects stand at the same height, neither of them on the other."""
    up = tracker.support.likely_up
    feet = [float(up @ o.box.center) - o.box.size[2] / 2 for o in (first, second)]
    return bool(abs(feet[0] - feet[1]) <= PIECE_M)


def write(connection: sqlite3.Connection, recording: int, changes: list[Change]) -> None:
    """Write the changes that a recording shows, with a picture of before and after, in the caller's transaction."""
    connection.execute("DELETE FROM changes WHERE recording = ?", (recording,))
    for change in changes:
        before, after = (
            (None,) * 3 if center is None else tuple(center.tolist()) for center in (change.from_m, change.to_m)
        )
        row = (recording, change.label, change.change, *before, *after, change.metres, change.sure)
        connection.execute(
            "INSERT INTO changes (recording, label, change, from_x, from_y, from_z, to_x, to_y, to_z, metres, sure) "
            f"VALUES ({', '.join('?' * len(row))})",
            row,
        )
    connection.execute(
        "UPDATE changes SET before = (SELECT picture FROM known WHERE known.label = changes.label), "
        "after = (SELECT picture FROM objects WHERE objects.label = changes.label AND picture_share > 0) "
        "WHERE recording = ? AND change NOT IN ('unchanged', 'not looked at')",
        (recording,),
    )
