"""Objects that move while the camera watches: they leave, are followed, rest again, or are gone and come back.

An object leaves when frames see through most of it while something moves near it. As long as its shape and colors are
found from frame to frame, it is followed as a rigid cluster. It rests when it has stood on a surface for a while. One
that left while the camera looked elsewhere is missed later (`presence`). A lost object waits with its label: a new
object of similar size and colors gets this label, as between two visits. An object that waits for too long is gone. If
it leaves less than two seconds after it got its label, the label ends.
A new object gets a label within a second after it came to rest; hands and people seldom rest for so long.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.limits import SAMPLE_POINTS
from cuboid.ground.core.observation import Observation
from cuboid.ground.core.results import ObjectEvent, Sighting
from cuboid.ground.core.tolerances import BIAS_M, DRIFT_M, MIN_READINGS
from cuboid.ground.core.values import EventName
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.overlap import pack
from cuboid.ground.geometry.se3 import inverse, transform
from cuboid.method.heatmap.motion import REST_S, groups_of
from cuboid.method.heatmap.voxel_map import VoxelMap
from cuboid.method.objects.arrivals import IN_PLACE_M, Arrivals
from cuboid.method.objects.cluster import Cluster, Fit
from cuboid.method.objects.entry import MapObject, State
from cuboid.method.objects.kernels.leaving import count_passed
from cuboid.method.objects.presence import DOUBTED, GONE, Rays, doubts
from cuboid.method.objects.similarity import ColorProfile, color_profile_of, most_similar, similarity
from cuboid.method.objects.store import ObjectStore
from cuboid.method.objects.visibility import measure_visibility, objects_in_frustum
from cuboid.method.poses.pyramid import Level, levels_of
from cuboid.method.surfaces.planes import PlaneTracker

# An object begins to move when frames see through the first fraction of the visible part of its place. It has left when
# all frames of this time, seconds, and at least two, see through the second fraction.
MOVING_FRACTION, DEPARTED_FRACTION, DEPARTED_S = 0.2, 0.5, 0.06
# An object leaves in view if something moved within this distance of it, metres: about the width of a hand.
MOTION_GAP_M = 0.1
# Largest distance of an object from its place in the first frame of its motion, and later from its expected place,
# metres.
FIRST_REACH_M, EXPECTED_REACH_M = 0.08, 0.04
# A followed object has moved if its new place explains more of its points than its last one, by this fraction.
MOVED_BETTER = 0.05
# An object that begins to move is elsewhere if the other place explains more of its points, by this fraction.
ELSEWHERE_BETTER = 0.2
# A followed object that is not found for this time, seconds, is lost.
LOST_S = 0.5
# An object is at rest after it has stood on a surface for the first time, seconds, or has not moved for the second one:
# its center stays within this distance, metres.
SET_DOWN_S, STILL_S, REST_M = 0.4, 1.6, 0.01
# Something moves at a candidate if it did less than this ago, seconds: marks of motion flicker.
TOUCHED_S = 0.2
# A thing that was not there before gets a label this long after its readings count as still, seconds: within a second
# after it came to rest.
NEW_REST_S = 0.3
# An object was moved if its center is farther than this from its earlier place, metres: boxes may err by less.
MOVED_M = 0.05
# An object that left and was not recognized for this time is gone, seconds: to carry one across a table takes two.
GONE_S = 5.0
# An object that leaves less than this after it got its label was a part of what moved, seconds: its label ends.
NEW_LABEL_S = 2.0
# A new object is compared with waiting ones for this time, seconds: its box and colors improve.
COMPARED_S = 1.0
# Fraction of the points of a moving body that may be outliers, at each side.
AGENT_OUTLIERS = 0.02


@dataclass(slots=True)
class _Gone:
    """An object that has left its place."""

    entry: MapObject
    profile: ColorProfile
    from_box: Box
    since_s: float
    reported: bool = False


@dataclass(frozen=True, slots=True)
class _Newcomer:
    """A candidate at the time at which it first met all other criteria of an object.

    Attributes
    ----------
    since_s : float
        Time of its first frame, seconds; of one `REST_S` ago if that was earlier.
    complete_s : float
        Time at which it met the criteria, seconds.
    was_absent : bool
        Whether an earlier view shows that it was not there.
    has_come : bool
        Whether something moved at its place, which was empty.
    """

    since_s: float
    complete_s: float
    was_absent: bool
    has_come: bool


@dataclass(slots=True)
class _Followed:
    """An object that moves: where it was found in the last frames."""

    entry: MapObject
    profile: ColorProfile
    cluster: Cluster
    from_box: Box
    points: Float32Array
    since_s: float
    found_s: float
    T: Float64Array = field(default_factory=lambda: np.eye(4))
    step: Float64Array = field(default_factory=lambda: np.eye(4))
    score: float = 1.0
    missing: bool = False
    path: deque[tuple[float, Float64Array]] = field(default_factory=deque)


class Following:
    """Keeps the labels of objects that move while the camera watches.

    Parameters
    ----------
    config : TrackerConfig
    store : ObjectStore
    voxels : VoxelMap
    planes : PlaneTracker

    Attributes
    ----------
    agents : list of Box
        Boxes of moving bodies that are no objects, in the last frame, in the world of the map.
    """

    def __init__(self, config: TrackerConfig, store: ObjectStore, voxels: VoxelMap, planes: PlaneTracker) -> None:
        self._config, self._store, self._voxels, self._planes = config, store, voxels, planes
        self._followed: list[_Followed] = []
        self._gone: list[_Gone] = []
        # Times of the first and the last frame with motion near each object, by number, seconds.
        self._motion_s: dict[int, tuple[float, float]] = {}
        # Time since which each object has left in all frames of a camera, by number and camera, seconds.
        self._departed_s: dict[tuple[int, str], float] = {}
        # Objects that came to rest, each with the time until which readings in its place count as still.
        self._settled: list[tuple[MapObject, float]] = []
        # Time of the last frame with motion at each candidate, by number.
        self._touched_s: dict[int, float] = {}
        # Times of the frames of the last `REST_S`, by frame, seconds.
        self._time_s: dict[int, float] = {}
        # Candidates that meet all other criteria, and new objects, by number.
        self._newcomers: dict[int, _Newcomer] = {}
        # Times at which objects got a new label, by number; the new objects that came while the camera watched.
        self._labelled_s: dict[int, float] = {}
        self._came: list[MapObject] = []
        # Whether the last frame shows an object that is rather gone than there, but not certainly.
        self._in_doubt = False
        self._arrivals = Arrivals(config.depth_noise_per_m)
        self._events: list[ObjectEvent] = []
        self._levels: tuple[Level, ...] | None = None
        self.agents: list[Box] = []

    def raise_noise(self, config: TrackerConfig) -> None:
        """Use a configuration with more depth noise: a camera of the rig has more than the earlier ones."""
        self._config = config
        self._arrivals.raise_noise(config.depth_noise_per_m)

    @property
    def gone(self) -> list[MapObject]:
        """The objects that left and are reported as gone, in the order in which they left."""
        return [one.entry for one in self._gone if one.reported]

    def take_events(self) -> list[ObjectEvent]:
        """Return the events since the last call, in the world of the map."""
        events, self._events = self._events, []
        return events

    # --- one frame -------------------------------------------------------------------------------------------------

    def begin_frame(self, seen: Observation, time_s: float) -> Observation:
        """Follow moving objects; return the frame with followed objects marked as moving, and settled ones as still."""
        self._levels = None
        self._time_s = {frame: at_s for frame, at_s in self._time_s.items() if time_s - at_s <= REST_S}
        self._time_s[seen.frame] = time_s
        self._touched_s = {number: at_s for number, at_s in self._touched_s.items() if time_s - at_s < REST_S}
        self._settled = [(entry, until_s) for entry, until_s in self._settled if time_s < until_s]
        self._arrivals.note_view(seen, time_s)
        if seen.moving is not None:
            places = _points_of(seen)
            self._arrivals.note_motion(places)
            self._note_motion(places, time_s)
        self._find_leaving(seen, time_s)
        for followed in list(self._followed):
            self._follow(followed, seen, time_s)
        self._report_gone(time_s)
        self.agents = self._find_agents(seen)
        if seen.moving is None and not self._followed:
            return seen
        return replace(seen, moving=self._moving(seen))

    def _find_agents(self, seen: Observation) -> list[Box]:
        """Return the boxes, along the axes of the map, of moving bodies that are no objects."""
        if seen.moving is None:
            return []
        moving = np.asarray(seen.moving & (seen.image.depth_m > 0), np.uint8)
        for entry in [entry for entry, _ in self._settled] + [followed.entry for followed in self._followed]:
            _mark_inside(entry.box, DRIFT_M, seen, moving, 0)
        boxes = []
        for group in groups_of(moving):
            v, u = np.nonzero(group)
            points = _places(v, u, seen)
            low, high = np.quantile(points, [AGENT_OUTLIERS, 1.0 - AGENT_OUTLIERS], axis=0)
            boxes.append(Box((low + high) / 2, np.maximum(high - low, BIAS_M), np.eye(3)))
        return boxes

    def _moving(self, seen: Observation) -> UInt8Array | None:
        """Return which readings move: also those of followed objects, but not those of settled ones."""
        depth_m = seen.image.depth_m
        moving = np.zeros(depth_m.shape, np.uint8) if seen.moving is None else seen.moving.copy()
        for entry, _ in self._settled:
            _mark_inside(entry.box, BIAS_M, seen, moving, 0)
        for followed in self._followed:
            _mark_inside(followed.entry.box, 2 * BIAS_M, seen, moving, 1)
        return moving if moving.any() else None

    def _find_leaving(self, seen: Observation, time_s: float) -> None:
        """Find the labelled objects that begin to move, that have left, and that are no longer in their place."""
        entries = self._in_view(seen)
        rays = {entry.number: self._rays(entry, seen) for entry in entries}
        after = doubts(rays, {entry.number: entry.doubt for entry in entries}, seen.weight)
        for number, doubt in after.items():
            self._store.doubt(self._store[number], doubt)
        self._in_doubt = any(DOUBTED < doubt < GONE for doubt in after.values())
        near_motion = self._near_motion(time_s)
        for entry in entries:
            shown = rays[entry.number]
            enough = shown.through >= MIN_READINGS
            if entry.number in near_motion:
                if enough and shown.fraction >= DEPARTED_FRACTION:
                    self._departed_s.setdefault((entry.number, seen.camera), time_s)
                else:
                    self._departed_s.pop((entry.number, seen.camera), None)
                if enough and shown.fraction >= MOVING_FRACTION:
                    self._let_go(entry, seen, time_s)
            elif entry.doubt >= GONE:
                self._let_wait(entry, time_s)

    def _in_view(self, seen: Observation) -> list[MapObject]:
        """Return the labelled objects that reach into the picture, by number."""
        entries = objects_in_frustum(self._store, seen.image, seen.T_camera_world, self._config.max_depth_m)
        return [entry for entry in entries if entry.confirmed and len(entry.points)]

    def _rays(self, entry: MapObject, seen: Observation) -> Rays:
        image, points = seen.image, np.ascontiguousarray(entry.points[:: 1 + len(entry.points) // SAMPLE_POINTS])
        T, noise = np.ascontiguousarray(seen.T_camera_world), self._config.depth_noise_per_m
        return Rays(*count_passed(points, image.depth_m, image.camera.pinhole, T, IN_PLACE_M, noise))

    def _note_motion(self, places: Float32Array, time_s: float) -> None:
        """Record near which labelled objects something moves."""
        centers = (np.unique(np.floor(places / MOTION_GAP_M), axis=0) + 0.5) * MOTION_GAP_M
        for entry in self._store.confirmed():
            if entry.box.distances_m(centers).min(initial=np.inf) < MOTION_GAP_M:
                self._motion_s[entry.number] = self._motion_s.get(entry.number, (time_s, time_s))[0], time_s

    def _near_motion(self, time_s: float) -> frozenset[int]:
        """Return the numbers of the objects near which something moved for long enough, and not long ago."""
        self._motion_s = {number: at_s for number, at_s in self._motion_s.items() if time_s - at_s[1] < GONE_S}
        return frozenset(n for n, (first_s, last_s) in self._motion_s.items() if last_s - first_s >= DEPARTED_S)

    def _let_go(self, entry: MapObject, seen: Observation, time_s: float) -> None:
        """Follow an object that begins to move; if it has left and is not found, its label waits."""
        young = self._is_young(entry, time_s)
        noise = self._config.depth_noise_per_m
        cluster = Cluster(entry.points, entry.colors, seen.image, seen.T_camera_world, noise)
        found = None if young else cluster.find(seen, self._levels_of(seen), np.eye(4), FIRST_REACH_M)
        if found is not None and _is_elsewhere(found, cluster.fit_at(seen, np.eye(4)), entry.box):
            profile, box = color_profile_of(entry), entry.box
            self._remove(entry)
            followed = _Followed(entry, profile, cluster, box, entry.points, time_s, time_s)
            self._followed.append(followed)
        elif time_s - self._departed_s.get((entry.number, seen.camera), time_s) >= DEPARTED_S:
            self._let_wait(entry, time_s)

    def _let_wait(self, entry: MapObject, time_s: float) -> None:
        """Remove an object that has left its place; its label waits, unless it is too young."""
        young = self._is_young(entry, time_s)
        self._remove(entry)
        if not young:
            self._gone.append(_Gone(entry, color_profile_of(entry), entry.box, time_s))

    def _is_young(self, entry: MapObject, time_s: float) -> bool:
        since_s = self._labelled_s.get(entry.number)
        return since_s is not None and time_s - since_s < NEW_LABEL_S

    def _remove(self, entry: MapObject) -> None:
        self._departed_s = {key: at_s for key, at_s in self._departed_s.items() if key[0] != entry.number}
        self._settled = [settled for settled in self._settled if settled[0] is not entry]
        self._store.lift(entry)

    def _levels_of(self, seen: Observation) -> tuple[Level, ...]:
        self._levels = self._levels or levels_of(seen.image)
        return self._levels

    # --- followed objects ------------------------------------------------------------------------------------------

    def _follow(self, followed: _Followed, seen: Observation, time_s: float) -> None:
        expected = followed.step @ followed.T
        stays = followed.cluster.fit_at(seen, followed.T)
        found = followed.cluster.find(seen, self._levels_of(seen), expected, EXPECTED_REACH_M)
        if stays is not None and (found is None or found.balance < stays.balance + MOVED_BETTER):
            found = stays
        if found is None:
            followed.missing = True
            if time_s - followed.found_s >= LOST_S:
                self._followed.remove(followed)
                self._gone.append(_Gone(followed.entry, followed.profile, followed.from_box, followed.since_s))
            return
        followed.missing, followed.found_s = False, time_s
        followed.step = found.T_now_start @ inverse(followed.T)
        followed.T, followed.score = found.T_now_start, found.score
        points = transform(followed.T, followed.points).astype(np.float32)
        self._store.move(followed.entry, followed.from_box.moved(followed.T), points)
        followed.path.append((time_s, followed.entry.box.center))
        while followed.path and time_s - followed.path[0][0] > SET_DOWN_S + STILL_S:
            followed.path.popleft()
        if self._rests(followed, time_s):
            self._settle(followed, time_s)

    def _rests(self, followed: _Followed, time_s: float) -> bool:
        wait_s = SET_DOWN_S if self._stands(followed.entry.box) else STILL_S
        late = [center for at_s, center in followed.path if time_s - at_s <= wait_s]
        if time_s - followed.path[0][0] < wait_s or len(late) < 2:
            return False
        return bool(np.linalg.norm(np.array(late) - late[-1], axis=1).max() < REST_M)

    def _stands(self, box: Box) -> bool:
        return any(abs(box.foot_m(*self._planes.in_world(plane))) < DRIFT_M for plane in self._planes.in_use)

    def _settle(self, followed: _Followed, time_s: float) -> None:
        """End the motion of a followed object at its present place."""
        self._followed.remove(followed)
        self._store.set_down(followed.entry, followed.entry.box)
        self._settled.append((followed.entry, time_s + REST_S + SET_DOWN_S))
        if np.linalg.norm(followed.entry.box.center - followed.from_box.center) > MOVED_M:
            self._report("moved", followed.entry, followed.from_box, followed.entry.box, followed.score)

    def claim(self, slots: npt.NDArray[np.int32], seen: Observation) -> None:
        """Assign the voxels (H, W) of a frame that lie in settled objects to these objects."""
        for entry, _ in self._settled:
            inside = np.zeros(slots.shape, np.uint8)
            _mark_inside(entry.box, BIAS_M, seen, inside, 1)
            rows = slots[(inside > 0) & (slots >= 0)].astype(np.int64)
            self._voxels.claim(rows, entry.number)

    # --- waiting objects -------------------------------------------------------------------------------------------

    def _report_gone(self, time_s: float) -> None:
        # Between visits to a scene, another object may have taken over the label.
        self._gone = [one for one in self._gone if one.entry.number in self._store]
        for gone in self._gone:
            if not gone.reported and time_s - gone.since_s >= GONE_S:
                gone.reported = self._report("gone", gone.entry, gone.from_box, None, 1.0)

    def note_labels(self, entries: Sequence[MapObject], frame: int, time_s: float) -> None:
        """Compare objects with a new label, if they came while the camera watched, with the waiting ones.

        An object that resembles none of these has appeared. The event is reported when the object is seen a second
        later: by then a hand has left the place.
        """
        self._forget_newcomers(entries)
        self._labelled_s |= {entry.number: time_s for entry in entries}
        self._labelled_s = {k: at_s for k, at_s in self._labelled_s.items() if time_s - at_s < NEW_LABEL_S}
        came = [
            *self._came,
            *(entry for entry in entries if self._is_new_in_its_place(entry) or self._is_in_old_place(entry)),
        ]
        self._came = []
        for entry in came:
            if not entry.confirmed or self._recognize(entry):
                continue
            young = time_s - self._newcomers[entry.number].complete_s < COMPARED_S
            if young or entry.last_frame < frame or self._in_doubt:
                self._came.append(entry)
            elif self._newcomers[entry.number].has_come:
                self._report("appeared", entry, None, entry.box, entry.score)

    def _forget_newcomers(self, entries: Sequence[MapObject]) -> None:
        """Forget candidates that were retired or got their label, except for these objects and those that came."""
        kept = {entry.number for entry in (*entries, *self._came)}
        self._newcomers = {
            number: newcomer
            for number, newcomer in self._newcomers.items()
            if number in kept or (number in self._store and self._store[number].state is State.CANDIDATE)
        }

    def _recognize(self, entry: MapObject) -> bool:
        """Give a new object the label of a waiting one, if it is similar to that one and to no other."""
        best, scores = self._waiting_like(entry)
        if best is None:
            return False
        gone = self._gone.pop(best)
        self._store.take_over(entry, gone.entry)
        if gone.reported:
            self._report("back", entry, gone.from_box, entry.box, scores[best])
        elif np.linalg.norm(entry.box.center - gone.from_box.center) > MOVED_M:
            self._report("moved", entry, gone.from_box, entry.box, scores[best])
        return True

    def _waiting_like(self, entry: MapObject) -> tuple[int | None, list[float]]:
        """Return the index of the one waiting object that a new one is similar to, None: none, and all similarities."""
        if not self._gone:
            return None, []
        profile = color_profile_of(entry)
        scores = [similarity(profile, entry.box, gone.profile, gone.from_box) for gone in self._gone]
        return most_similar(scores), scores

    def _is_new_in_its_place(self, entry: MapObject) -> bool:
        newcomer = self._newcomers[entry.number]
        return newcomer.has_come or newcomer.was_absent

    def _is_in_old_place(self, entry: MapObject) -> bool:
        """Return whether an object is where one was that seemed to leave."""
        return any(np.linalg.norm(entry.box.center - gone.from_box.center) < MOVED_M for gone in self._gone)

    def _report(self, event: EventName, entry: MapObject, before: Box | None, after: Box | None, score: float) -> bool:
        """Report an event, unless the object is too improbable for results; return whether it was reported."""
        if entry.score < self._config.min_probability:
            return False
        from_m, to_m = (None if box is None else box.center for box in (before, after))
        self._events.append(ObjectEvent(event, entry.label, from_m, to_m, score))
        return True

    # --- candidates ------------------------------------------------------------------------------------------------

    def note_touched(self, numbers: Sequence[int], time_s: float) -> None:
        """Store the time at which something moves at these objects, by number."""
        for number in numbers:
            self._touched_s[number] = time_s

    def has_rested(self, entry: MapObject, time_s: float) -> bool:
        """Return whether a complete candidate may get a label.

        Nothing moves at it. If it was not there before, it has rested for `NEW_REST_S`, or is similar to an object that
        left.
        """
        touched_s = self._touched_s.get(entry.number, -np.inf)
        if time_s - touched_s < TOUCHED_S:
            return False
        if entry.number not in self._newcomers:
            since_s = self._time_s.get(entry.first_frame, min(self._time_s.values()))
            was_absent, has_come = self._arrivals.was_absent(entry), self._arrivals.has_come(entry)
            self._newcomers[entry.number] = _Newcomer(since_s, time_s, was_absent, has_come)
        newcomer = self._newcomers[entry.number]
        rested_s = time_s - max(newcomer.since_s, touched_s)
        return not newcomer.was_absent or rested_s >= NEW_REST_S or self._waiting_like(entry)[0] is not None

    # --- results ---------------------------------------------------------------------------------------------------

    def sightings(
        self, shown: tuple[Sighting, ...], seen: Observation, slots: npt.NDArray[np.int32]
    ) -> tuple[Sighting, ...]:
        """Return the sightings of a frame, whose voxels are `slots` (H, W), with those of followed objects."""
        present = [item.entry for item in self._followed if not item.missing]
        if not present:
            return shown
        boxes = pack([entry.box for entry in present])
        views = measure_visibility(
            present, boxes, seen, slots, self._voxels.stored.owner, self._config.depth_noise_per_m
        )
        found = list(shown)
        for entry, view in zip(present, views, strict=True):
            if view.seen:
                self._store.record_seen([entry], seen.frame)
            if view.seen and entry.score >= self._config.min_probability:
                values = entry.label, entry.box, None, view.visible, view.rect_xyxy
                found.append(Sighting(*values, probability=entry.score))
        return tuple(sorted(found, key=lambda item: item.label))


def _points_of(seen: Observation) -> Float32Array:
    """Return the points (N, 3) of moving readings in the world: every third reading in both directions."""
    assert seen.moving is not None
    v, u = np.nonzero(seen.moving[::3, ::3] & (seen.image.depth_m[::3, ::3] > 0))
    return _places(3 * v, 3 * u, seen)


def _places(v: npt.NDArray[np.int64], u: npt.NDArray[np.int64], seen: Observation) -> Float32Array:
    points = seen.image.camera.points(u, v, seen.image.depth_m[v, u])
    return transform(seen.T_world_camera, points).astype(np.float32)


def _mark_inside(box: Box, beyond_m: float, seen: Observation, marks: UInt8Array, value: int) -> None:
    """Set the marks (h, w) of the readings that lie in a box."""
    c, (height, width) = seen.image.camera, marks.shape
    corners = transform(seen.T_camera_world, box.corners())
    corners[:, 2] = np.maximum(corners[:, 2], DRIFT_M)
    u, v = c.pixels(corners).T
    left, right = np.clip([u.min() - 3, u.max() + 4], 0, width).astype(int)
    top, bottom = np.clip([v.min() - 3, v.max() + 4], 0, height).astype(int)
    if right <= left or bottom <= top:
        return
    rows, columns = np.nonzero(seen.image.depth_m[top:bottom, left:right] > 0)
    rows, columns = rows + top, columns + left
    inside = box.contains(_places(rows, columns, seen), beyond_m)
    marks[rows[inside], columns[inside]] = value


def _is_elsewhere(found: Fit, in_place: Fit | None, box: Box) -> bool:
    """Return whether an object was found elsewhere, and clearly better than in its place."""
    far = np.linalg.norm(transform(found.T_now_start, box.center) - box.center) > REST_M
    return bool(far and (in_place is None or found.balance >= in_place.balance + ELSEWHERE_BETTER))
