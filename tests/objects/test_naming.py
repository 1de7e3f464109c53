from __future__ import annotations

import numpy as np
import pytest
from made_maps import grid, map_of

from cuboid.ground.geometry.box import Box
from cuboid.method.detection.types import Detections
from cuboid.method.objects.detection_votes import name_objects
from cuboid.method.objects.entry import MapObject
from cuboid.method.objects.naming import (
    MAX_CLASSES,
    MISSED,
    chosen_name,
    match_detections,
    merged_evidence,
    name_scores,
)
from cuboid.method.objects.store import ObjectStore
from cuboid.method.objects.visibility import Visibility

STORE = ObjectStore(map_of((grid((0, 0.1), (0, 0.1), (0, 0.1)), 0)))
FRONT = np.array([0.0, -1.0, 0.0])


def thing() -> MapObject:
    return MapObject(1, 0, 0, Box(np.zeros(3), np.full(3, 0.1), np.eye(3)))


def around(turn_rad: float) -> np.ndarray:
    return np.array([np.sin(turn_rad), -np.cos(turn_rad), 0.0])


def detections(*rows: tuple[list[int], dict[str, float]], names: tuple[str, ...] = ("cup", "book")) -> Detections:
    scores = np.array([[of.get(name, 0.0) for name in names] for _, of in rows], np.float32).reshape(-1, len(names))
    return Detections(np.array([box for box, _ in rows], np.int32).reshape(-1, 4), scores, names)


def test_ten_frames_from_one_place_are_not_ten_witnesses() -> None:
    still, moving = thing(), thing()
    for k in range(10):
        STORE.add_name_evidence(still, {"cup": 0.4}, 1.0, FRONT)
        STORE.add_name_evidence(moving, {"cup": 0.4}, 1.0, around(0.5 * k))
    one = thing()
    STORE.add_name_evidence(one, {"cup": 0.4}, 1.0, FRONT)
    assert still.name_log_odds["cup"] == pytest.approx(one.name_log_odds["cup"] * sum(1 / n for n in range(1, 11)))
    assert moving.name_log_odds["cup"] == pytest.approx(10 * one.name_log_odds["cup"])
    assert still.views[:, 3].tolist() == [10.0]


def test_what_is_half_hidden_counts_half() -> None:
    whole, half = thing(), thing()
    STORE.add_name_evidence(whole, {"cup": 0.8}, 1.0, FRONT)
    STORE.add_name_evidence(half, {"cup": 0.8}, 0.5, FRONT)
    assert half.name_log_odds["cup"] == pytest.approx(whole.name_log_odds["cup"] / 2)


def test_low_scores_and_misses_speak_against_a_class() -> None:
    entry = thing()
    STORE.add_name_evidence(entry, {"cup": 0.9}, 1.0, FRONT)
    before = entry.name_log_odds["cup"]
    STORE.add_name_evidence(entry, {}, 1.0, around(1.0))
    assert entry.name_log_odds["cup"] == pytest.approx(before - MISSED)
    STORE.add_name_evidence(entry, {"cup": 0.06}, 1.0, around(2.0))
    assert entry.name_log_odds["cup"] == pytest.approx(before - 2 * MISSED)
    unsure = thing()
    for k in range(20):
        STORE.add_name_evidence(unsure, {"cell phone": 0.12}, 1.0, around(0.3 * k))
    assert chosen_name(name_scores(unsure.name_log_odds))["name"] is None


def test_a_name_needs_more_than_all_others_and_none() -> None:
    entry = thing()
    assert chosen_name(name_scores(entry.name_log_odds)) == {"name": None, "name_score": None, "names": ()}
    STORE.add_name_evidence(entry, {"cup": 0.9, "bowl": 0.3}, 1.0, FRONT)
    named = chosen_name(name_scores(entry.name_log_odds))
    assert named["name"] == "cup"
    assert named["name_score"] == pytest.approx(0.91, abs=0.01)
    assert [name for name, _ in named["names"]] == ["bowl"]
    total = named["name_score"] + named["names"][0][1]
    assert total < 1.0


def test_two_parts_of_one_thing_add_up() -> None:
    assert merged_evidence({"cup": 1.0, "book": 0.5}, {"cup": 2.0}) == {"cup": 3.0, "book": 0.5}
    many = {f"class {k}": float(k) for k in range(40)}
    assert len(merged_evidence(many, {})) == MAX_CLASSES


def test_a_detection_shows_the_object_that_it_overlaps_most() -> None:
    rects = np.array([[0, 0, 100, 100], [90, 0, 190, 100], [300, 300, 340, 340]], np.float64)
    found = detections(([5, 0, 105, 100], {"cup": 0.9}), ([88, 0, 190, 100], {"book": 0.9}), ([200, 0, 260, 60], {}))
    assert match_detections(found, rects).tolist() == [0, 1, -1]
    assert match_detections(detections(), rects).tolist() == []
    assert match_detections(found, np.zeros((0, 4))).tolist() == [-1, -1, -1]


def test_a_part_of_something_larger_is_not_taken_as_missed() -> None:
    part, apart = thing(), thing()
    for entry in (part, apart):
        entry.name_log_odds = {"cup": 1.0}
    found = detections(([0, 0, 200, 200], {"book": 0.9}))
    seen = [
        (part, Visibility(1.0, np.array([10.0, 10.0, 40.0, 40.0]), True)),
        (apart, Visibility(1.0, np.array([300.0, 10.0, 340.0, 40.0]), True)),
    ]
    name_objects(found, seen, STORE, FRONT)
    assert part.name_log_odds == {"cup": 1.0}
    assert apart.name_log_odds["cup"] == pytest.approx(1.0 - MISSED)
