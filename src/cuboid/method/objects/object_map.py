"""The map of objects: updated by each frame, voxel by voxel and in log-odds; labels are persistent."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array, UInt8Array
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.limits import MAX_CANDIDATES
from cuboid.ground.core.observation import Observation
from cuboid.ground.core.state import Record
from cuboid.ground.core.tolerances import MIN_READINGS
from cuboid.ground.core.working import WorkingImage
from cuboid.ground.geometry.box import Box
from cuboid.method.boxes.measured_sides import view_is_due
from cuboid.method.boxes.top_edges import Picture
from cuboid.method.heatmap.voxel_map import VoxelMap
from cuboid.method.objects.affinity import CERTAIN_LOG_ODDS, DIFFERENT_LOG_ODDS, SAME_LOG_ODDS
from cuboid.method.objects.association import Association, SegmentedFrame, associate
from cuboid.method.objects.boxing import Boxing
from cuboid.method.objects.confirmation import is_confirmable
from cuboid.method.objects.entry import MapObject, State
from cuboid.method.objects.fitting import Fitting
from cuboid.method.objects.objectness import probability, quantities_of
from cuboid.method.objects.retirement import abandoned
from cuboid.method.objects.store import ObjectStore, ObjectStoreState
from cuboid.method.objects.validity import fits_object
from cuboid.method.objects.visibility import objects_in_frustum, places_in_view
from cuboid.method.surfaces.frame_segments import FrameSegments
from cuboid.method.surfaces.planes import PlaneTracker

# A segment with this similarity to its object may take voxels from other objects.
SURE_MATCH = 0.5
# On a later visit, earlier sightings have at most this weight, that of one view; earlier hits of a voxel count as at
# most this number.
VISIT_SIGHTINGS, VISIT_HITS = 1.0, 3
# Largest number of objects whose sides are measured in a frame; others follow in later frames. One takes 4 to 5 ms.
MAX_MEASURED = 2


@dataclass(frozen=True, slots=True)
class ObjectMapState(Record):
    """State of an `ObjectMap`: the state of its store."""

    store: ObjectStoreState


class ObjectMap:
    """The map of objects, updated frame by frame.

    Parameters
    ----------
    config : TrackerConfig
    voxels : VoxelMap
    planes : PlaneTracker
    """

    NOT_SAVED = frozenset({"_config", "_voxels", "_planes", "_boxing"})

    def __init__(self, config: TrackerConfig, voxels: VoxelMap, planes: PlaneTracker) -> None:
        self._config = config
        self._voxels = voxels
        self._planes = planes
        self._boxing = Boxing(voxels)
        self.store = ObjectStore(voxels)

    def state(self) -> ObjectMapState:
        """Return the current state; see `ObjectStore.state`."""
        return ObjectMapState(self.store.state())

    @classmethod
    def from_state(
        cls, state: ObjectMapState, config: TrackerConfig, voxels: VoxelMap, planes: PlaneTracker
    ) -> ObjectMap:
        """Return a map of objects that continues from a state; voxels and planes are already restored."""
        found = cls(config, voxels, planes)
        found.store = ObjectStore.from_state(state.store, voxels)
        return found

    @property
    def _fitting(self) -> Fitting:
        return Fitting(self._config, self._voxels, self._planes, self.store, self._boxing)

    def objects_in_frustum(self, image: WorkingImage, T_camera_world: Float64Array) -> list[MapObject]:
        """Return the objects, confirmed or not, whose spheres reach into the image at a pose (4, 4), by number."""
        return objects_in_frustum(self.store, image, T_camera_world, self._config.max_depth_m)

    def prune_candidates(self, objects: Sequence[MapObject]) -> list[MapObject]:
        """Return the visible objects; if a frame has too many candidates, the least likely ones are retired."""
        candidates = [o for o in objects if not o.confirmed]
        if len(candidates) > MAX_CANDIDATES:
            for entry in sorted(candidates, key=lambda o: (-o.probability, o.number))[MAX_CANDIDATES:]:
                self.store.retire(entry)
        return [o for o in objects if o.state is not State.RETIRED]

    def update(
        self,
        seen: Observation,
        frame: SegmentedFrame,
        objects: Sequence[MapObject],
        picture: Picture,
    ) -> Association:
        """Update the map of objects with a frame.

        Parameters
        ----------
        seen : Observation
        frame : SegmentedFrame
        objects : sequence of MapObject
            From `objects_in_frustum`.
        picture : Picture
            The frame at full size.

        Returns
        -------
        Association
        """
        self.store.forget_keyframes(objects)
        segments, found = frame.segments, associate(frame, objects, self.store.boxes_of(objects))
        novelty = seen.weight
        number_of = self._update_objects(seen, segments, frame.boxes, found)
        allowed = self._allowed_transfers(number_of, found)
        self._voxels.vote_owners(segments.claim, number_of, *allowed, frame.candidate, frame.voxels.slots)
        separate = self._update_affinity(segments, found, novelty)
        self._add_overlaps(objects, novelty, separate)
        self._record_shown(seen, found)
        changed = [o.number for o in objects] + [int(n) for n in number_of if n]
        self._fitting.fit_grown(
            changed, seen.eye, new_viewpoint=seen.new_viewpoint, fixed=seen.fixed, weight=seen.weight
        )
        self._merge(changed, seen.eye)
        self._retire_abandoned(changed)
        self._measure(found, picture, seen.new_viewpoint)
        return found

    def _measure(self, found: Association, picture: Picture, new_viewpoint: bool) -> None:
        """Measure the sides of labelled objects in the frame, those with the fewest views first."""
        matched = (found.objects[j] for j in np.unique(found.match[found.match >= 0]).tolist())
        due = [
            o
            for o in matched
            if o.confirmed and view_is_due(o.sides_m, o.sightings, o.measured, new_viewpoint=new_viewpoint)
        ]
        due.sort(key=lambda o: (len(o.sides_m), o.measured, o.number))
        if due:
            self._fitting.measure(due[:MAX_MEASURED], replace(picture, color=np.ascontiguousarray(picture.color)))

    def _update_objects(
        self,
        seen: Observation,
        frame_segments: FrameSegments,
        boxes: Sequence[Box],
        found: Association,
    ) -> npt.NDArray[np.int32]:
        """Update matched objects and start candidates; return the object for which each segment votes, 0: none."""
        number_of = np.zeros(len(frame_segments.segments), np.int32)
        match, part = found.match.tolist(), found.part.tolist()
        partner = {j: i for i, j in enumerate(match) if j >= 0}
        whole = frame_segments.whole
        similarity, moving = found.similarity.tolist(), frame_segments.touched.tolist()
        for i, segment in enumerate(frame_segments.segments):
            if match[i] >= 0:
                entry = found.objects[match[i]]
                self.store.see(entry, segment, similarity[i], seen.eye, weight=seen.weight, moving=moving[i])
            elif part[i] >= 0 and not self._are_separate(frame_segments, i, partner.get(part[i])):
                number_of[i] = found.objects[part[i]].number
                continue
            else:
                if not fits_object(boxes[i], self._config):
                    continue
                entry = self.store.add(boxes[i], seen.frame, seen.keyframe)
                self.store.see(entry, segment, None, seen.eye, weight=seen.weight, moving=moving[i])
            number_of[i] = entry.number
            if whole is not None and not np.isnan(whole[i]):
                self.store.add_score(entry, float(whole[i]), frame_segments.whole_weight)
        return number_of

    @staticmethod
    def _are_separate(frame_segments: FrameSegments, i: int, j: int | None) -> bool:
        """Return whether two segments touch and come from different proposals."""
        return (
            j is not None
            and frame_segments.proposal[i] != frame_segments.proposal[j]
            and frame_segments.contact[i, j] + frame_segments.contact[j, i] > 0
        )

    def _allowed_transfers(
        self, number_of: npt.NDArray[np.int32], found: Association
    ) -> tuple[npt.NDArray[np.int64], UInt8Array]:
        """Return a column for each object number, and from which owners each segment may take voxels, (n, m + 1).

        A segment that matches its object well takes voxels without an owner, and those of candidates. It takes voxels
        of a confirmed object only if the affinity says that the two objects are different. Between two labelled objects
        half the log-odds of certainty suffice: unlike a merge, later votes can undo it, and both are complete objects.
        """
        place = np.full(self.store.numbers, -1, np.int64)
        place[0] = 0
        place[[o.number for o in found.objects]] = np.arange(1, len(found.objects) + 1)
        sure = (found.match < 0) | (found.similarity >= SURE_MATCH)
        allowed = np.zeros((len(number_of), len(found.objects) + 1), np.uint8)
        allowed[sure] = [1, *(not o.confirmed for o in found.objects)]
        numbers = number_of.tolist()
        for i in np.flatnonzero(sure).tolist():
            labelled = numbers[i] > 0 and self.store[numbers[i]].confirmed
            others = self.store.affinity.partners(
                numbers[i], max_log_odds=-CERTAIN_LOG_ODDS / 2.0 if labelled else -CERTAIN_LOG_ODDS
            )
            if others:
                columns = place[others]
                allowed[i, columns[columns > 0]] = 1
        return place, allowed

    def _update_affinity(
        self, frame_segments: FrameSegments, found: Association, novelty: float
    ) -> set[frozenset[int]]:
        """Add evidence on pairs: objects covered by one segment, and objects whose segments lie side by side.

        Return the pairs of numbers of the objects that lie side by side.
        """
        separate = set()
        # A segment shows an object if it covers half of the object's visible pixels.
        covered = (found.object_pixels >= MIN_READINGS) & (found.overlap >= 0.5 * found.object_pixels)
        for i in np.flatnonzero(covered.sum(1) > 1):
            for a, b in combinations(np.flatnonzero(covered[i]).tolist(), 2):
                self.store.add_pair_evidence(found.objects[a], found.objects[b], SAME_LOG_ODDS, novelty=novelty)
        matched, match = found.match >= 0, found.match.tolist()
        adjacent = np.triu(frame_segments.contact + frame_segments.contact.T > 0, 1) & matched & matched[:, None]
        for i, j in zip(*(k.tolist() for k in np.nonzero(adjacent)), strict=True):
            a, b = found.objects[match[i]], found.objects[match[j]]
            if self._are_separate(frame_segments, i, j) and not self._are_attached(a, b):
                shape = float(frame_segments.log_odds_one[i, j])
                # A border that does not show one surface is at least the evidence of any two proposals.
                log_odds = shape if shape > 0.0 else float(np.fmin(shape, DIFFERENT_LOG_ODDS))
                self.store.add_pair_evidence(a, b, log_odds, novelty=novelty)
                if log_odds < 0.0:
                    separate.add(frozenset((a.number, b.number)))
        return separate

    @staticmethod
    def _are_attached(a: MapObject, b: MapObject) -> bool:
        return a.holder == b.number or b.holder == a.number

    def _add_overlaps(self, objects: Sequence[MapObject], novelty: float, separate: set[frozenset[int]]) -> None:
        """Add evidence that objects which overlap in space are one: solids do not overlap.

        Pairs in `separate`, which this frame shows side by side, are left out: a box that was fitted to both objects
        overlaps the second one until the voxels have their new owner.
        """
        # An object that was seen to move is not a part of the object in which it lies now.
        entries = [o for o in objects if len(o.points) and not o.moved]
        labelled = [o for o in entries if o.confirmed]
        if not labelled:
            return
        for i, j in zip(*(k.tolist() for k in np.nonzero(self.store.overlapping(entries, labelled))), strict=True):
            first, second = entries[i], labelled[j]
            # Count each pair once, and no object with itself.
            counted = first.confirmed and first.number >= second.number
            if not counted and frozenset((first.number, second.number)) not in separate:
                self.store.add_pair_evidence(first, second, SAME_LOG_ODDS, novelty=novelty)

    def _record_shown(self, seen: Observation, found: Association) -> None:
        """Count the frame for the objects with pixels in it, and as missed for candidates with their place in it."""
        matched = set(found.match.tolist())
        shown = found.object_pixels >= MIN_READINGS
        for j in np.flatnonzero(shown).tolist():
            self.store.record_shown(found.objects[j], weight=seen.weight, matched=j in matched)
        others = [found.objects[j] for j in np.flatnonzero(~shown).tolist() if j not in matched]
        candidates = [o for o in others if o.state is State.CANDIDATE]
        for entry in places_in_view(candidates, self.store.boxes_of(candidates), seen):
            self.store.record_missed(entry, seen.weight)

    def reset_supports(self) -> None:
        """Reset the support of all objects and refit labelled ones, because the up direction has changed.

        Candidates are retired: new supporting surfaces may have been tracked as objects.
        """
        self.store.retire_all([entry for entry in self.store.living() if not entry.confirmed])
        for entry in self.store.confirmed():
            self.store.reset_support(entry)
            self._fitting.fit(entry)

    def apply_correction(self, moved: Mapping[int, Float64Array]) -> None:
        """Correct the map; each object moves with the keyframe to which most of its points are anchored.

        Parameters
        ----------
        moved : mapping of int to (4, 4) float64
            T_new_old in the world for each keyframe that moved.
        """
        self.store.apply_correction(moved)
        self._voxels.moving.apply_correction(moved)

    def begin_visit(self) -> None:
        """Begin a later visit: limit the weight of earlier sightings, so that boxes are soon refitted."""
        self._voxels.begin_visit(VISIT_HITS)
        self.store.begin_visit(VISIT_SIGHTINGS)

    def _merge(self, numbers: Sequence[int], eye: Float64Array) -> None:
        """Merge objects that are one according to their affinity; the camera is at `eye` (3,)."""
        for entry in self.store.all_of(numbers):
            number = entry.number
            if number not in self.store or entry.state is State.RETIRED:
                continue
            for other in self.store.affinity.partners(number, min_log_odds=CERTAIN_LOG_ODDS / 2.0):
                if other not in self.store:
                    continue
                evidence = self.store.affinity.of(number, other)
                a, b = self.store[number], self.store[other]
                min_log_odds = CERTAIN_LOG_ODDS if a.confirmed and b.confirmed else CERTAIN_LOG_ODDS / 2.0
                if evidence is not None and evidence >= min_log_odds:
                    self.merge(a, b, eye)
                    break

    def merge(self, first: MapObject, second: MapObject, eye: Float64Array | None = None) -> MapObject:
        """Merge two objects and return the result; `eye` (3,) is the position of a camera that sees them, if any."""
        kept, _ = self.store.merge(first, second)
        self._fitting.fit(kept, eye)
        return kept

    def _retire_abandoned(self, numbers: Sequence[int]) -> None:
        """Retire candidates that are not seen any more."""
        self.store.retire_all(abandoned(self.store.all_of(numbers), self._voxels))

    def record_seen(
        self, frame: int, seen: Sequence[MapObject], has_rested: Callable[[MapObject], bool]
    ) -> list[MapObject]:
        """Record that a frame shows these objects; confirm the candidates among them that meet all criteria.

        The most probable one gets the first label: of two labels for one thing, the older one stays in a merge.

        Parameters
        ----------
        frame : int
        seen : sequence of MapObject
        has_rested : callable
            Returns whether a candidate that meets all other criteria has been at rest long enough to get a label.

        Returns
        -------
        list of MapObject
            The newly confirmed objects.
        """
        for entry in seen:
            self.store.judge(entry, probability(quantities_of(entry)))
        candidates = [o for o in seen if o.state is State.CANDIDATE and is_confirmable(o, self._config)]
        confirmed = sorted(filter(has_rested, candidates), key=lambda o: (-o.probability, o.number))
        for entry in confirmed:
            self.store.confirm(entry)
        self.store.record_seen(seen, frame)
        return confirmed
