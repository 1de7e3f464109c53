"""The map of objects, by hand: cubes of 10 cm on a floor, where a shift by s has IoU (10 - s) / (10 + s)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_truth import LEVEL, as_json, cube, frame, rows, truth_document, write_truth

from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.overlap import iou_matrix
from cuboid.lab.evaluation.boxes import (
    MapQuality,
    ObjectBox,
    hits_by_score,
    map_quality,
    proposal_quality,
    size_errors,
)
from cuboid.lab.evaluation.result import MapBoxes
from cuboid.lab.evaluation.scope import Scope
from cuboid.lab.evaluation.truth import read_truth


def judge(
    folder: Path, there: list[Box], found: list[Box], score: list[float] | None = None, **more: Any
) -> tuple[MapQuality, list[ObjectBox | None]]:
    truth = read_truth(write_truth(folder, truth_document(there, **more)))
    labels = np.arange(1, len(found) + 1)
    boxes = MapBoxes(labels, rows(found), np.array(score or [1.0] * len(found)))
    return map_quality(Scope(truth, np.arange(10)), boxes)


def test_a_shifted_box_an_exact_one_a_miss_and_a_false_alarm(tmp_path: Path) -> None:
    there = [cube(0.0), cube(1.0), cube(2.0)]
    quality, boxes = judge(tmp_path, there, [cube(1.0), cube(0.04), cube(5.0)])
    at25, at50 = quality.at
    assert (at25.found, at25.missed, at25.wrong) == (2, 1, 1)
    assert (at25.precision, at25.recall, at25.f1) == (2 / 3, 2 / 3, 2 / 3)
    assert at25.mean_iou == pytest.approx((1 + 6 / 14) / 2)
    assert at25.center_error_cm == pytest.approx(2.0)
    assert at25.size_error_cm == pytest.approx(0.0, abs=1e-9)
    assert (at50.found, at50.missed, at50.wrong) == (1, 2, 2)
    assert (at50.mean_iou, at50.center_error_cm) == (pytest.approx(1.0), pytest.approx(0.0, abs=1e-9))
    assert (quality.objects, quality.boxes, quality.counted) == (3, 3, 3)
    assert (quality.fragments, quality.merges, quality.false_alarms) == (0, 0, 1)
    assert quality.wrong_labels == (3,)
    assert [box and box.label for box in boxes] == [2, 1, None]


def test_an_object_in_three_pieces_is_two_fragments(tmp_path: Path) -> None:
    pieces = [Box(np.array([x, 0.0, 0.05]), np.array([0.03, 0.1, 0.1]), LEVEL) for x in (-0.035, 0.0, 0.035)]
    quality, _ = judge(tmp_path, [cube(0.0), cube(1.0)], [*pieces, cube(1.0)])
    assert (quality.fragments, quality.merges, quality.false_alarms) == (2, 0, 0)
    assert quality.at[0].found == 2  # a piece has IoU 0.3 with the object
    assert quality.at[1].found == 1


def test_a_box_over_three_objects_is_two_merges(tmp_path: Path) -> None:
    there = [cube(0.0), cube(0.12), cube(0.24)]
    over = Box(np.array([0.12, 0.0, 0.05]), np.array([0.34, 0.1, 0.1]), LEVEL)
    quality, _ = judge(tmp_path, there, [over])
    assert (quality.fragments, quality.merges, quality.false_alarms) == (0, 2, 0)
    assert quality.at[0].found == 1  # IoU 1/3.4 with one of them


def test_a_map_without_boxes_has_no_precision(tmp_path: Path) -> None:
    quality, boxes = judge(tmp_path, [cube(0.0)], [])
    assert (quality.at[0].precision, quality.at[0].recall, quality.at[0].ap) == (None, 0.0, 0.0)
    assert boxes == [None]


def test_what_is_not_judged_counts_neither_way(tmp_path: Path) -> None:
    document: dict[str, Any] = {
        "ignore": [as_json(Box(np.array([3.0, 0.0, 0.5]), np.full(3, 1.0), LEVEL))],
        "judged_region": {
            "normal": [0, 0, 1],
            "offset": 0.0,
            "polygon": [[-1, -1, 0], [5, -1, 0], [5, 1, 0], [-1, 1, 0]],
            "hmin": -0.03,
            "hmax": 0.5,
        },
    }
    aside = [cube(3.2), cube(9.0), Box(np.array([0.0, 0.0, 0.8]), np.full(3, 0.1), LEVEL)]
    quality, _ = judge(tmp_path, [cube(0.0)], [cube(0.0), *aside], **document)
    assert (quality.boxes, quality.counted, quality.at[1].precision) == (4, 1, 1.0)


def test_an_object_in_an_ignored_place_must_be_found_all_the_same(tmp_path: Path) -> None:
    shelf = as_json(Box(np.array([0.0, 0.0, 0.5]), np.full(3, 1.0), LEVEL))
    quality, _ = judge(tmp_path, [cube(0.0)], [cube(0.0)], ignore=[shelf])
    assert (quality.counted, quality.at[1].recall) == (1, 1.0)
    quality, _ = judge(tmp_path, [cube(0.0)], [], ignore=[shelf])
    assert quality.at[1].recall == 0.0


def test_an_object_that_no_frame_shows_need_not_be_in_the_map(tmp_path: Path) -> None:
    there = [cube(0.0), cube(1.0)]
    for found in ([cube(0.0)], there):
        quality, boxes = judge(tmp_path, there, found, shown={2: [[0.1, 10]]})
        assert (quality.objects, quality.counted) == (1, 1)
        assert (quality.at[1].precision, quality.at[1].recall) == (1.0, 1.0)
        assert boxes[1] is None


def test_boxes_choose_objects_by_score() -> None:
    # The box with the higher score takes the object; a second box of the same object is wrong.
    there = rows([cube(0), cube(1), cube(2), cube(3)])
    found = rows([cube(0), cube(1), cube(0), cube(8)])
    iou = iou_matrix(found, there)
    assert hits_by_score(iou, np.array([0.1, 0.8, 0.9, 1.0]), 0.5).tolist() == [False, True, True, False]
    assert hits_by_score(iou, np.array([0.9, 0.8, 0.1, 1.0]), 0.5).tolist() == [True, True, False, False]


def test_sizes_are_compared_along_the_same_axes() -> None:
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    one = Box(np.zeros(3), np.array([0.3, 0.2, 0.1]), LEVEL)
    turned = Box(np.zeros(3), np.array([0.2, 0.3, 0.13]), quarter)  # the same but 3 cm higher
    np.testing.assert_allclose(size_errors(rows([turned, one]), rows([one])), [[1.0], [0.0]], atol=1e-9)


def test_boxes_of_single_frames() -> None:
    frames = [
        frame(0, [0, 1], [0, 1, 2], [[0.6, 0.0, 0.0], [0.0, 0.3, 0.0]]),
        frame(1, [0], [], []),
    ]
    quality = proposal_quality(frames, 5)
    at25, at50 = quality.at
    assert quality.per_frame == 2.5
    assert (at25.precision, at25.recall, at25.f1) == (2 / 3, 2 / 3, 2 / 3)
    assert (at50.precision, at50.recall) == (1 / 3, 1 / 3)
