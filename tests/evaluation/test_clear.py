"""CLEAR MOT and IDF1 by hand."""

from __future__ import annotations

import numpy as np
import pytest
from made_truth import frame

from cuboid.lab.evaluation.clear import Clear, clear, correspondences
from cuboid.lab.evaluation.matching import FrameOverlap, match


def judged(frames: list[FrameOverlap], threshold: float = 0.5) -> Clear:
    return clear(frames, correspondences(frames, threshold), threshold)


def test_a_switch_counts_once_and_splits_the_identity() -> None:
    found = judged([frame(k, [0], [int(k >= 3)], [[0.8]]) for k in range(5)])
    assert (found.matches, found.misses, found.false_positives) == (5, 0, 0)
    assert found.switches == 1
    assert found.mota == pytest.approx(1 - 1 / 5)
    assert found.motp == pytest.approx(0.8)
    # The best single label is right in 3 of 5 frames.
    assert (found.idf1, found.id_precision, found.id_recall) == (3 / 5, 3 / 5, 3 / 5)


def test_losing_an_object_and_finding_it_again_is_one_fragmentation() -> None:
    frames = [frame(k, [0], [0] if k in (1, 2, 5) else [], [[1.0]] if k in (1, 2, 5) else []) for k in range(8)]
    found = judged(frames)
    # Missed at 0, 3, 4, 6, 7; only the loss at 3 lies between finds.
    assert (found.misses, found.fragmentations, found.switches) == (5, 1, 0)
    assert found.idf1 == pytest.approx(2 * 3 / (8 + 3))


def test_an_absence_is_no_loss_and_a_label_after_it_is_compared_with_the_last_one() -> None:
    for label in (0, 1):
        found = judged([frame(0, [0], [0], [[1.0]]), frame(1, [], [], []), frame(2, [0], [label], [[1.0]])])
        assert (found.fragmentations, found.switches, found.mota) == (0, label, 1.0 - label / 2)


def test_an_object_keeps_its_label_while_both_overlap_enough() -> None:
    frames = [frame(0, [0], [0], [[0.9]]), frame(1, [0], [0, 1], [[0.55, 0.95]])]
    assert correspondences(frames, 0.5) == [[(0, 0)], [(0, 0)]]
    assert correspondences(frames, 0.6) == [[(0, 0)], [(0, 1)]]


def test_below_the_threshold_a_box_is_a_miss_and_a_false_positive() -> None:
    for iou, counts in ((0.49, (0, 1, 1, -1.0)), (0.5, (1, 0, 0, 1.0))):
        found = judged([frame(0, [0], [0], [[iou]])])
        assert (found.matches, found.misses, found.false_positives, found.mota) == counts


def test_two_objects_that_swap_labels() -> None:
    swapped = [frame(k, [0, 1], [0, 1], [[0.0, 1.0], [1.0, 0.0]]) for k in (2, 3, 4)]
    found = judged([frame(k, [0, 1], [0, 1], [[1.0, 0.0], [0.0, 1.0]]) for k in (0, 1)] + swapped)
    assert found.switches == 2
    assert found.idf1 == pytest.approx(6 / 10)  # each object with the label of its 3 frames


def test_without_anything_to_find_nothing_is_claimed() -> None:
    found = judged([frame(0, [], [], [])])
    assert (found.mota, found.motp, found.idf1) == (None, None, None)


def test_matching_makes_most_pairs_before_the_best_ones() -> None:
    iou = np.array([[0.95, 0.5, 0.0], [0.5, 0.0, 0.0], [0.0, 0.94, 0.5]])
    assert match(iou, 0.5) == [(0, 1), (1, 0), (2, 2)]  # sum 1.5, where two pairs reach 1.89
    assert match(iou, 0.6) == [(0, 0), (2, 1)]
    assert match(np.zeros((0, 3)), 0.5) == []
