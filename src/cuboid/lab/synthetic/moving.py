"""A table with events while the camera runs: a hand moves objects, a person walks by, a door opens."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.geometry.se3 import inverse
from cuboid.lab.synthetic.agents import hand, hand_agents, walker
from cuboid.lab.synthetic.draft import Draft, add_middle_table, add_room, circling
from cuboid.lab.synthetic.footprint import hull, smallest_rectangle
from cuboid.lab.synthetic.mesh import shift, turn
from cuboid.lab.synthetic.paths import STILL, around, smooth_noise
from cuboid.lab.synthetic.scene import FRAMES_PER_S, Agent, Furniture, SceneEvent, SceneObject

# Gap between objects, wide enough for a finger, metres.
FINGER_GAP_M = 0.07
# Minimum displacement of a moved object; maximum displacement of one that is put back, metres.
MOVE_M, PUT_BACK_M = 0.15, 0.01
# Frames without any motion: at the start, so that all objects get labels, and at the end, for the moved objects.
FIRST_FRAMES, LAST_FRAMES = 45, 80
# Durations of a hand's motions, frames: to or from an object, closing or opening, up or down (and per metre of height);
# speed with an object, metres per frame; maximum number of frames to move an object.
REACH_FRAMES, GRIP_FRAMES, LIFT_FRAMES, LIFTED_FRAMES, CARRY_M, MOST_FRAMES = 13, 4, 7, 25, 0.035, 115
# A waiting hand: amplitude of its sway, distance from the edge of the table, and height above the table, metres.
SWAY_M, HAND_BESIDE_M, HAND_ABOVE_M = 0.05, 0.4, 0.35
# Clearance below a carried object, and maximum width of an object that a hand grips from above, metres.
CARRY_CLEARANCE_M, WIDEST_M = 0.04, 0.17
# Height above an object from which a hand moves straight down to it, metres.
OVER_M = 0.14
# Pose of absent objects and people: below the floor.
AWAY = shift((0.0, 0.0, -8.0))
# Name of the open box, its sides and its wall thickness, metres.
OPEN_BOX, OPEN_BOX_M, OPEN_BOX_WALL_M = "open box", (0.26, 0.2, 0.1), 0.004
# Distance at which a walker passes the middle of the table; lateral distance at which the walk begins and ends, metres;
# walking speed.
PASSES_M, BEGINS_M, WALK_M_PER_S = 1.85, 2.3, 1.0
# Opening angle of a door, radians, and duration in frames.
OPENED_RAD, OPENED_FRAMES = 1.2, 50


@dataclass(frozen=True, slots=True)
class _Carry:
    """An object that a hand carries, and the first and last frame."""

    id: int
    begin: int
    end: int


class _Story:
    """The sequence of a hand's actions at a table.

    Parameters
    ----------
    draft : Draft
        Draft with the objects in place.
    shoulder : (3,) float64
        Position of the shoulder in the room.
    """

    def __init__(self, draft: Draft, shoulder: Float64Array) -> None:
        self._draft, self._rng, self._shoulder = draft, draft.rng, shoulder
        self.frame = FIRST_FRAMES
        self.events: list[SceneEvent] = []
        # First and current pose of each object.
        self._first = {o.id: o.T_room_model for o in draft.objects.objects}
        self._now = dict(self._first)
        # Keys of the hand (frame, position (3), yaw, half the opening), and the objects that it carries.
        self._keys: list[tuple[float, ...]] = [(0.0, *self._aside(), 0.0, 0.03)]
        self._carried: list[_Carry] = []
        self._busy: set[int] = set()
        # Poses of objects that are not carried: object, first frame, pose.
        self._set: list[tuple[int, int, Float64Array]] = []

    def _aside(self) -> Float64Array:
        """Return a waiting position of the hand beside the table."""
        top = self._draft.objects.surfaces[0]
        out = self._shoulder[:2] - top.center
        edge = float(top.half.max()) + HAND_BESIDE_M
        spot = top.center + out / np.linalg.norm(out) * edge + self._rng.uniform(-0.1, 0.1, 2)
        return np.array([*spot, top.height_m + self._rng.uniform(0.15, 0.3)])

    def _go(self, frames: float, place: Sequence[float] | Float64Array, yaw: float, open_m: float) -> None:
        self._keys.append((self._keys[-1][0] + frames, *place, yaw, open_m))

    def _wait_until(self, frame: int) -> None:
        last = self._keys[-1]
        if frame > last[0]:
            self._keys.append((float(frame), *last[1:]))

    def _grip(self, body: SceneObject) -> tuple[Float64Array, float, float, float]:
        """Return the grip on an object in its current pose: position, yaw, half width, height."""
        points = body.model.mesh().moved(self._now[body.id]).vertices
        center, size, angle = smallest_rectangle(hull(points[:, :2]))
        low, top = float(points[:, 2].min()), float(points[:, 2].max())
        yaw = angle + (np.pi / 2 if size[1] < size[0] else 0.0)
        tips = max(top - 0.06, low + 0.3 * (top - low))
        return np.array([*center, tips]), yaw, float(min(size)) / 2, top - low

    def _clearance(self, body: SceneObject, to: Float64Array) -> float:
        """Return the height, metres, to which an object is lifted to pass over all objects near its path."""
        start = self._now[body.id][:2, 3]
        along = np.linspace(0, 1, 12)[:, None] * (to - start) + start
        heights = [0.0]
        for other in self._draft.objects.objects:
            if other.id != body.id and other.id in self._now:
                far = np.linalg.norm(along - self._now[other.id][:2, 3], axis=1).min()
                if far < 0.25:
                    heights.append(float(other.model.mesh().vertices[:, 2].max()))
        return max(heights) + CARRY_CLEARANCE_M

    def _carry(self, body: SceneObject, T_end: Float64Array, height_m: float) -> tuple[int, int]:
        """Grip an object, lift it, put it elsewhere; return the frames in which it leaves and comes to rest."""
        place, yaw, half, _ = self._grip(body)
        start = self._now[body.id]
        turned = np.arctan2(*(T_end @ inverse(start))[1::-1, 0][:2])
        end = (T_end @ inverse(start) @ np.array([*place, 1.0]))[:3]
        wide, up = half + 0.025, np.array([0, 0, height_m])
        self._wait_until(self.frame)
        over = np.array([0, 0, OVER_M])
        self._go(REACH_FRAMES, place + over, yaw, wide)
        self._go(LIFT_FRAMES, place, yaw, wide)
        self._go(GRIP_FRAMES, place, yaw, half)
        begin = int(self._keys[-1][0])
        self._go(LIFT_FRAMES + LIFTED_FRAMES * height_m, place + up, yaw, half)
        self._go(max(10.0, float(np.linalg.norm(end - place)) / CARRY_M), end + up, yaw + turned, half)
        self._go(LIFT_FRAMES + LIFTED_FRAMES * height_m, end, yaw + turned, half)
        rests = int(np.ceil(self._keys[-1][0]))
        self._keys[-1] = (float(rests), *self._keys[-1][1:])
        self._carried.append(_Carry(body.id, begin, rests))
        self._now[body.id] = T_end
        self._go(GRIP_FRAMES, end, yaw + turned, wide)
        self._go(LIFT_FRAMES, end + over, yaw + turned, wide)
        self._go(REACH_FRAMES, self._aside(), yaw, 0.03)
        self.frame = int(np.ceil(self._keys[-1][0])) + int(self._rng.integers(6, 20))
        return begin, rests

    def _happened(self, event: str, body: SceneObject, frames: tuple[int, int], *places: Float64Array | None) -> None:
        self.events.append(SceneEvent(event, body.id, *frames, *places))

    def _free_thing(self) -> SceneObject | None:
        """Draw an object that has not been moved yet and that a hand can grip."""
        bodies = [o for o in self._draft.objects.objects if o.id not in self._busy and not o.touches]
        bodies = [o for o in bodies if 2 * self._grip(o)[2] <= WIDEST_M]
        if not bodies:
            return None
        body = bodies[int(self._rng.integers(len(bodies)))]
        self._busy.add(body.id)
        return body

    def _spot(self, body: SceneObject, near_m: float = 0.0) -> Float64Array | None:
        """Return a free pose (4, 4) for an object, with random yaw; with `near_m`, within that distance, same yaw."""
        place, surface = self._draft.objects, self._draft.objects.surfaces[body.surface]
        old = place.take(body.id)
        start, found = self._now[body.id], None
        for _ in range(300):
            if near_m:
                away, angle = self._rng.uniform(MOVE_M, near_m), self._rng.uniform(0, 2 * np.pi)
                T = shift((away * np.cos(angle), away * np.sin(angle), 0)) @ start
            else:
                spot = surface.at(*(0.85 * self._rng.uniform(-1, 1, 2)))
                T = shift((*spot, start[2, 3])) @ turn(self._rng.uniform(-1.2, 1.2)) @ shift(-start[:3, 3]) @ start
                T[:2, 3] = spot
            far = np.linalg.norm(T[:2, 3] - start[:2, 3]) >= MOVE_M
            if far and place.fits(replace(old, T_room_model=T), FINGER_GAP_M):
                found = T
                break
        place.restore(old if found is None else replace(old, T_room_model=found))
        return found

    @property
    def has_time(self) -> bool:
        """Whether enough frames are left to move another object."""
        return self.frame + MOST_FRAMES + LAST_FRAMES <= self._draft.frames

    def lift(self) -> None:
        """Lift an object and put it elsewhere."""
        self._move(0.0)

    def push(self) -> None:
        """Push an object over the table without lifting it."""
        self._move(0.25)

    def _move(self, near_m: float) -> None:
        """Move an object: over the table to a place within `near_m`, or lifted to any place if that is 0."""
        body = self._free_thing()
        T = None if body is None else self._spot(body, near_m)
        if body is not None and T is not None:
            start = self._now[body.id]
            height_m = 0.0 if near_m else self._clearance(body, T[:2, 3])
            self._happened("moved", body, self._carry(body, T, height_m), start, T)

    def put_back(self) -> None:
        """Lift an object and put it back in its place, which is no event."""
        body = self._free_thing()
        if body is not None:
            off = shift((*self._rng.uniform(-PUT_BACK_M, PUT_BACK_M, 2) / 2, 0.0))
            self._carry(body, off @ self._now[body.id], self._rng.uniform(0.1, 0.2))

    def take_and_bring_back(self) -> None:
        """Take an object out of the scene, and bring it back to another place."""
        body = self._free_thing()
        T = None if body is None else self._spot(body)
        if body is None or T is None:
            return
        start = self._now[body.id]
        frames = self._carry_out(body)
        self._happened("gone", body, frames, start, None)
        if self.has_time:
            self.frame += int(self._rng.integers(15, 35))
            self._happened("back", body, self._carry_in(body, T), start, T)

    def bring(self) -> None:
        """Bring a new object into the scene."""
        model = self._draft.models(1, "brought")[0]
        body = self._draft.objects.put(model, 0, FINGER_GAP_M, 0.85)
        if body is not None:
            T = body.T_room_model
            self._first[body.id] = AWAY
            self._busy.add(body.id)
            self._happened("appeared", body, self._carry_in(body, T), None, T)

    def put_into(self) -> None:
        """Put a small object into the open box."""
        into = [o for o in self._draft.objects.objects if o.model.name == OPEN_BOX and not o.touches]
        small = [o for o in self._draft.objects.objects if self._fits_into(o, into)]
        small = [o for o in small if o.id not in self._busy and not o.touches]
        if not small:
            return
        body, target = small[int(self._rng.integers(len(small)))], into[0]
        self._busy |= {body.id, target.id}
        start, inside = self._now[body.id], self._now[target.id][:3, 3] + (0, 0, OPEN_BOX_WALL_M)
        T = start.copy()
        T[:3, 3] = inside
        frames = self._carry(body, T, self._clearance(body, T[:2, 3]))
        self._happened("moved", body, frames, start, T)
        place = self._draft.objects
        place.take(body.id)
        place.restore(replace(body, T_room_model=T))
        for one, other in ((body.id, target.id), (target.id, body.id)):
            k = next(k for k, o in enumerate(place.objects) if o.id == one)
            place.objects[k] = replace(place.objects[k], touches=(other,))

    def _fits_into(self, body: SceneObject, into: Sequence[SceneObject]) -> bool:
        radius = np.linalg.norm(body.model.mesh().vertices[:, :2], axis=1).max()
        return bool(into) and body.model.name != OPEN_BOX and radius < OPEN_BOX_M[1] / 2 - 0.03

    def _carry_out(self, body: SceneObject) -> tuple[int, int]:
        T = self._now[body.id].copy()
        T[:2, 3] += self._out() - T[:2, 3]
        begin, end = self._carry(body, T, 0.3)
        self._set.append((body.id, end, AWAY))
        return begin, end

    def _carry_in(self, body: SceneObject, T: Float64Array) -> tuple[int, int]:
        outside = T.copy()
        outside[:2, 3] = self._out()
        self._now[body.id] = outside
        begin, end = self._carry(body, T, 0.3)
        self._set.append((body.id, begin, outside))
        return begin, end

    def _out(self) -> Float64Array:
        """Return a position in the room outside the camera's view: below the hand's owner, far aside."""
        middle = self._draft.objects.surfaces[0].center
        out = self._shoulder[:2] - middle
        return np.asarray(middle + out / np.linalg.norm(out) * 1.6)

    def end(self) -> tuple[list[SceneObject], list[Agent]]:
        """Return the objects with their paths, and the parts of the hand."""
        frames = self._draft.frames
        self._wait_until(frames)
        poses, open_m = _hand_path(np.array(self._keys), frames, self._rng)
        paths = {number: np.repeat(T[None], frames, 0) for number, T in self._first.items()}
        steps: list[tuple[int, int, int, _Carry | Float64Array]] = [
            (one.begin, 1, one.id, one) for one in self._carried
        ]
        steps += [(frame, 0, number, T) for number, frame, T in self._set]
        for frame, _, number, what in sorted(steps, key=lambda step: step[:3]):
            path = paths[number]
            if isinstance(what, _Carry):
                held = slice(frame, what.end + 1)
                path[held] = poses[held] @ inverse(poses[frame]) @ path[frame]
                path[what.end :] = path[what.end]
            else:
                path[frame:] = what
        moved = {one.id for one in self._carried}
        things = self._draft.objects.objects
        return (
            [replace(o, path=paths[o.id]) if o.id in moved else o for o in things],
            hand_agents(hand(self._rng), poses, open_m, self._shoulder),
        )


def _hand_path(keys: Float64Array, frames: int, rng: np.random.Generator) -> tuple[Float64Array, Float64Array]:
    """Return T_room_palm (N, 4, 4) and half the opening (N,) in each frame, from keys (K, 6): see `_Story`.

    The motion between keys is smooth; a waiting hand sways.
    """
    at = np.arange(frames)
    k = np.clip(np.searchsorted(keys[:, 0], at, side="right") - 1, 0, len(keys) - 2)
    part = np.clip((at - keys[k, 0]) / np.maximum(keys[k + 1, 0] - keys[k, 0], 1e-9), 0.0, 1.0)
    smooth = part * part * (3.0 - 2.0 * part)
    values = keys[k, 1:] + smooth[:, None] * (keys[k + 1, 1:] - keys[k, 1:])
    # The hand waits where both keys have the same position; its sway grows with the distance from either end of the
    # wait.
    waits = np.linalg.norm(keys[k + 1, 1:4] - keys[k, 1:4], axis=1) == 0.0
    inside = np.minimum(at - keys[k, 0], keys[k + 1, 0] - at).clip(0, 10) / 10.0
    values[:, :3] += (waits * inside)[:, None] * SWAY_M * smooth_noise(frames, 3, 0.8, rng)
    poses = np.array([shift(row[:3]) @ turn(row[3]) for row in values])
    return poses, values[:, 4]


def build_moving(draft: Draft) -> None:
    """Build a table at which a hand moves objects; the camera is carried or, for half of the seeds, fixed."""
    rng = draft.rng
    add_room(draft)
    add_middle_table(draft)
    if rng.random() < 0.4:
        draft.objects.put(draft.make("open_card_box", size=OPEN_BOX_M, wall=OPEN_BOX_WALL_M), 0, FINGER_GAP_M, 0.6)
    draft.fill(0, int(rng.integers(5, 8)), "basic", FINGER_GAP_M, 0.85)
    bearing = _place_camera(draft)
    top = draft.objects.surfaces[0]
    aside = bearing + (1 if rng.random() < 0.5 else -1) * rng.uniform(1.2, 1.9)
    out = np.array([np.cos(aside), np.sin(aside), 0.0])
    story = _Story(draft, np.array([*top.center, top.height_m + HAND_ABOVE_M]) + 1.3 * out)
    acts: list[Callable[[], None]] = [story.lift, story.push, story.put_back, story.take_and_bring_back, story.bring]
    order = [acts[int(k)] for k in rng.permutation(len(acts))]
    for act in (story.put_into, *order):
        if story.has_time:
            act()
    objects, draft.agents = story.end()
    draft.objects.objects = objects
    draft.events = story.events
    if rng.random() < 0.6:
        draft.agents += walker(rng, _walk(draft, bearing))
    if rng.random() < 0.4:
        _add_door(draft, bearing)


def _place_camera(draft: Draft) -> float:
    """Move the camera around the table or fix it; return its first bearing as an angle about the table."""
    rng, top = draft.rng, draft.objects.surfaces[0]
    if rng.random() < 0.5:
        draft.waypoints = circling(draft, 0, radius=rng.uniform(1.15, 1.4))
    else:
        middle = (*top.center, top.height_m + 0.05)
        angle, level = rng.uniform(0, 2 * np.pi), top.height_m + rng.uniform(0.6, 0.9)
        draft.waypoints = around(middle, [angle, angle + 1e-4], rng.uniform(1.05, 1.25), level)
        draft.style, draft.whole = STILL, True
    return float(np.arctan2(draft.waypoints[0, 1], draft.waypoints[0, 0]))


def _walk(draft: Draft, bearing: float) -> Float64Array:
    """Return the poses (N, 4, 4) of a person who passes behind the table, as seen by the first camera."""
    rng, frames = draft.rng, draft.frames
    side = np.round((bearing + np.pi) / (np.pi / 2)) * np.pi / 2
    line = (
        turn(side)
        @ shift((PASSES_M + rng.uniform(-0.15, 0.15), 0, 0))
        @ turn((1 if rng.random() < 0.5 else -1) * np.pi / 2)
    )
    step = WALK_M_PER_S / FRAMES_PER_S
    takes = int(2 * BEGINS_M / step)
    first = int(rng.uniform(0.1, 0.9) * max(frames - takes, 1))
    poses = np.repeat(AWAY[None], frames, 0)
    for k in range(first, min(first + takes, frames)):
        poses[k] = line @ shift((-BEGINS_M + (k - first) * step, 0, 0))
    return poses


def _add_door(draft: Draft, bearing: float) -> None:
    """Add a door in the wall behind the table that opens while the camera runs."""
    rng, frames = draft.rng, draft.frames
    side = np.round((bearing + np.pi) / (np.pi / 2)) * np.pi / 2
    wall = max(float(np.abs(body.T_room_model[:2, 3]).max(initial=0.0)) for body in draft.furniture)
    hinge = turn(side) @ shift((wall - 0.08, rng.uniform(-0.9, 0.1), 0))
    panel = draft.make("panel")
    first = int(rng.uniform(0.2, 0.7) * frames)
    part = np.clip((np.arange(frames) - first) / OPENED_FRAMES, 0.0, 1.0)
    path = np.array([hinge @ turn(OPENED_RAD * (3 - 2 * p) * p * p) for p in part])
    draft.furniture.append(Furniture(panel, path[-1], path=path))
