"""Relations from boxes and planes, in places small enough to see, and on made scenes with exact boxes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.results import SupportPlane, TrackedObject
from cuboid.ground.geometry import se3
from cuboid.ground.geometry.box import Box
from cuboid.lab.synthetic import Scene, make_scene
from cuboid.lab.synthetic.relations import true_relations, true_walls
from cuboid.method.relations import Wall, find_relations

UP = np.array([0.0, 0.0, 1.0])
SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


def thing(label: int, x: float, y: float, foot: float, size: Sequence[float], turn: float = 0.0) -> TrackedObject:
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    box = Box(np.array([x, y, foot + size[2] / 2]), np.array(size, float), rotation)
    return TrackedObject(label, box, 1.0, 1.0, 0, 9, 9, 100, np.zeros(3), None)


def plane(height: float, half: float = 1.0) -> SupportPlane:
    return SupportPlane(UP, -height, np.column_stack([half * SQUARE, np.full(4, height)]))


def said(objects: Sequence[TrackedObject], planes: Sequence[SupportPlane], **more: object) -> set[tuple[object, ...]]:
    found = find_relations(objects, planes, UP, **more)  # type: ignore[arg-type]
    return {(label, one.kind, one.to) for label, relations in found.items() for one in relations}


def test_a_stack_rests_thing_on_thing_on_the_table() -> None:
    book, box, can = (
        thing(1, 0, 0, 0.5, (0.2, 0.15, 0.03)),
        thing(2, 0.01, 0, 0.53, (0.15, 0.1, 0.1), turn=0.4),
        thing(3, 0, 0.01, 0.63, (0.06, 0.06, 0.12)),
    )
    assert said([book, box, can], [plane(0.5), plane(0.0, 3.0)]) == {
        (1, "on", "plane:0"), (1, "supports", 2),
        (2, "on", 1), (2, "supports", 3),
        (3, "on", 2),
    }  # fmt: skip


def test_the_lower_ones_of_a_pile_are_under_all_that_cover_them() -> None:
    pile = [thing(k, 0, 0, 0.1 * (k - 1), (0.2, 0.2, 0.1)) for k in (1, 2, 3)]
    under = {one for one in said(pile, [plane(0.0)]) if one[1] == "under"}
    assert under == {(1, "under", 2), (1, "under", 3), (2, "under", 3)}


def test_what_stands_within_a_larger_thing_below_its_rim_is_in_it() -> None:
    crate, can = thing(1, 0, 0, 0.5, (0.3, 0.25, 0.12)), thing(2, 0.05, 0, 0.508, (0.07, 0.07, 0.2))
    assert said([crate, can], [plane(0.5)]) == {(1, "on", "plane:0"), (1, "supports", 2), (2, "in", 1)}


def test_a_bridge_rests_on_both_of_its_piers() -> None:
    piers = [thing(k, x, 0, 0.0, (0.1, 0.1, 0.2)) for k, x in ((1, -0.2), (2, 0.2))]
    found = said([*piers, thing(3, 0, 0, 0.2, (0.5, 0.12, 0.02))], [plane(0.0)])
    assert {(3, "on", 1), (3, "on", 2)} <= found
    assert (3, "on", "plane:0") not in found


def test_beside_goes_by_the_gap_and_both_ways() -> None:
    near = [thing(1, 0, 0, 0, (0.1, 0.1, 0.1)), thing(2, 0.15, 0, 0, (0.1, 0.1, 0.2))]
    assert {(1, "beside", 2), (2, "beside", 1)} <= said(near, [plane(0.0)])
    far = [near[0], thing(2, 0.4, 0, 0, (0.1, 0.1, 0.2))]
    assert not any(kind == "beside" for _, kind, _ in said(far, [plane(0.0)]))


def test_scores_fall_towards_the_limit_by_the_noise() -> None:
    def score(gap: float) -> float:
        objects = [thing(1, 0, 0, 0, (0.1, 0.1, 0.1)), thing(2, 0.1 + gap, 0, 0, (0.1, 0.1, 0.1))]
        found = find_relations(objects, [plane(0.0)], UP)[1]
        return next((one.score for one in found if one.kind == "beside"), 0.0)

    assert score(0.04) > 0.99
    assert 0.5 < score(0.1995) < 0.55
    assert score(0.19) > score(0.195) > score(0.1995)
    assert score(0.21) == 0.0, "what holds less likely than not is not said"


def test_under_the_table_and_against_the_wall() -> None:
    wall = Wall(np.array([-1.0, 0, 0]), 1.0, np.array([[1.0, -2, 0], [1, 2, 0], [1, 2, 2], [1, -2, 2]]))
    parcel = thing(1, 0.84, 0, 0.0, (0.3, 0.3, 0.2))
    found = said([parcel], [plane(0.0, 3.0), plane(0.7)], walls=[wall])
    assert found == {(1, "on", "plane:0"), (1, "under", "plane:1"), (1, "against", "wall:0")}


def test_two_labels_of_one_thing_do_not_hold_each_other() -> None:
    found = said([thing(1, 0, 0, 0, (0.2, 0.2, 0.1)), thing(2, 0, 0, 0, (0.19, 0.18, 0.1))], [plane(0.0)])
    assert found == {(1, "on", "plane:0"), (1, "supports", 2), (2, "in", 1)}


def test_relations_do_not_hang_on_the_world() -> None:
    objects = [thing(1, 0, 0, 0.5, (0.2, 0.15, 0.03)), thing(2, 0, 0, 0.53, (0.1, 0.1, 0.1))]
    turned = se3.exp([1.0, 2.0, -3.0, 0.3, -0.5, 0.8])
    moved = [replace(item, box=item.box.moved(turned)) for item in objects]
    R, t = turned[:3, :3], turned[:3, 3]
    there = SupportPlane(R @ UP, -0.5 - float(R @ UP @ t), se3.transform(turned, plane(0.5).extent))
    assert find_relations(moved, [there], R @ UP).keys() == {1, 2}
    for label, relations in find_relations(moved, [there], R @ UP).items():
        same = find_relations(objects, [plane(0.5)], UP)[label]
        assert [(one.kind, one.to) for one in relations] == [(one.kind, one.to) for one in same]


def test_nothing_is_said_without_up_or_without_objects() -> None:
    assert find_relations([thing(1, 0, 0, 0, (0.1, 0.1, 0.1))], [plane(0.0)], None) == {1: ()}
    assert find_relations([], [plane(0.0)], UP) == {}


def planes_of(scene: Scene) -> list[SupportPlane]:
    found = []
    for k, surface in enumerate(scene.surfaces):
        corners = [surface.at(*corner) for corner in SQUARE]
        points = np.column_stack([corners, np.full(4, surface.height_m)])
        found.append(SupportPlane(*scene.plane(k), se3.transform(scene.T_world_room, points)))
    return found


def walls_of(scene: Scene, up: Float64Array) -> list[Wall]:
    found = []
    for one in true_walls(scene):
        normal = np.array(one["normal"])
        along, foot = np.cross(up, normal), -one["offset"] * normal
        found.append(Wall(normal, one["offset"], np.array([foot - 9 * along, foot + 9 * along] * 2)))
    return found


@pytest.mark.parametrize("kind", ["stacks", "containers", "sideboard", "bin", "clutter", "shelf", "tables"])
def test_exact_boxes_give_the_relations_of_made_scenes(kind: str) -> None:
    right = said = true = 0
    for seed in (6, 7, 8):
        scene = make_scene(kind, seed)
        up = scene.T_world_room[:3, 2]
        objects = [
            TrackedObject(body.id, scene.box(body), 1.0, 1.0, 0, 9, 9, 100, np.zeros(3), None) for body in scene.objects
        ]
        found = find_relations(objects, planes_of(scene), up, walls_of(scene, up))
        level = [f"level {surface.height_m:.6f}" for surface in scene.surfaces]

        def key(one: int, relation: str, to: int | str, level: Sequence[str] = level) -> tuple[object, ...]:
            return one, relation, level[int(to[6:])] if isinstance(to, str) and to.startswith("plane") else to

        told = true_relations(scene)
        holds = {key(one["from"], one["is"], one["to"]) for one in told if one.get("judged", True)}
        is_open = {key(one["from"], one["is"], one["to"]) for one in told if not one.get("judged", True)}
        got = {key(label, one.kind, one.to) for label, those in found.items() for one in those} - is_open
        right, said, true = right + len(got & holds), said + len(got), true + len(holds)
    assert true > 10
    assert right / said >= 0.98
    assert right / true >= 0.98
