"""Made scenes of homes and offices: desk, kitchen, bookshelf, toy box, floor, tray, an almost empty table."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.spatial import Delaunay

from cuboid.lab.synthetic import Scene, make_scene
from cuboid.lab.synthetic.footprint import hull
from cuboid.lab.synthetic.raycast import RayCaster

NEW = ("desk", "kitchen", "bookshelf", "toybox", "floor", "tray", "alone")
SEEDS = (1, 2, 3)
# Objects and last camera position of earlier kinds with seed 3 and four frames.
NAMES_TABLE = ["teapot", "can", "jar", "book", "cap", "six-sided box", "milk carton"]
NAMES_ROOM = ["can", "mug", "jar", "cap", "parcel", "can", "mug", "plant", "ball", "six-sided box", "parcel"]
LAST_TABLE = (1.268816241089598, -0.4897510535419899, 0.03934485192868431)
LAST_ROOM = (-0.9933045039909091, 0.24600715719773802, 0.8837729736025276)
CLUTTER = ("cable", "paper", "leaflet", "cloth")


@cache
def scene_of(kind: str, seed: int) -> Scene:
    return make_scene(kind, seed, frames=3)


def names(scene: Scene) -> list[str]:
    return [one.model.name for one in scene.objects]


@pytest.mark.parametrize("kind", NEW)
@pytest.mark.parametrize("seed", SEEDS)
def test_stacked_and_contained_things_rest_on_their_support(kind: str, seed: int) -> None:
    scene = scene_of(kind, seed)
    for one in scene.objects:
        below = one.on or one.inside
        if not below:
            continue
        vertices = one.mesh().vertices
        bottom = vertices[:, 2].min()
        rim = vertices[vertices[:, 2] < bottom + 0.001]
        rim = rim[:: max(1, len(rim) // 8)]
        inside = rim.mean(0) + np.linspace(0, 1, 150)[:, None, None] * (rim - rim.mean(0))
        support = RayCaster(scene.objects[below - 1].mesh().corners())
        feet = inside.reshape(-1, 3) * (1, 1, 0) + (0, 0, bottom)
        above, below_foot = (np.asarray(feet + np.array([0, 0, dz]), np.float32) for dz in (0.001, -0.002))
        assert not support.reaches(above, below_foot).all(), "it touches its support"


@pytest.mark.parametrize("kind", NEW)
@pytest.mark.parametrize("seed", SEEDS)
def test_clutter_is_ignored_and_meets_no_object(kind: str, seed: int) -> None:
    scene = scene_of(kind, seed)
    outlines = [Delaunay(hull(one.mesh().vertices[:, :2])) for one in scene.objects]
    for body in (one for one in scene.furniture if one.model.name in CLUTTER):
        assert body.doubtful
        vertices = body.mesh().vertices
        level = min((surface.height_m for surface in scene.surfaces), key=lambda h: abs(h - vertices[:, 2].min()))
        assert vertices[:, 2].min() == pytest.approx(level, abs=0.001)
        risen = vertices[vertices[:, 2] > level + 0.002]
        assert not any((outline.find_simplex(risen[:, :2]) >= 0).any() for outline in outlines)


def test_kinds_have_what_their_names_say() -> None:
    scenes = {kind: [scene_of(kind, seed) for seed in SEEDS] for kind in NEW}
    assert all({"monitor", "laptop"} & set(names(scene)) for scene in scenes["desk"])
    assert any(one.model.name == "cable" for one in scenes["desk"][0].furniture)
    fittings = [{one.model.name for one in scene.furniture} for scene in scenes["kitchen"]]
    assert all({"cabinet", "tiles", "hob", "socket", "door"} <= there for there in fittings)
    assert all(any(one.on for one in scene.objects) for scene in scenes["kitchen"])
    assert all(len({one.surface for one in scene.objects}) == 4 for scene in scenes["bookshelf"])
    assert all(len(scene.objects) >= 12 for scene in scenes["bookshelf"])
    for scene in scenes["toybox"]:
        (box,) = (one.model.parts[0][1] for one in scene.furniture if one.model.name == "toy box")
        (floor,) = (one.model.parts[0][1] for one in scene.furniture if one.model.name == "floor")
        assert box.color == floor.color
        assert (scene.T_room_camera[:, 2, 2] < -0.7).all(), "the camera looks down"
    assert all(scene.surfaces[0].height_m == 0.0 for scene in scenes["floor"])
    for scene in scenes["tray"]:
        held = [one for one in scene.objects if one.inside]
        assert len(held) >= 2
        assert all(one.judged and scene.objects[one.inside - 1].judged for one in held)
    assert {len(scene.objects) for scene in scenes["alone"]} <= {1, 2, 3}


def test_rows_and_piles_count_neither_way() -> None:
    found = [one for seed in SEEDS for one in scene_of("bookshelf", seed).objects]
    rows = [one for one in found if one.model.name in ("row of books", "pile of plates")]
    assert rows
    assert not any(one.judged for one in rows)


def test_earlier_kinds_are_the_same_as_ever() -> None:
    table, room = make_scene("table", 3, frames=4), make_scene("room", 3, frames=4)
    assert names(table) == NAMES_TABLE
    assert names(room) == NAMES_ROOM
    np.testing.assert_allclose(table.T_world_camera[3, :3, 3], LAST_TABLE, atol=1e-9)
    np.testing.assert_allclose(room.T_world_camera[3, :3, 3], LAST_ROOM, atol=1e-9)
