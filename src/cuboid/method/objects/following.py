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
from enum import Enum

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


class Phase(Enum):
    """Phase of the motion of an object."""

    RESTS = "rests"
    # It is followed from frame to frame.
    MOVES = "moves"
    # It came to rest; earlier frames still mark readings in its place as moving.
    SETTLES = "settles"
    # It left, and its label waits.
    WAITS = "waits"
    # It waited for too long, and this was reported.
    GONE = "gone"


@dataclass(frozen=True, slots=True)
class _Arrival:
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

    @property
    def is_new(self) -> bool:
        """Whether the object was not there before."""
        return self.was_absent or self.has_come


@dataclass(slots=True)
class _Departure:
    """How an object left its place.

    Attributes
    ----------
    profile : ColorProfile
    from_box : Box
        Its box before.
    since_s : float
        Time at which it left, seconds.
    """

    profile: ColorProfile
    from_box: Box
    since_s: float


@dataclass(slots=True)
class _Motion:
    """The motion of a followed object in the last frames.

    Attributes
    ----------
    cluster : Cluster
    points : (N, 3) float32
        Its points before.
    found_s : float
        Time of the last frame in which it was found, seconds.
    T, step : (4, 4) float64
        Its motion since it left, and that of the last frame.
    score : float
    missing : bool
        Whether the last frame does not show it.
    path : deque of (float, (3,) float64)
        Times, seconds, and centers of the last frames.
    """

    cluster: Cluster
    points: Float32Array
    found_s: float
    T: Float64Array = field(default_factory=lambda: np.eye(4))
    step: Float64Array = field(default_factory=lambda: np.eye(4))
    score: float = 1.0
    missing: bool = False
    path: deque[tuple[float, Float64Array]] = field(default_factory=deque)


@dataclass(slots=True)
class _Life:
    """Everything that is known of the motion of one object. Times are in seconds.

    Attributes
    ----------
    entry : MapObject
    phase : Phase
    near_s : (float, float) or None
        Times of the first and the last frame with motion near it.
    departed_s : dict of str to float
        Time since which it has left in all frames of a camera, by camera.
    touched_s : float
        Time of the last frame with motion at it.
    arrival : _Arrival or None
        Of a candidate that meets all other criteria, and of a new object.
    labelled_s : float
        Time at which it got a new label.
    is_compared : bool
        Whether it is a new object that is compared with waiting ones.
    still_until_s : float
        Time until which readings in its place count as still, in the phase SETTLES.
    departure : _Departure or None
        In the phases MOVES, WAITS and GONE.
    motion : _Motion or None
        In the phase MOVES.
    """

    entry: MapObject
    phase: Phase = Phase.RESTS
    near_s: tuple[float, float] | None = None
    departed_s: dict[str, float] = field(default_factory=dict)
    touched_s: float = -np.inf
    arrival: _Arrival | None = None
    labelled_s: float = -np.inf
    is_compared: bool = False
    still_until_s: float = -np.inf
    departure: _Departure | None = None
    motion: _Motion | None = None

    def forget(self, time_s: float) -> None:
        """Forget what is too long ago to count."""
        if self.phase is Phase.SETTLES and time_s >= self.still_until_s:
            self.phase = Phase.RESTS
        if self.near_s is not None and time_s - self.near_s[1] >= GONE_S:
            self.near_s = None
        if time_s - self.touched_s >= REST_S:
            self.touched_s = -np.inf
        if time_s - self.labelled_s >= NEW_LABEL_S:
            self.labelled_s = -np.inf
        if not self.is_compared and self.entry.state is not State.CANDIDATE:
            self.arrival = None

    @property
    def is_young(self) -> bool:
        """Whether it got its label so lately that it was a part of what moves."""
        return self.labelled_s > -np.inf

    @property
    def is_empty(self) -> bool:
        """Whether nothing is known that differs from an object that rests."""
        known = self.near_s is not None or self.departed_s or self.arrival is not None
        return self.phase is Phase.RESTS and not known and max(self.touched_s, self.labelled_s) == -np.inf


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
        self._lives: dict[int, _Life] = {}
        # Times of the frames of the last `REST_S`, by frame, seconds.
        self._time_s: dict[int, float] = {}
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
        return [life.entry for life, _ in self._left(Phase.GONE)]

    def _life_of(self, entry: MapObject) -> _Life:
        return self._lives.setdefault(entry.number, _Life(entry))

    def _in_phase(self, phase: Phase) -> list[_Life]:
        return [life for life in self._lives.values() if life.phase is phase]

    def _moving_ones(self) -> list[tuple[_Life, _Departure, _Motion]]:
        return [(o, o.departure, o.motion) for o in self._in_phase(Phase.MOVES) if o.departure and o.motion]

    def _left(self, *phases: Phase) -> list[tuple[_Life, _Departure]]:
        """Return the objects that left and are in one of these phases, in the order in which they left."""
        found = [(life, life.departure) for phase in phases for life in self._in_phase(phase) if life.departure]
        return sorted(found, key=lambda one: (one[1].since_s, one[0].entry.number))

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
        for life in self._lives.values():
            life.forget(time_s)
        self._lives = {number: life for number, life in self._lives.items() if not life.is_empty}
        self._arrivals.note_view(seen, time_s)
        if seen.moving is not None:
            places = _points_of(seen)
            self._arrivals.note_motion(places)
            self._note_motion(places, time_s)
        self._find_leaving(seen, time_s)
        for life, departure, motion in self._moving_ones():
            self._follow(life, departure, motion, seen, time_s)
        self._report_gone(time_s)
        self.agents = self._find_agents(seen)
        if seen.moving is None and not self._in_phase(Phase.MOVES):
            return seen
        return replace(seen, moving=self._moving(seen))

    def _find_agents(self, seen: Observation) -> list[Box]:
        """Return the boxes, along the axes of the map, of moving bodies that are no objects."""
        if seen.moving is None:
            return []
        moving = np.asarray(seen.moving & (seen.image.depth_m > 0), np.uint8)
        for life in self._in_phase(Phase.SETTLES) + self._in_phase(Phase.MOVES):
            _mark_inside(life.entry.box, DRIFT_M, seen, moving, 0)
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
        for life in self._in_phase(Phase.SETTLES):
            _mark_inside(life.entry.box, BIAS_M, seen, moving, 0)
        for life in self._in_phase(Phase.MOVES):
            _mark_inside(life.entry.box, 2 * BIAS_M, seen, moving, 1)
        return moving if moving.any() else None

    def _find_leaving(self, seen: Observation, time_s: float) -> None:
        """Find the labelled objects that begin to move, that have left, and that are no longer in their place."""
        entries = self._in_view(seen)
        rays = {entry.number: self._rays(entry, seen) for entry in entries}
        after = doubts(rays, {entry.number: entry.doubt for entry in entries}, seen.weight)
        for number, doubt in after.items():
            self._store.doubt(self._store[number], doubt)
        self._in_doubt = any(DOUBTED < doubt < GONE for doubt in after.values())
        for entry in entries:
            shown, life = rays[entry.number], self._lives.get(entry.number)
            enough = shown.through >= MIN_READINGS
            if life is not None and life.near_s is not None and life.near_s[1] - life.near_s[0] >= DEPARTED_S:
                if enough and shown.fraction >= DEPARTED_FRACTION:
                    life.departed_s.setdefault(seen.camera, time_s)
                else:
                    life.departed_s.pop(seen.camera, None)
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
                life = self._life_of(entry)
                life.near_s = (life.near_s or (time_s, time_s))[0], time_s

    def _let_go(self, entry: MapObject, seen: Observation, time_s: float) -> None:
        """Follow an object that begins to move; if it has left and is not found, its label waits."""
        life, noise = self._life_of(entry), self._config.depth_noise_per_m
        cluster = Cluster(entry.points, entry.colors, seen.image, seen.T_camera_world, noise)
        young = life.is_young
        found = None if young else cluster.find(seen, self._levels_of(seen), np.eye(4), FIRST_REACH_M)
        if found is not None and _is_elsewhere(found, cluster.fit_at(seen, np.eye(4)), entry.box):
            life.motion = _Motion(cluster, entry.points, time_s)
            self._depart(life, Phase.MOVES, time_s)
        elif time_s - life.departed_s.get(seen.camera, time_s) >= DEPARTED_S:
            self._let_wait(entry, time_s)

    def _let_wait(self, entry: MapObject, time_s: float) -> None:
        """Remove an object that has left its place; its label waits, unless it is too young."""
        life = self._life_of(entry)
        self._depart(life, Phase.RESTS if life.is_young else Phase.WAITS, time_s)

    def _depart(self, life: _Life, phase: Phase, time_s: float) -> None:
        life.departure = _Departure(color_profile_of(life.entry), life.entry.box, time_s)
        life.phase, life.departed_s = phase, {}
        self._store.lift(life.entry)

    def _levels_of(self, seen: Observation) -> tuple[Level, ...]:
        self._levels = self._levels or levels_of(seen.image)
        return self._levels

    # --- followed objects ------------------------------------------------------------------------------------------

    def _follow(self, life: _Life, departure: _Departure, motion: _Motion, seen: Observation, time_s: float) -> None:
        stays = motion.cluster.fit_at(seen, motion.T)
        found = motion.cluster.find(seen, self._levels_of(seen), motion.step @ motion.T, EXPECTED_REACH_M)
        if stays is not None and (found is None or found.balance < stays.balance + MOVED_BETTER):
            found = stays
        if found is None:
            motion.missing = True
            if time_s - motion.found_s >= LOST_S:
                life.phase, life.motion = Phase.WAITS, None
            return
        motion.missing, motion.found_s = False, time_s
        motion.step = found.T_now_start @ inverse(motion.T)
        motion.T, motion.score = found.T_now_start, found.score
        points = transform(motion.T, motion.points).astype(np.float32)
        self._store.move(life.entry, departure.from_box.moved(motion.T), points)
        motion.path.append((time_s, life.entry.box.center))
        while motion.path and time_s - motion.path[0][0] > SET_DOWN_S + STILL_S:
            motion.path.popleft()
        if self._rests(life.entry, motion, time_s):
            self._settle(life, departure, motion, time_s)

    def _rests(self, entry: MapObject, motion: _Motion, time_s: float) -> bool:
        wait_s = SET_DOWN_S if self._stands(entry.box) else STILL_S
        late = [center for at_s, center in motion.path if time_s - at_s <= wait_s]
        if time_s - motion.path[0][0] < wait_s or len(late) < 2:
            return False
        return bool(np.linalg.norm(np.array(late) - late[-1], axis=1).max() < REST_M)

    def _stands(self, box: Box) -> bool:
        return any(abs(box.foot_m(*self._planes.in_world(plane))) < DRIFT_M for plane in self._planes.in_use)

    def _settle(self, life: _Life, departure: _Departure, motion: _Motion, time_s: float) -> None:
        """End the motion of a followed object at its present place."""
        entry = life.entry
        life.phase, life.still_until_s = Phase.SETTLES, time_s + REST_S + SET_DOWN_S
        life.motion = life.departure = None
        self._store.set_down(entry, entry.box)
        if np.linalg.norm(entry.box.center - departure.from_box.center) > MOVED_M:
            self._report("moved", entry, departure.from_box, entry.box, motion.score)

    def claim(self, slots: npt.NDArray[np.int32], seen: Observation) -> None:
        """Assign the voxels (H, W) of a frame that lie in settled objects to these objects."""
        for life in self._in_phase(Phase.SETTLES):
            inside = np.zeros(slots.shape, np.uint8)
            _mark_inside(life.entry.box, BIAS_M, seen, inside, 1)
            rows = slots[(inside > 0) & (slots >= 0)].astype(np.int64)
            self._voxels.claim(rows, life.entry.number)

    # --- waiting objects -------------------------------------------------------------------------------------------

    def _report_gone(self, time_s: float) -> None:
        # Between visits to a scene, another object may have taken over the label.
        for life, departure in self._left(Phase.WAITS, Phase.GONE):
            if life.entry.number not in self._store:
                del self._lives[life.entry.number]
                continue
            late = life.phase is Phase.WAITS and time_s - departure.since_s >= GONE_S
            if late and self._report("gone", life.entry, departure.from_box, None, 1.0):
                life.phase = Phase.GONE

    def note_labels(self, entries: Sequence[MapObject], frame: int, time_s: float) -> None:
        """Compare objects with a new label, if they came while the camera watched, with the waiting ones.

        An object that resembles none of these has appeared. The event is reported when the object is seen a second
        later: by then a hand has left the place.
        """
        for entry in entries:
            life = self._life_of(entry)
            life.labelled_s = time_s
            life.is_compared = (life.arrival is not None and life.arrival.is_new) or self._is_in_old_place(entry)
        came = [(life, life.arrival) for life in self._lives.values() if life.is_compared and life.arrival]
        for life, arrival in sorted(came, key=lambda one: (one[1].complete_s, one[0].entry.number)):
            entry, life.is_compared = life.entry, False
            if not entry.confirmed or self._recognize(entry):
                continue
            young = time_s - arrival.complete_s < COMPARED_S
            if young or entry.last_frame < frame or self._in_doubt:
                life.is_compared = True
            elif arrival.has_come:
                self._report("appeared", entry, None, entry.box, entry.score)

    def _recognize(self, entry: MapObject) -> bool:
        """Give a new object the label of a waiting one, if it is similar to that one and to no other."""
        best, similarity_to = self._waiting_like(entry)
        if best is None:
            return False
        gone, departure = best
        del self._lives[gone.entry.number]
        self._store.take_over(entry, gone.entry)
        if gone.phase is Phase.GONE:
            self._report("back", entry, departure.from_box, entry.box, similarity_to)
        elif np.linalg.norm(entry.box.center - departure.from_box.center) > MOVED_M:
            self._report("moved", entry, departure.from_box, entry.box, similarity_to)
        return True

    def _waiting_like(self, entry: MapObject) -> tuple[tuple[_Life, _Departure] | None, float]:
        """Return the one waiting object that a new one is similar to, None: none, and the similarity."""
        waiting = self._left(Phase.WAITS, Phase.GONE)
        if not waiting:
            return None, 0.0
        profile = color_profile_of(entry)
        found = [similarity(profile, entry.box, departure.profile, departure.from_box) for _, departure in waiting]
        best = most_similar(found)
        return (None, 0.0) if best is None else (waiting[best], found[best])

    def _is_in_old_place(self, entry: MapObject) -> bool:
        """Return whether an object is where one was that seemed to leave."""
        old = [departure.from_box.center for _, departure in self._left(Phase.WAITS, Phase.GONE)]
        return any(np.linalg.norm(entry.box.center - center) < MOVED_M for center in old)

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
            if number in self._store:
                self._life_of(self._store[number]).touched_s = time_s

    def has_rested(self, entry: MapObject, time_s: float) -> bool:
        """Return whether a complete candidate may get a label.

        Nothing moves at it. If it was not there before, it has rested for `NEW_REST_S`, or is similar to an object that
        left.
        """
        life = self._life_of(entry)
        if time_s - life.touched_s < TOUCHED_S:
            return False
        if life.arrival is None:
            since_s = self._time_s.get(entry.first_frame, min(self._time_s.values()))
            was_absent, has_come = self._arrivals.was_absent(entry), self._arrivals.has_come(entry)
            life.arrival = _Arrival(since_s, time_s, was_absent, has_come)
        rested_s = time_s - max(life.arrival.since_s, life.touched_s)
        return not life.arrival.was_absent or rested_s >= NEW_REST_S or self._waiting_like(entry)[0] is not None

    # --- results ---------------------------------------------------------------------------------------------------

    def sightings(
        self, shown: tuple[Sighting, ...], seen: Observation, slots: npt.NDArray[np.int32]
    ) -> tuple[Sighting, ...]:
        """Return the sightings of a frame, whose voxels are `slots` (H, W), with those of followed objects."""
        present = [life.entry for life, _, motion in self._moving_ones() if not motion.missing]
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
