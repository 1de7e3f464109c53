"""The tree of a place."""

from __future__ import annotations

from collections.abc import Sequence

from test_finding import UP, plane, thing

from cuboid.ground.core.results import Relation
from cuboid.method.relations import Branch, find_relations, place_tree


def names(branches: Sequence[Branch]) -> list[object]:
    return [(one.of, one.kind, names(one.children)) if one.children else (one.of, one.kind) for one in branches]


def test_things_stand_under_what_they_are_on_and_in() -> None:
    crate, can = thing(1, 0, 0, 0.5, (0.3, 0.25, 0.12)), thing(2, 0.05, 0, 0.508, (0.07, 0.07, 0.2))
    book, parcel = thing(3, 0.6, 0, 0.5, (0.2, 0.15, 0.03)), thing(4, 2, 0, 0.0, (0.3, 0.3, 0.2))
    cup, lamp = thing(5, 0.6, 0, 0.53, (0.08, 0.08, 0.1)), thing(6, 0, 0, 2.0, (0.2, 0.2, 0.2))
    objects, planes = [crate, can, book, parcel, cup, lamp], [plane(0.0, 3.0), plane(0.5)]
    tree = place_tree(objects, find_relations(objects, planes, UP), planes, UP)
    assert names(tree) == [
        ("plane:1", "", [(1, "on", [(2, "in")]), (3, "on", [(5, "on")])]),
        ("plane:0", "", [(4, "on")]),
        ("", "", [(6, "")]),
    ]
    assert [one.height_m for one in tree] == [0.5, 0.0, None]
    assert tree[0].score == 1.0
    assert 0.9 < tree[0].children[0].score <= 1.0


def test_each_object_is_in_it_once_also_where_relations_go_in_a_circle() -> None:
    objects = [thing(k, 0, 0, 0, (0.1, 0.1, 0.1)) for k in (1, 2, 3)]
    circle = {1: [Relation(2, "on", 0.9)], 2: [Relation(3, "in", 0.6)], 3: [Relation(1, "on", 0.8)]}
    tree = place_tree(objects, circle, [], UP)
    assert names(tree) == [("", "", [(2, "", [(1, "on", [(3, "on")])])])]


def test_without_relations_it_is_unknown_what_things_stand_on() -> None:
    tree = place_tree([thing(1, 0, 0, 0, (0.1, 0.1, 0.1))], {1: ()}, [plane(0.0)], None)
    assert names(tree) == [("", "", [(1, "")])]
    assert place_tree([], {}, [plane(0.0)], UP) == ()
