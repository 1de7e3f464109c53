"""HOTA by hand: the cases are small enough for the definitions of Luiten et al. 2021 on paper."""

from __future__ import annotations

import numpy as np
import pytest
from made_truth import frame

from cuboid.lab.evaluation.hota import hota


def test_a_label_that_changes_half_way_halves_the_association() -> None:
    frames = [frame(k, [0], [k // 2], [[1.0]]) for k in range(4)]
    score = hota(frames, 1, 2)
    # Each of the 4 positives: 2 frames have object and label, 4 have either: 2 / 4.
    assert (score.det_a, score.ass_a, score.loc_a) == (1.0, 0.5, 1.0)
    assert score.hota == pytest.approx(np.sqrt(0.5))
    assert (score.ass_re, score.ass_pr) == (0.5, 1.0)


def test_a_box_counts_at_the_thresholds_that_it_reaches() -> None:
    score = hota([frame(k, [0], [0], [[0.6]]) for k in range(5)], 1, 1)
    assert score.per_alpha == (1.0,) * 12 + (0.0,) * 7  # 0.05 .. 0.60 of 0.05 .. 0.95
    assert score.hota == pytest.approx(12 / 19)
    assert score.loc_a == pytest.approx((12 * 0.6 + 7 * 1.0) / 19)


def test_misses_and_false_positives_lower_detection() -> None:
    # Frame 0: found; frame 1: missed; frame 2: a box of another label where nothing is.
    frames = [frame(0, [0], [0], [[1.0]]), frame(1, [0], [], []), frame(2, [], [1], [])]
    score = hota(frames, 1, 2)
    assert score.det_a == pytest.approx(1 / 3)
    assert (score.det_re, score.det_pr) == (0.5, 0.5)
    # The one positive: 1 frame has both, 2 have the object, 1 has the label: 1 / 2.
    assert score.ass_a == pytest.approx(0.5)
    assert score.hota == pytest.approx(np.sqrt(1 / 3 * 1 / 2))


def test_labels_are_matched_by_what_they_are_over_the_whole_sequence() -> None:
    # In frame 2 label 1 overlaps more, but label 0 is the one that belongs to the object.
    frames = [frame(k, [0], [0], [[0.8]]) for k in (0, 1)] + [frame(2, [0], [0, 1], [[0.8, 0.9]])]
    score = hota(frames, 1, 2)
    assert score.per_alpha[0] == pytest.approx(np.sqrt(3 / 4 * 1.0))


def test_nothing_found_is_zero() -> None:
    score = hota([frame(k, [0], [], []) for k in range(3)], 1, 0)
    assert (score.hota, score.det_a, score.ass_a) == (0.0, 0.0, 0.0)
