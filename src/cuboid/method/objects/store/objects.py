"""All objects by number, and searches among them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.limits import SAMPLE_POINTS
from cuboid.ground.core.tolerances import DRIFT_M
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.overlap import overlap_min_matrix
from cuboid.method.heatmap.voxel_map import VoxelMap
from cuboid.method.objects.affinity import Affinity
from cuboid.method.objects.distances import points_near
from cuboid.method.objects.entry import MapObject, ObjectWithoutDepth, State
from cuboid.method.objects.store.boxes import BoxTable

# Two objects overlap in space if their boxes share this fraction of the smaller one, which two solids cannot.
SHARED_FRACTION = 0.5
# An object may lie in the hollow of another one that is at least this high, metres, if its box has at most this
# fraction of the other's volume. Bowls and plates, whose parts may look like objects, are lower.
HOLLOW_HEIGHT_M, HOLLOW_FRACTION = 0.1, 0.2


class StoredObjects:
    """All objects by number, with their boxes and affinities; nothing here changes an object.

    Parameters
    ----------
    voxels : VoxelMap
        The map whose points store the numbers of their owners.

    Attributes
    ----------
    affinity : Affinity
        The log-odds that two objects are one; read it here, change it by the methods of `ObjectEvidence`.
    """

    def __init__(self, voxels: VoxelMap) -> None:
        self._voxels = voxels
        self._objects: dict[int, MapObject] = {}
        self._confirmed: dict[int, MapObject] = {}
        self._without_depth: dict[int, ObjectWithoutDepth] = {}
        self._next_number = self._next_label = 1
        self.affinity = Affinity()
        self._boxes = BoxTable()

    def __getitem__(self, number: int) -> MapObject:
        return self._objects[number]

    def __contains__(self, number: int) -> bool:
        return number in self._objects

    @property
    def numbers(self) -> int:
        """One more than the highest number given so far."""
        return self._next_number

    def living(self) -> list[MapObject]:
        """Return all objects with depth that are not retired, by number."""
        return [o for o in self._objects.values() if o.state is not State.RETIRED]

    def seen_in(self, frame: int) -> list[MapObject]:
        """Return the objects with depth that this frame, the last one, shows: also those that are followed."""
        return [o for o in self._objects.values() if o.last_frame == frame and o.frames_seen]

    def confirmed(self) -> list[MapObject]:
        """Return the living objects with depth and a label, by label."""
        return sorted(self._confirmed.values(), key=lambda o: o.label)

    def ever_labelled(self) -> list[MapObject]:
        """Return all objects with depth and a label, including retired ones, by label."""
        return sorted((o for o in self._objects.values() if o.label), key=lambda o: o.label)

    def without_depth(self) -> list[ObjectWithoutDepth]:
        """Return the living objects without depth, by number."""
        return list(self._without_depth.values())

    def detected(self) -> list[ObjectWithoutDepth]:
        """Return the objects without depth that a detector shows, by number."""
        return [entry for entry in self._without_depth.values() if not entry.by_regions]

    def by_regions(self) -> list[ObjectWithoutDepth]:
        """Return the objects without depth that regions of color and depth show, by number."""
        return [entry for entry in self._without_depth.values() if entry.by_regions]

    def rivals_of(self, entry: ObjectWithoutDepth) -> list[MapObject]:
        """Return the labelled objects that own pixels of the last region of an object."""
        return [o for o in self.all_of(entry.rivals) if o.confirmed]

    def all_of(self, numbers: Iterable[int]) -> list[MapObject]:
        """Return the living ones among some objects, by number."""
        found = map(self._objects.get, sorted(set(numbers)))
        return [o for o in found if o is not None and o.state is not State.RETIRED]

    @property
    def boxes(self) -> Float64Array:
        """A row for each number, (capacity, 15), see `pack`; NaN without a living object."""
        return self._boxes.rows

    @property
    def bounds(self) -> Float64Array:
        """Bounds of the boxes of each batch, (M, 7): see `kernels.overlap.bound`."""
        return self._boxes.bounds

    def boxes_of(self, entries: Sequence[MapObject]) -> Float64Array:
        """Return the boxes (N, 15) of living objects, see `pack`."""
        return self.boxes[[entry.number for entry in entries]]

    def near(self, box: Box, gap_m: float) -> list[MapObject]:
        """Return the living objects whose bounding spheres come within a gap of a box's, by number."""
        return [self._objects[k] for k in self._boxes.near(box, gap_m, self.numbers).tolist()]

    def neighbours(self, entry: MapObject) -> list[MapObject]:
        """Return the other living objects whose bounding spheres overlap an object's, by number."""
        return [o for o in self.near(entry.box, 0.0) if o is not entry]

    def overlapping(self, entries: Sequence[MapObject], others: Sequence[MapObject]) -> npt.NDArray[np.bool_]:
        """Return which living objects overlap in space, (N, M), by half of the smaller box or more.

        An object inside a far larger one must also share half of its points with it: otherwise the larger one is
        hollow, as a tote is.
        """
        found = np.asarray(overlap_min_matrix(self.boxes_of(entries), self.boxes_of(others)) >= SHARED_FRACTION)
        for i, j in zip(*np.nonzero(found), strict=True):
            found[i, j] = not _is_inside_hollow(entries[i], others[j])
        return found


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
