"""The map of objects: what each frame tells of them, voxel by voxel and as log-odds, and labels for life."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from math import ceil

import numpy as np
import numpy.typing as npt

from cuboid.config import TrackerConfig
from cuboid.frame import Float64Array, UInt8Array
from cuboid.geometry.box import Box
from cuboid.geometry.overlap import pack
from cuboid.geometry.se3 import transform
from cuboid.heatmap.voxel_map import VoxelMap
from cuboid.kernels.outlines import KINDS
from cuboid.limits import MOST_CANDIDATES
from cuboid.objects.affinity import MOST_TOLD
from cuboid.objects.association import Association, associate
from cuboid.objects.boxing import Boxing
from cuboid.objects.entry import MapObject, State, together
from cuboid.objects.fitting import Fitting
from cuboid.objects.outline import agreeing, told_by
from cuboid.objects.store import ObjectStore
from cuboid.objects.validity import fits_object
from cuboid.objects.visibility import in_view
from cuboid.objects.wholeness import is_whole
from cuboid.surfaces.clusters import FrameCluster, FrameClusters
from cuboid.surfaces.planes import PlaneTracker
from cuboid.tolerances import LEAST_FRAMES, LEAST_READINGS, LITTLE, MOST, SURE
from cuboid.working import WorkingImage

# What a candidate loses in a frame that shows its place and has no proposal for it.
MISSED = 0.3
# A frame is all news of how things stand to each other when the camera has gone round them by this since the last one,
# radians; a frame from the same place is a little.
ANOTHER_SIDE_RAD = 0.05


class ObjectMap:
    """Keeps what is known of the objects, and takes in frames.

    Parameters
    ----------
    config : TrackerConfig
    voxels : VoxelMap
    planes : PlaneTracker
    """

    def __init__(self, config: TrackerConfig, voxels: VoxelMap, planes: PlaneTracker) -> None:
        self._config = config
        self._voxels = voxels
        self._planes = planes
        self._boxing = Boxing(voxels)
        self.store = ObjectStore(voxels)

    @property
    def _fitting(self) -> Fitting:
        return Fitting(self._config, self._voxels, self._planes, self.store, self._boxing)

    def in_view(self, image: WorkingImage, T_camera_world: Float64Array) -> list[MapObject]:
        """Return the objects, confirmed or not, whose boxes reach into the picture within the range, by number."""
        far_m, store = self._config.max_depth_m, self.store
        found = in_view(store.boxes[: store.numbers], store.bounds, image, T_camera_world, far_m)
        return [store[n] for n in found.tolist()]

    def limited(self, objects: Sequence[MapObject]) -> list[MapObject]:
        """Return objects in view without the least likely of more candidates than a frame may have: these are over."""
        candidates = [o for o in objects if not o.confirmed]
        if len(candidates) > MOST_CANDIDATES:
            for entry in sorted(candidates, key=lambda o: (-o.log_odds, o.number))[MOST_CANDIDATES:]:
                self.store.retire(entry)
        return [o for o in objects if o.state is not State.RETIRED]

    def update(
        self,
        frame: int,
        things: FrameClusters,
        boxes: Sequence[Box],
        objects: Sequence[MapObject],
        slots: npt.NDArray[np.int32],
        pixel_owner: npt.NDArray[np.int32],
        known: npt.NDArray[np.bool_],
        candidate: UInt8Array,
        turn: float,
        elsewhere: bool,
        keyframe: int,
        eye: Float64Array,
    ) -> Association:
        """Take in what a frame shows.

        Parameters
        ----------
        frame : int
        things : FrameClusters
        boxes : sequence of Box
            Of the things.
        objects : sequence of MapObject
            From `in_view`.
        slots : (h, w) int32
            Voxel of each working pixel, -1 none.
        pixel_owner : (h, w) int32
            Number of the object that each of these belongs to, 0 none.
        known : (h, w) bool
            Where the map knew something before this frame.
        candidate : (h, w) uint8
            Pixels off every supporting plane.
        turn : float
            How far the camera has gone round what it sees since the frame before, radians.
        elsewhere : bool
            Whether the camera has moved beyond drift since a frame last showed the objects from elsewhere.
        keyframe : int
            That the frame hangs on.
        eye : (3,) float64
            Where the camera is, world, metres.

        Returns
        -------
        Association
        """
        for entry in objects:
            entry.keyframe = -1  # points that the frame has fused hang on another one now
        found = associate(things, pack(boxes), objects, self.store.boxes_of(objects), pixel_owner, known)
        news = min(1.0, max(LITTLE, turn / ANOTHER_SIDE_RAD))
        number_of = self._sightings(frame, things, boxes, found, keyframe, turn)
        self._voxels.vote(things.claim, number_of, *self._may_take(number_of, found), candidate, slots)
        self._pairs(things, found, news)
        self._share_room(objects, news)
        self._hold(objects, news)
        self._missed(found)
        touched = [o.number for o in objects] + [int(n) for n in number_of if n]
        self._fitting.fit_grown(touched, eye, elsewhere)
        self._lost(found)
        self._merge(touched, eye)
        self._end(touched)
        return found

    def _sightings(
        self, frame: int, things: FrameClusters, boxes: Sequence[Box], found: Association, keyframe: int, turn: float
    ) -> npt.NDArray[np.int32]:
        """Let each thing speak for an object, a new one where need be; return for which each votes, 0 for none."""
        number_of = np.zeros(len(things.clusters), np.int32)
        match, part = found.match.tolist(), found.part.tolist()
        partner = {j: i for i, j in enumerate(match) if j >= 0}
        outlines = np.array([c.outline for c in things.clusters]).reshape(-1, 4, KINDS)
        told = told_by(outlines, np.array([c.read for c in things.clusters])).tolist()
        for i, cluster in enumerate(things.clusters):
            if match[i] >= 0:
                entry = found.objects[match[i]]
                self._sighting(entry, cluster, agreeing(told[i], turn))
            elif part[i] >= 0 and not self._apart(things, i, partner.get(part[i])):
                number_of[i] = found.objects[part[i]].number
                continue
            else:
                if not fits_object(boxes[i], self._config):
                    continue
                entry = self.store.add(boxes[i], frame, keyframe)
                self._sighting(entry, cluster, told[i])
            number_of[i] = entry.number
        return number_of

    @staticmethod
    def _apart(things: FrameClusters, i: int, j: int | None) -> bool:
        """Tell whether two things are bounded by each other, and are no pieces of one proposal."""
        return j is not None and things.share[i] != things.share[j] and things.contact[i, j] + things.contact[j, i] > 0

    def _sighting(self, entry: MapObject, cluster: FrameCluster, told: float) -> None:
        # However clear its outline is: a label whose box has not the size of an object gains nothing by it.
        if entry.confirmed and not fits_object(entry.box, self._config):
            told = min(told, 0.0)
        entry.log_odds = min(MOST_TOLD, max(-MOST_TOLD, entry.log_odds + told))
        entry.outline = entry.outline + cluster.outline
        entry.sightings += 1
        if cluster.supports:
            entry.supports = together(entry.supports, cluster.supports)

    def _may_take(
        self, number_of: npt.NDArray[np.int32], found: Association
    ) -> tuple[npt.NDArray[np.int64], UInt8Array]:
        """Return a column for each object by number, and for each thing from whose it may take known voxels (n, m + 1).

        What is like its object takes what is no one's, or a candidate's; from a labelled object only what has proved
        to be another one takes anything. Of two labels half as much as is sure proves that: unlike a merger, later
        votes undo it, and both are known to be whole.
        """
        place = np.full(self.store.numbers, -1, np.int64)
        place[0] = 0
        place[[o.number for o in found.objects]] = np.arange(1, len(found.objects) + 1)
        sure = (found.match < 0) | (found.likeness >= MOST)
        allowed = np.zeros((len(number_of), len(found.objects) + 1), np.uint8)
        allowed[sure] = [1, *(not o.confirmed for o in found.objects)]
        numbers = number_of.tolist()
        for i in np.flatnonzero(sure).tolist():
            labelled = numbers[i] > 0 and self.store[numbers[i]].confirmed
            others = self.store.affinity.partners(numbers[i], most=-SURE / 2.0 if labelled else -SURE)
            if others:
                columns = place[others]
                allowed[i, columns[columns > 0]] = 1
        return place, allowed

    def _pairs(self, things: FrameClusters, found: Association, news: float) -> None:
        """Take in which objects this frame shows as one, and which as two side by side."""
        affinity = self.store.affinity
        numbers = [o.number for o in found.objects]
        whole = (found.sight >= LEAST_READINGS) & (found.common >= MOST * found.sight)
        for i in np.flatnonzero(whole.sum(1) > 1):
            for a, b in combinations(np.flatnonzero(whole[i]).tolist(), 2):
                affinity.tell(numbers[a], numbers[b], one=True, news=news)
        known, match = found.match >= 0, found.match.tolist()
        beside = np.triu(things.contact + things.contact.T > 0, 1) & known & known[:, None]
        for i, j in zip(*(k.tolist() for k in np.nonzero(beside)), strict=True):
            a, b = found.objects[match[i]], found.objects[match[j]]
            if self._apart(things, i, j) and not self._held(a, b):
                affinity.tell(a.number, b.number, one=False, news=news)

    @staticmethod
    def _held(a: MapObject, b: MapObject) -> bool:
        return a.holder == b.number or b.holder == a.number

    def _hold(self, objects: Sequence[MapObject], news: float) -> None:
        """Take objects that nothing carries from below for parts of what holds them."""
        for entry in objects:
            if entry.holder and entry.holder in self.store and self.store[entry.holder].state is not State.RETIRED:
                self.store.affinity.hold(entry.number, entry.holder, news)

    def _share_room(self, objects: Sequence[MapObject], news: float) -> None:
        """Take objects that are in each other's place for parts of one: no two solids share room."""
        entries = [o for o in objects if len(o.points)]
        labelled = [o for o in entries if o.confirmed]
        if not labelled:
            return
        for i, j in zip(*(k.tolist() for k in np.nonzero(self.store.share_room(entries, labelled))), strict=True):
            one, other = entries[i], labelled[j]
            if not (one.confirmed and one.number >= other.number):  # each pair tells once, and none of itself
                self.store.affinity.tell(one.number, other.number, one=True, news=news)

    def _missed(self, found: Association) -> None:
        """Let candidates that no proposal of the frame shows lose ground."""
        matched = set(found.match.tolist())
        for j, entry in enumerate(found.objects):
            if entry.state is State.CANDIDATE and j not in matched:
                entry.log_odds -= MISSED

    def _lost(self, found: Association) -> None:
        """Retire labelled objects that the frame has nothing of, and that frames see through: taken away, mostly."""
        matched = set(found.match.tolist())
        for j, entry in enumerate(found.objects):
            if j in matched or not entry.confirmed:
                continue
            # A rim at its foot stays: what passes that near to a table is not told from what lies on it.
            if not self._voxels.has_rows(entry.number, ceil(LITTLE * len(entry.points))):
                self.store.retire(entry)

    def stand_anew(self) -> None:
        """Let all objects find their planes anew: up is not what it was."""
        for entry in self.store.living():
            entry.plane, entry.supports, entry.fitted = None, {}, 0

    def carry(self, moved: Mapping[int, Float64Array]) -> None:
        """Move the map, and each object with the keyframe that most of its points hang on.

        Parameters
        ----------
        moved : mapping of int to (4, 4) float64
            T_new_old in the world, of each keyframe whose surroundings move.
        """
        for entry in self.store.living():
            if entry.keyframe < 0:
                entry.keyframe = self._voxels.keyframe_of(self._voxels.rows_of(entry.number))
            T = moved.get(entry.keyframe)
            if T is not None:
                R, t = T[:3, :3], T[:3, 3]
                self.store.place(entry, Box(R @ entry.box.center + t, entry.box.size, R @ entry.box.rotation))
                entry.points = transform(T, entry.points).astype(np.float32)
        self._voxels.carry(moved)

    def begin_visit(self) -> None:
        """Expect the place at another time: what was seen counts as chance would, and boxes are soon fitted anew."""
        self._voxels.begin_visit(LEAST_FRAMES)
        for entry in self.store.living():
            entry.sightings = min(entry.sightings, LEAST_FRAMES)
            entry.fitted = min(entry.fitted, LEAST_FRAMES)

    def _merge(self, numbers: Sequence[int], eye: Float64Array) -> None:
        """Make one of objects that have proved to be one; the camera sees them from `eye` (3,)."""
        for entry in self.store.all_of(numbers):
            number = entry.number
            if number not in self.store or entry.state is State.RETIRED:
                continue
            for other in self.store.affinity.partners(number, least=SURE / 2.0):
                if other not in self.store:
                    continue
                told = self.store.affinity.of(number, other)
                a, b = self.store[number], self.store[other]
                least = SURE if a.confirmed and b.confirmed else SURE / 2.0
                if told is not None and told >= least:
                    self.merge(a, b, eye)
                    break

    def merge(self, one: MapObject, two: MapObject, eye: Float64Array | None = None) -> MapObject:
        """Make one of two objects, and return it; `eye` (3,) is where a camera is that sees them, if any does."""
        kept, _ = self.store.merge(one, two)
        self._fitting.fit(kept, eye)
        return kept

    def _end(self, numbers: Sequence[int]) -> None:
        """End those that are surely none."""
        entries = self.store.all_of(numbers)
        self.store.retire_all([o for o in entries if o.log_odds <= (-SURE if o.confirmed else -SURE / 2.0)])

    def label(self, seen: Sequence[MapObject]) -> None:
        """Give labels to those that are sure, of the objects that a frame sees."""
        for entry in seen:
            if (
                entry.state is State.CANDIDATE
                and entry.log_odds >= SURE
                and is_whole(entry, self.store, self._planes, self._config)
            ):
                self.store.confirm(entry)
