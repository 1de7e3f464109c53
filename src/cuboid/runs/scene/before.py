"""The scene at the start of a visit: its objects, the seen area of each plane, and occupied cells without a label.

The start of a visit reads no part of the map. The occupied cells of a cube are noted when the cube is first loaded into
memory during the visit: until then nothing in the cube has changed.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.records import box_numbers
from cuboid.ground.core.tolerances import MIN_READINGS
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.se3 import transform
from cuboid.method.heatmap.kernels.cubes import CUBE_BITS, keys_of
from cuboid.method.heatmap.voxel_map import VoxelMap
from cuboid.method.objects.entry import MapObject
from cuboid.method.objects.similarity import LAYERS, ColorProfile, color_profile_of
from cuboid.method.surfaces.grid import CELL_M as GROUND_CELL_M
from cuboid.method.surfaces.grid import cells_of
from cuboid.runs.scene.localisation import JoinedPart
from cuboid.runs.scene.packing import check_sum, deflated, inflated
from cuboid.runs.scene.schema import BOX
from cuboid.runs.scene.validation import DamagedError, box_of, columns_of, floats_of, read_rows
from cuboid.runs.tracking.posed_tracker import PosedTracker

# Maximum number of points that are kept of an object, to check later whether they are still there.
POINTS = 300
# A place was seen before if at least KNOWN_GROUND of an object's footprint was seen. The place was empty if at least
# STOOD of the object's points are higher than ABOVE_M metres above the plane, and less than STOOD of these lie in cells
# (side FOOTPRINT_CELL_M metres) that were occupied without a label. Other objects may have been part of the
# background, or too low to tell from the plane: they do not count as new.
KNOWN_GROUND, STOOD, ABOVE_M, FOOTPRINT_CELL_M = 0.5, 0.5, 0.02, 0.02

Cells = npt.NDArray[np.int64]
Ground = tuple[npt.NDArray[np.int64], npt.NDArray[np.bool_]]


@dataclass(frozen=True, slots=True)
class OldObject:
    """An object as it was when a visit began.

    Attributes
    ----------
    label, number : int
    box : Box
    profile : (LAYERS, 3) float64
        L*, a*, b* of the parts of its height, the lowest first.
    points : (N, 3) float32
    """

    label: int
    number: int
    box: Box
    profile: ColorProfile
    points: Float32Array


class Before:
    """The scene at the start of a visit.

    Parameters
    ----------
    objects : mapping of int to OldObject
        Objects by label.
    ground : mapping of int to (corner, (N, M) bool)
        Cells of each plane that had been seen, by the plane's identity; cells hidden by objects are not set.
    occupied : sequence of (N,) int64
        Occupied cells without a label, from the cubes that were noted so far.
    """

    def __init__(
        self, objects: Mapping[int, OldObject], ground: Mapping[int, Ground], occupied: Sequence[Cells]
    ) -> None:
        self.objects, self._ground, self._occupied = dict(objects), ground, list(occupied)
        self._numbers = np.array(sorted({old.number for old in objects.values()}), np.int64)
        # Cells noted since the last commit.
        self._noted: list[Cells] = []
        self._cubes: tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]] | None = None

    def watch(self, voxels: VoxelMap) -> None:
        """Note the occupied cells of each cube before the visit changes the cube; call this before the visit begins."""
        voxels.stored.before_visit = lambda rows: self._note(voxels, rows)

    def _note(self, voxels: VoxelMap, rows: npt.NDArray[np.int64]) -> None:
        points, _ = voxels.stored.spread(rows[~np.isin(voxels.stored.owner[rows], self._numbers)])
        cells = np.unique(_numbers_of(points))
        self._occupied.append(cells)
        self._noted.append(cells)

    def take_noted(self) -> Cells:
        """Return the cells noted since the last call, in order: the next commit writes them."""
        noted, self._noted = self._noted, []
        return _together(noted)

    def apply_joins(self, joined: Sequence[JoinedPart]) -> None:
        """Transform the objects of scene parts that have been connected to other parts."""
        for part in joined:
            inside = {label: part.contains(old.box.center[None])[0] for label, old in self.objects.items()}
            self.objects = {k: _moved(old, part.T_new_old) if inside[k] else old for k, old in self.objects.items()}
            self._cubes = None

    def labels_in_viewed_cubes(self, voxels: VoxelMap, since: int) -> set[int]:
        """Return labels of old objects in cubes viewed since a carving pass; see `VoxelMap.viewed_since`."""
        if self._cubes is None:
            cubes = [np.unique(keys_of(_cube_of(old.points, voxels.voxel_m))) for old in self.objects.values()]
            labels = np.repeat(np.fromiter(self.objects, np.int64), [len(keys) for keys in cubes])
            self._cubes = labels, np.concatenate([np.zeros(0, np.int64), *cubes])
        labels, keys = self._cubes
        return set(labels[voxels.stored.viewed_since(keys, since)].tolist())

    def was_seen(self, tracker: PosedTracker, entry: MapObject) -> bool:
        """Return whether the ground that an object stands on had been seen before the visit.

        The answer is False for an object narrower than a cell of the ground plan: the cell counts as seen even if the
        camera saw only the ground beside the object.
        """
        support = tracker.support
        if support.T_plan_world is None or entry.box.size[:2].min() < GROUND_CELL_M:
            return False
        corners = support.to_plan(entry.box.corners())
        low, high = corners.min(0), corners.max(0)
        grid = [np.linspace(a, b, 6) for a, b in zip(low[:2], high[:2], strict=True)]
        cells = cells_of(np.stack(np.meshgrid(*grid), -1).reshape(-1, 2))
        plane = support.find(entry.plane)
        if plane is None or plane.identity not in self._ground:
            return False
        corner, seen_cells = self._ground[plane.identity]
        i, j = (cells - corner).T
        inside = (i >= 0) & (j >= 0) & (i < seen_cells.shape[0]) & (j < seen_cells.shape[1])
        seen = inside & seen_cells[np.where(inside, i, 0), np.where(inside, j, 0)]
        # Objects that stood on the ground hid it.
        points = np.concatenate([np.zeros((0, 3), np.float32), *(old.points for old in self.objects.values())])
        hiding = support.to_plan(points)
        hiding = hiding[(hiding[:, 2] > low[2]) & (hiding[:, 2] < high[2])]
        seen |= np.isin(_cell_keys(cells), _cell_keys(cells_of(hiding)))
        return float(seen.mean()) >= KNOWN_GROUND

    def may_have_stood(self, tracker: PosedTracker, entry: MapObject) -> bool:
        """Return whether an object was, or may have been, there without a label before the visit."""
        plane = tracker.support.find(entry.plane)
        points = entry.points
        if plane is not None:
            normal, offset = tracker.support.in_world(plane)
            points = points[points @ normal + offset > ABOVE_M]
        if len(points) < STOOD * len(entry.points):
            return True  # so low that it looked like the ground
        self._occupied = [_together(self._occupied)]
        (occupied,) = self._occupied
        if not len(points) or not len(occupied):
            return False
        cells = _numbers_of(points)
        place = np.minimum(np.searchsorted(occupied, cells), len(occupied) - 1)
        return bool((occupied[place] == cells).mean() >= STOOD)


def begin(connection: sqlite3.Connection, tracker: PosedTracker) -> None:
    """Write the scene at the start of a visit, within the caller's transaction."""
    for table in ("known", "ground", "occupied"):
        connection.execute(f"DELETE FROM {table}")
    # Objects that were lost with a damaged file have no rows in the map.
    for entry in tracker.ever_labelled():
        if entry.confirmed and len(entry.points) and tracker.voxels.stored.owns(entry.number):
            points = np.ascontiguousarray(entry.points[:: 1 + len(entry.points) // POINTS], "<f4")
            profile = color_profile_of(entry).astype("<f8").tobytes()
            row = (entry.label, *box_numbers(entry.box), profile, points.tobytes(), entry.label, entry.number)
            places = f"{', '.join('?' * 13)}, (SELECT picture FROM objects WHERE label = ?), ?"
            connection.execute(f"INSERT INTO known VALUES ({places})", row)
    connection.execute("UPDATE objects SET picture_share = 0")  # each visit takes its own pictures
    for plane in tracker.support.planes:
        seen = plane.plan.seen >= MIN_READINGS
        corner = plane.plan.corner.tolist()
        row = (plane.identity, *corner, *seen.shape, np.packbits(seen).tobytes())
        connection.execute("INSERT INTO ground VALUES (?, ?, ?, ?, ?, ?)", row)


def load(connection: sqlite3.Connection) -> Before:
    """Return the scene at the start of the last visit, as far as it was noted.

    Raises
    ------
    DamagedError
        A row is invalid.
    """
    objects = {}
    columns = columns_of("known", ("label", *BOX, "look", "points", "number"))
    for label, *row in read_rows(connection, columns, "known"):
        profile, points = floats_of(row[10], "<f8", "known.look"), floats_of(row[11], "<f4", "known.points")
        if profile.size != LAYERS * 3 or points.size % 3:
            raise DamagedError(f"a row of known is damaged: {profile.size} and {points.size} numbers")
        box = box_of(row[:10], "known")
        objects[label] = OldObject(label, row[12], box, profile.reshape(LAYERS, 3), points.reshape(-1, 3))
    ground: dict[int, Ground] = {}
    for plane, i, j, rows, columns_, seen in read_rows(connection, columns_of("ground"), "ground"):
        if len(seen) != -(-rows * columns_ // 8):
            raise DamagedError(f"a row of ground is damaged: {len(seen)} bytes are not {rows} x {columns_} cells")
        bits = np.unpackbits(np.frombuffer(seen, np.uint8), count=rows * columns_).reshape(rows, columns_)
        ground[plane] = np.array([i, j]), bits.astype(bool)
    noted = read_rows(connection, columns_of("occupied"), "occupied")
    return Before(objects, ground, [_cells_in(inflated(data, check, "occupied.cells")) for check, data in noted])


def write_noted(connection: sqlite3.Connection, cells: Cells) -> None:
    """Write cells from `Before.take_noted`, within the caller's transaction."""
    if len(cells):
        data = deflated(np.diff(cells, prepend=0).astype("<i8").tobytes())
        connection.execute("INSERT INTO occupied VALUES (?, ?)", (check_sum(data), data))


def _cells_in(data: bytes) -> Cells:
    """Decode cells from bytes that hold the differences of successive cells; raise DamagedError if invalid."""
    steps = np.frombuffer(data, "<i8") if len(data) % 8 == 0 else np.zeros(1, np.int64)
    cells = np.cumsum(steps)
    if (steps <= 0).any() or (cells <= 0).any():
        raise DamagedError("occupied.cells is damaged: expected numbers in order")
    return cells


def _together(cells: Sequence[Cells]) -> Cells:
    """Return the sorted union of several sets of cells."""
    return cells[0] if len(cells) == 1 else np.unique(np.concatenate([np.zeros(0, np.int64), *cells]))


def _numbers_of(points: Float32Array) -> Cells:
    """Return a number for the cell of each point (N, 3)."""
    return keys_of(np.floor(points.astype(np.float64) / FOOTPRINT_CELL_M).astype(np.int64))


def _cell_keys(cells: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return a number for each cell (N, 2) of the ground."""
    return np.asarray((cells[:, 0] << 32) + cells[:, 1])


def _cube_of(points: Float32Array, voxel_m: float) -> npt.NDArray[np.int64]:
    return np.floor(points.astype(np.float64) / voxel_m).astype(np.int64) >> CUBE_BITS


def _moved(old: OldObject, T: Float64Array) -> OldObject:
    return replace(old, box=old.box.moved(T), points=transform(T, old.points).astype(np.float32))
