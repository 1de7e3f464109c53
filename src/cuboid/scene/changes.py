"""What changed between two visits: what is gone, what is new, and what is gone here and stands there.

Nothing is called gone that was only hidden or out of view: an object goes when frames see through its points, as the
tracker does it. What stood nowhere before and is like what is gone is that object: it was moved.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from cuboid.frame import Float32Array, Float64Array, UInt8Array
from cuboid.geometry.box import Box
from cuboid.geometry.se3 import quat_wxyz_from_rotation, transform
from cuboid.objects.entry import MapObject
from cuboid.scene.door import BOX, DamagedError, box_of, columns_of, floats_of, told
from cuboid.scene.packing import check_sum, deflated, inflated
from cuboid.scene.placing import Joined
from cuboid.surfaces.grid import cells_of
from cuboid.tracker import Tracker

# Of an object so many points are remembered, to tell whether they are still there.
POINTS = 300
# An object that lies still has half its old points within this of its new ones, metres, or its middle there.
STILL_M, STILL_SHARE, STILL_MIDDLE_M = 0.025, 0.5, 0.03
# Parts of an object's height whose colors are told apart.
LAYERS = 3
# Deviations of one object between two visits: of the logarithm of a side, of lightness (the light may be another one),
# and of a and b (CIE L*a*b*).
SIZE_SIGMA, LIGHT_SIGMA, COLOR_SIGMA = 0.2, 20.0, 7.0
# What is moved is at least this like what it was, and this much more so than any other, 0..1.
SURE, CLEARER = 0.2, 1.5
# An object is gone when this share of its old points is seen through, less than that of them is seen again, and less
# than so much of it is seen anywhere: a rim at its foot, which is not told from what it stood on.
CARVED, SEEN_AGAIN, LEFT = 0.5, 0.15, 0.3
# What stands in an object's place is another one when it is no more like it than this, and less than so much of what
# was there is seen again, or so much of it is seen through. On made visits, what did not move is more like itself than
# 0.85, nine tenths of it are seen again, and less than a tenth is seen through.
UNLIKE, SAME_PLACE, CHANGED = 0.15, 0.6, 0.15
# Objects that were moved are looked for every so many frames.
EVERY_FRAMES = 10
# A place was seen before when this share of its ground was. It was empty unless this share of what stands there now, so
# far above its ground, metres, lies in cells of the map, of such a side, that were no object's: what was not told from
# the room before is not new.
KNOWN_GROUND, STOOD, ABOVE_M, CELL_M = 0.5, 0.5, 0.02, 0.02

Look = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Known:
    """An object as it was when a visit began.

    Attributes
    ----------
    label : int
    box : Box
    look : (LAYERS, 3) float64
        L*, a*, b* of the parts of its height, the lowest first.
    points : (N, 3) float32
    """

    label: int
    box: Box
    look: Look
    points: Float32Array


@dataclass(frozen=True, slots=True)
class Change:
    """What became of an object between two visits.

    Attributes
    ----------
    label : int
    change : str
        "unchanged", "moved", "gone", "new", "found" (it stands where nothing was seen before) or "not looked at".
    from_m, to_m : (3,) float64 or None
        Where its middle was, and is.
    metres : float or None
        How far it was moved.
    sure : float
        How sure it is that what was moved is the same, 0..1; 1 for the others.
    """

    label: int
    change: str
    from_m: Float64Array | None
    to_m: Float64Array | None
    metres: float | None = None
    sure: float = 1.0


Cells = npt.NDArray[np.int64]
Ground = tuple[npt.NDArray[np.int64], npt.NDArray[np.bool_]]


class Changes:
    """Holds what is against what was when a visit began.

    Parameters
    ----------
    first_frame : int
        Of the visit, in the scene's count.
    known : mapping of int to Known
        By label.
    ground : mapping of int to (corner, (N, M) bool)
        Where each plane had been seen by then, by its identity.
    occupied : (N,) int64
        Cells in which something stood by then that had no label, in order.
    """

    def __init__(
        self, first_frame: int, known: Mapping[int, Known], ground: Mapping[int, Ground], occupied: Cells
    ) -> None:
        self._first_frame, self._known, self._ground, self._occupied = first_frame, known, ground, occupied

    def recognise(self, tracker: Tracker) -> None:
        """Find what is gone, what stands in another one's place, and what is gone there and stands here."""
        for entry in tracker.ever_labelled():
            old = self._known.get(entry.label)
            if old is not None and entry.confirmed:
                self._hold_against(tracker, entry, old)
        self._find_moved(tracker)

    def carry(self, joined: Sequence[Joined]) -> None:
        """Let what stood in parts of the scene that were unconnected be known where these belong."""
        for part in joined:
            known = {label: (one, part.holds(one.box.center[None])[0]) for label, one in self._known.items()}
            self._known = {label: _moved(one, part.T_new_old) if its else one for label, (one, its) in known.items()}

    def _hold_against(self, tracker: Tracker, entry: MapObject, old: Known) -> None:
        """End an object that frames see through, and part one from another that stands in its place."""
        voxels = tracker.voxels
        carved = float((voxels.rows_at(old.points.astype(np.float64)) < 0).mean())
        fitted_anew = entry.box is not old.box and entry.last_frame >= self._first_frame
        away_m = float(np.linalg.norm(entry.box.center - old.box.center))
        in_place = away_m < 0.5 * max(old.box.size.max(), entry.box.size.max())
        replaced = fitted_anew and in_place and self._alike(entry, old) < UNLIKE
        if carved < CARVED and not replaced:
            return
        rows = voxels.rows_of(entry.number)
        again = voxels.xyz(rows[voxels.seen_since(rows, self._first_frame)])
        seen_again = _share_near(old.points, again)
        if seen_again < SEEN_AGAIN and carved >= CARVED and len(again) < LEFT * len(entry.points):
            tracker.retire(entry)
        elif replaced and len(again) and (seen_again < SAME_PLACE or carved >= CHANGED):
            was = MapObject(0, old.box, entry.first_frame, self._first_frame - 1, points=old.points)
            was.colors = np.zeros((len(old.points), 3), np.uint8)
            tracker.split(entry, was, self._first_frame)

    def _find_moved(self, tracker: Tracker) -> None:
        """Let objects that are new here and like some that are gone there be those."""
        entries = tracker.ever_labelled()
        gone = [o for o in entries if o.label in self._known and not o.confirmed]
        new = [o for o in entries if o.confirmed and o.label not in self._known and len(o.points)]
        new = [o for o in new if o.first_frame >= self._first_frame]
        if not gone or not new:
            return
        alike = np.array([[self._alike(o, self._known[old.label]) for o in new] for old in gone])
        taken: set[int] = set()
        for k in np.argsort(-alike.max(1), kind="stable"):
            j = int(np.argmax(alike[k]))
            row, column = np.delete(alike[k], j), np.delete(alike[:, j], k)
            others = max(row.max(initial=0.0), column.max(initial=0.0))
            if alike[k, j] >= SURE and alike[k, j] >= CLEARER * others and j not in taken:
                tracker.adopt(new[j], gone[k])
                taken.add(j)

    def tell(self, tracker: Tracker, seen: Mapping[int, object]) -> list[Change]:
        """Return what became of each object, by label.

        Parameters
        ----------
        tracker : Tracker
        seen : mapping of int to anything
            Labels that the visit saw.
        """
        changes: list[Change] = []
        for entry in tracker.ever_labelled():
            old = self._known.get(entry.label)
            if old is not None:
                labels = {entry.label, *entry.merged_labels}
                changes.append(self._became(entry, old, any(label in seen for label in labels)))
            elif entry.confirmed and entry.first_frame >= self._first_frame:
                new = self._was_seen(tracker, entry) and not self._stood(tracker, entry)
                kind = "new" if new else "found"
                changes.append(Change(entry.label, kind, None, entry.box.center))
        return changes

    def _became(self, entry: MapObject, old: Known, seen: bool) -> Change:
        if not entry.confirmed:
            return Change(entry.label, "gone", old.box.center, None)
        if not seen:
            return Change(entry.label, "not looked at", old.box.center, None)
        metres = float(np.linalg.norm(entry.box.center - old.box.center))
        if metres <= STILL_MIDDLE_M or _still(old.points, entry.points):
            return Change(entry.label, "unchanged", old.box.center, entry.box.center)
        return Change(entry.label, "moved", old.box.center, entry.box.center, metres, self._alike(entry, old))

    def _alike(self, entry: MapObject, old: Known) -> float:
        """Return how like an object is to one that was there, 0..1: in size and in colors from foot to top."""
        return alike(look_of(entry), entry.box, old.look, old.box)

    def _was_seen(self, tracker: Tracker, entry: MapObject) -> bool:
        """Tell whether the ground that an object stands on had been seen before the visit."""
        support = tracker.support
        if support.T_plan_world is None:
            return False
        corners = support.to_plan(entry.box.corners())
        low, high = corners[:, :2].min(0), corners[:, :2].max(0)
        grid = np.stack(np.meshgrid(*(np.linspace(a, b, 6) for a, b in zip(low, high, strict=True))), -1).reshape(-1, 2)
        plane = None if entry.plane is None else support.find(entry.plane)
        if plane is None or plane.identity not in self._ground:
            return False
        corner, known = self._ground[plane.identity]
        i, j = (cells_of(grid) - corner).T
        inside = (i >= 0) & (j >= 0) & (i < known.shape[0]) & (j < known.shape[1])
        return float((inside & known[np.where(inside, i, 0), np.where(inside, j, 0)]).mean()) >= KNOWN_GROUND

    def _stood(self, tracker: Tracker, entry: MapObject) -> bool:
        """Tell whether what is an object now was there before the visit, without a label."""
        plane = None if entry.plane is None else tracker.support.find(entry.plane)
        points = entry.points
        if plane is not None:
            normal, offset = tracker.support.in_world(plane)
            points = points[points @ normal + offset > ABOVE_M]
        if not len(points) or not len(self._occupied):
            return False
        cells = _cells_of(points)
        at = np.minimum(np.searchsorted(self._occupied, cells), len(self._occupied) - 1)
        return bool((self._occupied[at] == cells).mean() >= STOOD)


def begin(connection: sqlite3.Connection, tracker: Tracker) -> None:
    """Write down how things stand when a visit begins, within the caller's transaction."""
    connection.execute("DELETE FROM known")
    connection.execute("DELETE FROM ground")
    for entry in tracker.ever_labelled():
        if entry.confirmed and len(entry.points):
            points = entry.points[tracker.voxels.rows_at(entry.points.astype(np.float64)) >= 0]
            if not len(points):
                continue  # they were lost with a damaged file
            points = np.ascontiguousarray(points[:: 1 + len(points) // POINTS], "<f4")
            box = entry.box
            nine = (*box.center.tolist(), *box.size.tolist(), *quat_wxyz_from_rotation(box.rotation).tolist())
            row = (entry.label, *nine, look_of(entry).astype("<f8").tobytes(), points.tobytes(), entry.label)
            connection.execute(
                f"INSERT INTO known VALUES ({', '.join('?' * 13)}, (SELECT picture FROM objects WHERE label = ?))", row
            )
    connection.execute("UPDATE objects SET picture_share = 0")  # each visit takes pictures of its own
    for plane in tracker.support.planes:
        seen = plane.plan.covered > 0
        corner = plane.plan.corner.tolist()
        row = (plane.identity, *corner, *seen.shape, np.packbits(seen).tobytes())
        connection.execute("INSERT INTO ground VALUES (?, ?, ?, ?, ?, ?)", row)
    connection.execute("DELETE FROM occupied")
    cells = deflated(np.diff(_occupied(tracker), prepend=0).astype("<i8").tobytes())
    connection.execute("INSERT INTO occupied VALUES (?, ?)", (check_sum(cells), cells))


def _occupied(tracker: Tracker) -> Cells:
    """Return the cells of the map in which something is that has no label, in order."""
    voxels = tracker.voxels
    labelled = np.zeros(1 + max((o.number for o in tracker.ever_labelled()), default=0), bool)
    labelled[[o.number for o in tracker.ever_labelled() if o.confirmed]] = True
    rows = voxels.living()
    owner = voxels.owner[rows]
    rows = rows[~labelled[np.where(owner < len(labelled), owner, 0)]]
    return np.unique(_cells_of(voxels.xyz(rows)))


def _cells_of(points: Float32Array) -> Cells:
    """Return a number for the cell of each point (N, 3)."""
    x, y, z = (np.floor(points.astype(np.float64) / CELL_M).astype(np.int64) + (1 << 20)).T
    return np.asarray(x << 42 | y << 21 | z)


def load(connection: sqlite3.Connection, first_frame: int) -> Changes:
    """Return what holds a visit against how things stood when it began."""
    known = {}
    for label, *row in told(connection, columns_of("known", ("label", *BOX, "look", "points")), "known"):
        look, points = floats_of(row[10], "<f8", "known.look"), floats_of(row[11], "<f4", "known.points")
        if look.size != LAYERS * 3 or points.size % 3:
            raise DamagedError(f"a row of known is damaged: {look.size} and {points.size} numbers")
        known[label] = Known(label, box_of(row[:10], "known"), look.reshape(LAYERS, 3), points.reshape(-1, 3))
    ground: dict[int, Ground] = {}
    for plane, i, j, rows, columns, seen in told(connection, columns_of("ground"), "ground"):
        if len(seen) != -(-rows * columns // 8):
            raise DamagedError(f"a row of ground is damaged: {len(seen)} bytes are not {rows} x {columns} cells")
        bits = np.unpackbits(np.frombuffer(seen, np.uint8), count=rows * columns).reshape(rows, columns)
        ground[plane] = np.array([i, j]), bits.astype(bool)
    cells: Cells = np.zeros(0, np.int64)
    for check, data in told(connection, columns_of("occupied"), "occupied"):
        cells = _cells_in(inflated(data, check, "occupied.cells"))
    return Changes(first_frame, known, ground, cells)


def _cells_in(data: bytes) -> Cells:
    """Return the cells whose steps from one to the next bytes are; DamagedError where they are none."""
    steps = np.frombuffer(data, "<i8") if len(data) % 8 == 0 else np.zeros(1, np.int64)
    cells = np.cumsum(steps)
    if (steps <= 0).any() or (cells <= 0).any():
        raise DamagedError("occupied.cells is damaged: expected numbers in order")
    return cells


def write(connection: sqlite3.Connection, recording: int, changes: list[Change]) -> None:
    """Write the changes that a recording shows, with a picture of before and after, in the caller's transaction."""
    connection.execute("DELETE FROM changes WHERE recording = ?", (recording,))
    for one in changes:
        before, after = ((None,) * 3 if place is None else tuple(place.tolist()) for place in (one.from_m, one.to_m))
        row = (recording, one.label, one.change, *before, *after, one.metres, one.sure)
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


def alike(look: Look, box: Box, other_look: Look, other_box: Box) -> float:
    """Return how like two objects are, 0..1: in size and in colors from foot to top."""
    sides = np.log(_sides(box) / _sides(other_box)) / SIZE_SIGMA
    off = (look - other_look) / np.array([LIGHT_SIGMA, COLOR_SIGMA, COLOR_SIGMA])
    return float(np.exp(-0.5 * ((sides**2).mean() + (off**2).mean())))


def look_of(entry: MapObject) -> Look:
    """Return the colors (LAYERS, 3) of an object from foot to top, as L*, a*, b*."""
    lab = _lab(entry.colors)
    height = (entry.points.astype(np.float64) - entry.box.center) @ entry.box.rotation[:, 2]
    share = height / max(float(entry.box.size[2]), 1e-6) + 0.5
    layer = np.clip((share * LAYERS).astype(int), 0, LAYERS - 1)
    whole = lab.mean(0) if len(lab) else np.zeros(3)
    return np.array([lab[layer == k].mean(0) if (layer == k).any() else whole for k in range(LAYERS)])


def _lab(rgb: UInt8Array) -> Float64Array:
    lab: Float64Array = np.zeros((len(rgb), 3))
    if len(rgb):
        lab[:] = cv2.cvtColor(np.ascontiguousarray(rgb[None], np.float32) / np.float32(255), cv2.COLOR_RGB2LAB)[0]
    return lab


def _moved(known: Known, T: Float64Array) -> Known:
    box = Box(transform(T, known.box.center), known.box.size, T[:3, :3] @ known.box.rotation)
    return replace(known, box=box, points=transform(T, known.points).astype(np.float32))


def _sides(box: Box) -> Float64Array:
    """Return the sides of a box: the longer and the shorter one of its footprint, its height."""
    return np.asarray(np.maximum([box.size[:2].max(), box.size[:2].min(), box.size[2]], 0.005), np.float64)


def _still(old: Float32Array, new: Float32Array) -> bool:
    """Tell whether points are still where they were."""
    return _share_near(old, new) >= STILL_SHARE


def _share_near(points: Float32Array, others: Float32Array) -> float:
    """Return the share of points that have others near by."""
    if len(points) == 0 or len(others) == 0:
        return 0.0
    distance, _ = cKDTree(others).query(points, distance_upper_bound=STILL_M)
    return float(np.isfinite(distance).mean())
