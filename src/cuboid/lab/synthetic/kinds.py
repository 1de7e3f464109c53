"""The kinds of scenes: placement of objects and camera path, drawn from a seed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, TypedDict

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.lab.synthetic.containers import build_containers, build_sideboard
from cuboid.lab.synthetic.draft import OBJECT_GAP_M, Draft, add_middle_table, add_room, circling, finish, on_floor
from cuboid.lab.synthetic.interiors import build_bookshelf, build_desk, build_kitchen
from cuboid.lab.synthetic.looks import STYLES, dressed, materials_of
from cuboid.lab.synthetic.mesh import shift, turn
from cuboid.lab.synthetic.moving import build_moving
from cuboid.lab.synthetic.paths import CAMERAS, MAX_STEP_M, MAX_STEP_RAD, around, random_motion
from cuboid.lab.synthetic.placement import Arrangement
from cuboid.lab.synthetic.places import build_bin, build_counter, build_overhead, build_shelf, build_stacks
from cuboid.lab.synthetic.plain_places import build_alone, build_floor, build_toybox, build_tray
from cuboid.lab.synthetic.scene import Scene, Surface, require_known
from cuboid.lab.synthetic.shapes import MAKERS, Model

Builder = Callable[[Draft], None]


def build_table(draft: Draft) -> None:
    """Build one table in the middle of a room; the camera moves around it."""
    add_room(draft)
    add_middle_table(draft)
    draft.fill(0, int(draft.rng.integers(6, 10)), "basic", OBJECT_GAP_M, 0.9)
    path_table(draft)


def path_table(draft: Draft) -> None:
    """Plan a camera path around the table."""
    draft.waypoints = circling(draft, 0, radius=draft.rng.uniform(1.1, 1.45))


def build_occluders(draft: Draft) -> None:
    """Build a table behind screens and large boxes, which the camera passes."""
    add_room(draft)
    add_middle_table(draft)
    draft.fill(0, int(draft.rng.integers(6, 9)), "basic", OBJECT_GAP_M, 0.8)
    waypoints = circling(draft, 0, radius=2.0, height=draft.rng.uniform(1.25, 1.4), steady=True)
    draft.waypoints = waypoints
    angle = np.unwrap(np.arctan2(waypoints[:, 1], waypoints[:, 0]))
    for fraction, low in ((0.4, False), (0.8, bool(draft.rng.random() < 0.5))):
        at = float(np.interp(fraction + draft.rng.uniform(-0.05, 0.05), np.linspace(0, 1, len(angle)), angle))
        place = turn(at) @ shift((draft.rng.uniform(1.02, 1.1), 0, 0)) @ turn(-np.pi / 2)
        if low:
            crate = draft.make("crate", x=draft.rng.uniform(0.3, 0.4), y=0.3, z=draft.rng.uniform(1.0, 1.1))
            draft.add(crate, place, doubtful=True)
        else:
            draft.add(draft.make("screen", width=draft.rng.uniform(0.36, 0.5), height=1.3), place, doubtful=True)


def build_leave(draft: Draft) -> None:
    """Build a table; the camera turns away from it for a second or more, and comes back."""
    add_room(draft)
    add_middle_table(draft)
    draft.fill(0, int(draft.rng.integers(5, 9)), "basic", OBJECT_GAP_M, 0.85)
    path_leave(draft)


def path_leave(draft: Draft) -> None:
    """Plan a camera path that turns away from the table and comes back."""
    angle = draft.rng.uniform(np.radians(70), np.radians(95)) * (1 if draft.rng.random() < 0.5 else -1)
    turning = 2 * abs(angle) / MAX_STEP_RAD
    walk = max(draft.frames - turning, 0.25 * draft.frames)
    draft.waypoints = _leaving(draft, 0, angle, walk * MAX_STEP_M * 0.8)
    draft.whole = True


def build_tables(draft: Draft) -> None:
    """Build two tables of different heights and a shelf; the camera walks from one to the next and back."""
    rng = draft.rng
    add_room(draft, half=3.0)
    surfaces = [
        Surface(
            "table",
            rng.uniform(0.68, 0.78),
            np.array([-1.1, 0.9]),
            np.array([0.62, 0.4]),
            rng.uniform(-0.3, 0.3),
        ),
        Surface("round table", rng.uniform(0.42, 0.55), np.array([0.85, 1.0]), np.full(2, 0.5), 0.0, round=True),
    ]
    boards = (0.32, rng.uniform(0.78, 0.9))
    surfaces += [
        Surface(f"board {k + 1}", h, np.array([2.45, -0.5]), np.array([0.55, 0.17]), -np.pi / 2)
        for k, h in enumerate(boards)
    ]
    draft.objects = Arrangement(tuple(surfaces), rng)
    table, low = surfaces[0], surfaces[1]
    draft.add(draft.make("table", x=1.24, y=0.8, height=table.height_m), on_floor(table))
    draft.add(draft.make("round_table", radius=0.5, height=low.height_m), on_floor(low))
    draft.add(draft.make("shelf", x=1.1, y=0.34, height=boards[1] + 0.02, boards=boards), on_floor(surfaces[2]))
    for surface, count, names in ((0, 5, "basic"), (1, 4, "basic"), (2, 2, "small"), (3, 4, "small")):
        draft.fill(surface, count, names, OBJECT_GAP_M, 0.85)
    path_tables(draft)


def path_tables(draft: Draft) -> None:
    """Plan a camera path from one table to the other, to the shelf, and back."""
    draft.waypoints = _tour(
        draft, [0, 1, 3, 1, 0], eyes=((-0.7, -0.45), (0.6, -0.35), (1.05, -0.75)), order=(0, 1, 2, 1, 0)
    )


def build_clutter(draft: Draft) -> None:
    """Build a crowded table: gaps of 2 to 4 cm, two pairs that touch, one object on another."""
    rng = draft.rng
    add_room(draft)
    add_middle_table(draft)
    first = draft.objects.put(draft.models(1)[0], 0, OBJECT_GAP_M, within=0.2)
    assert first is not None, "an empty table has room"
    for number, model in enumerate(draft.models(int(rng.integers(10, 14)))):
        touch = number in (2, 5)
        for k in rng.permutation(len(draft.objects.objects)):
            other = draft.objects.objects[int(k)]
            gap = 0.0 if touch else rng.uniform(0.02, 0.04)
            if not (touch and other.touches) and draft.objects.put_beside(model, other, gap, 0.02):
                break
    _stack(draft)
    draft.waypoints = circling(draft, 0, radius=rng.uniform(1.05, 1.3))


def build_room(draft: Draft) -> None:
    """Build a living room with table, shelf, sofa, chair, and objects on the floor; the curtain is seen first."""
    rng = draft.rng
    add_room(draft, half=3.0)
    board = rng.uniform(0.75, 0.9)
    surfaces = (
        Surface(
            "table",
            rng.uniform(0.42, 0.74),
            np.array([0.1, 0.5]),
            np.array([0.6, 0.38]),
            rng.uniform(-0.4, 0.4),
        ),
        Surface("board", board, np.array([2.5, 1.0]), np.array([0.5, 0.17]), -np.pi / 2),
        Surface("floor", 0.0, np.array([0.75, -0.7]), np.array([0.55, 0.45])),
    )
    draft.objects = Arrangement(surfaces, rng)
    draft.add(draft.make("table", x=1.2, y=0.76, height=surfaces[0].height_m), on_floor(surfaces[0]))
    draft.add(draft.make("shelf", x=1.0, y=0.34, height=board + 0.02, boards=(0.35, board)), on_floor(surfaces[1]))
    draft.add(draft.make("sofa"), shift((-1.3, 0.9, 0)) @ turn(rng.uniform(-0.2, 0.2)), doubtful=True)
    draft.add(draft.make("chair"), shift((0.2, 1.45, 0)) @ turn(-np.pi / 2 + rng.uniform(-0.4, 0.4)), doubtful=True)
    for surface, count, names in ((0, 5, "basic"), (1, 3, "small"), (2, 3, "on_floor_of_room")):
        draft.fill(surface, count, names, OBJECT_GAP_M, 0.85)
    path_room(draft)


def path_room(draft: Draft) -> None:
    """Plan a camera path that turns from the curtain to the table and goes through the room."""
    tour = _tour(draft, [0, 2, 1, 0], eyes=((-0.6, -0.75), (0.3, -1.85), (1.15, 0.1), (0.9, -0.75)), order=(0, 1, 2, 3))
    draft.waypoints = np.concatenate([_curtain_first(tour[0]), tour])


class Kind(NamedTuple):
    """A kind of scene: its builder, the duration of its camera path, and the path of repeated visits."""

    build: Builder
    frames: int
    way: Builder | None = None


# The seed of a scene includes the position of its kind: append new kinds.
KINDS: Mapping[str, Kind] = {
    "table": Kind(build_table, 160, path_table),
    "occluders": Kind(build_occluders, 200),
    "leave": Kind(build_leave, 220, path_leave),
    "tables": Kind(build_tables, 360, path_tables),
    "clutter": Kind(build_clutter, 160, path_table),
    "room": Kind(build_room, 460, path_room),
    "overhead": Kind(build_overhead, 90),
    "bin": Kind(build_bin, 120),
    "counter": Kind(build_counter, 120),
    "stacks": Kind(build_stacks, 160),
    "shelf": Kind(build_shelf, 120),
    "moving": Kind(build_moving, 420),
    "containers": Kind(build_containers, 160),
    "sideboard": Kind(build_sideboard, 120),
    "desk": Kind(build_desk, 160),
    "kitchen": Kind(build_kitchen, 160),
    "bookshelf": Kind(build_bookshelf, 140),
    "toybox": Kind(build_toybox, 120),
    "floor": Kind(build_floor, 160),
    "tray": Kind(build_tray, 160),
    "alone": Kind(build_alone, 140),
}
WAYS: Mapping[str, Builder] = {name: kind.way for name, kind in KINDS.items() if kind.way}
FRAMES: Mapping[str, int] = {name: kind.frames for name, kind in KINDS.items()}


class SceneOptions(TypedDict, total=False):
    """Options of `make_scene` that those who call it pass on."""

    camera: str | None
    meshes: Sequence[Model]
    style: str


def make_scene(
    kind: str,
    seed: int,
    *,
    frames: int | None = None,
    camera: str | None = None,
    meshes: Sequence[Model] = (),
    style: str = "plain",
) -> Scene:
    """Make a scene; the same arguments make the same scene.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    seed : int
        0 or more.
    frames : int, optional
        Number of frames; default: the kind's own.
    camera : str, optional
        One of `CAMERAS`: motion style of the camera; by default drawn from the seed.
    meshes : sequence of Model, optional
        The user's objects, which are used before generated ones.
    style : str
        One of `STYLES`: ``plain``, or ``real`` with the same geometry and the materials, light and color camera of real
        households.

    Raises
    ------
    InputError
        The kind, the camera or the style is unknown.
    """
    require_known("kind of scene", kind, KINDS)
    require_known("style", style, STYLES)
    if camera is not None:
        require_known("camera", camera, CAMERAS)
    rng = np.random.default_rng([seed, list(KINDS).index(kind)])
    drawn = tuple(CAMERAS)[int(rng.integers(len(CAMERAS)))]
    T_world_room, focal = random_motion(rng), float(rng.uniform(525, 600))
    draft = Draft(rng, frames or FRAMES[kind], camera or drawn, meshes, [], Arrangement((), rng), np.empty((0, 6)))
    KINDS[kind].build(draft)
    scene = finish(draft, f"synthetic {kind} {seed}", kind, seed, T_world_room, focal)
    return scene if style == "plain" else dressed(scene, seed, materials_of(meshes))


def _leaving(draft: Draft, surface: int, angle: float, length_m: float) -> Float64Array:
    """Return waypoints that look at a surface, turn away from it by `angle`, and look at it again."""
    rng, top = draft.rng, draft.objects.surfaces[surface]
    radius, level = rng.uniform(1.15, 1.45), top.height_m + rng.uniform(0.5, 0.8)
    start, arc = rng.uniform(0, 2 * np.pi), length_m / radius
    middle = (*top.center, top.height_m + 0.05)
    angles = start + arc * np.array([0, 0.2, 0.4, 0.5, 0.6, 0.8, 1.0])
    waypoints = around(middle, angles, radius, level)
    # The target moves around the camera's position in steps, so that the curve keeps the distance.
    rows = [waypoints[:3]]
    eye, toward = waypoints[3, :3], np.arctan2(*(waypoints[3, 3:5] - waypoints[3, :2])[::-1])
    for fraction in (0.25, 0.5, 0.75, 1.0, 1.0, 0.75, 0.5, 0.25):
        bearing = toward + fraction * angle
        drop = (top.height_m - level) * (1 - 0.6 * fraction)
        target = eye + radius * np.array([np.cos(bearing), np.sin(bearing), 0]) + (0, 0, drop)
        rows.append(np.concatenate([eye, target])[None])
    return np.concatenate([*rows, waypoints[4:]])


def _tour(
    draft: Draft, surfaces: Sequence[int], eyes: Sequence[tuple[float, float]], order: Sequence[int]
) -> Float64Array:
    """Return waypoints that look at one surface after the other, from given positions in the room."""
    rows = []
    for surface, eye in zip(surfaces, order, strict=True):
        top = draft.objects.surfaces[surface]
        for k in (-1, 1):
            aside = top.at(*(draft.rng.uniform(0.1, 0.4, 2) * k))
            level = top.height_m + draft.rng.uniform(0.55, 0.8)
            height = np.clip(level, 1.15, 1.65)
            place = np.array(eyes[eye]) + draft.rng.uniform(-0.12, 0.12, 2)
            rows.append([*place, height, *aside, top.height_m + 0.05])
    return np.array(rows)


def _curtain_first(first: Float64Array) -> Float64Array:
    """Return waypoints at the position of a waypoint (6,), which look at the curtain and then turn to its target."""
    eye, toward = first[:3], first[3:] - first[:3]
    end = np.arctan2(toward[1], toward[0])
    far = float(np.linalg.norm(toward[:2]))
    begin = end - 2.3 if abs(np.sin(end - 2.3) + 1) < abs(np.sin(end + 2.3) + 1) else end + 2.3
    rows = []
    for fraction in (0.0, 0.02, 0.25, 0.5, 0.75):
        bearing = begin + fraction * (end - begin)
        drop = 0.1 + fraction * (toward[2] - 0.1)
        target = eye + np.array([far * np.cos(bearing), far * np.sin(bearing), drop])
        rows.append([*eye, *target])
    return np.array(rows)


def _stack(draft: Draft) -> None:
    """Put a can or a jar on a wide flat object that touches no other; the two may count as one object."""
    flat = [o for o in draft.objects.objects if o.model.name in ("book", "parcel") and not o.touches]
    if flat:
        top = draft.objects.put_on(MAKERS[("can", "jar")[int(draft.rng.integers(2))]](draft.rng), flat[0])
        draft.objects.not_judged(top.id, flat[0].id)
