from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from made_keyframes import drawn, keyframes_document, square, write_keyframes

from cuboid import cli
from cuboid.lab.evaluation import evaluate_keyframes
from cuboid.lab.evaluation.reliability import NO_OBJECT, pooled, reliability, right_labels


def right(*sightings: tuple[int, int]) -> dict[int, bool]:
    """Return which labels are right; a sighting is a label and an object."""
    label, item = np.array(sightings, np.int64).reshape(-1, 2).T
    return right_labels(label, item)


def test_a_label_is_right_if_it_is_mostly_one_object_of_which_no_label_is_more_frequent() -> None:
    assert right((5, 1), (5, 1), (5, NO_OBJECT)) == {5: True}
    # Half of its sightings is not most of them.
    assert right((5, 1), (5, NO_OBJECT)) == {5: False}
    assert right((5, 1), (5, 1), (5, 2), (5, 2)) == {5: False}
    # 7 is on object 1 alone, but 5 is the more frequent label of object 1.
    assert right((5, 1), (5, 1), (7, 1)) == {5: True, 7: False}
    # Equally frequent: the older label.
    assert right((7, 1), (5, 1)) == {5: True, 7: False}
    assert right((9, NO_OBJECT)) == {9: False}
    assert right() == {}


def test_bins_and_the_calibration_error_computed_by_hand() -> None:
    found = reliability({1: True, 2: False, 3: True, 4: True, 5: False}, {1: 0.9, 2: 0.8, 3: 1.0, 4: 0.3})
    assert found.labels == 4  # 5 has no probability
    assert [(one.labels, one.right) for one in found.bins] == [(0, 0), (1, 1), (0, 0), (0, 0), (3, 2)]
    assert found.bins[4].mean_probability == pytest.approx(0.9)
    assert found.bins[4].fraction_right == pytest.approx(2 / 3)
    assert (found.bins[0].mean_probability, found.bins[0].fraction_right) == (None, None)
    # 1/4 * |0.3 - 1| + 3/4 * |0.9 - 2/3|
    assert found.expected_calibration_error == pytest.approx(0.7 / 4 + 3 / 4 * (0.9 - 2 / 3))


def test_labels_of_several_recordings_are_pooled_as_if_they_were_of_one() -> None:
    sure = {1: True, 2: False}, {1: 0.95, 2: 0.85}
    unsure = {3: True, 4: False}, {3: 0.9, 4: 0.1}
    whole = reliability(sure[0] | unsure[0], sure[1] | unsure[1])
    both = pooled([reliability(*sure), reliability(*unsure)])
    assert both.expected_calibration_error == pytest.approx(whole.expected_calibration_error)
    assert [one.right for one in both.bins] == [one.right for one in whole.bins]
    assert reliability({}, {}).expected_calibration_error is None


def write_rated(folder: Path, rows: list[tuple[int, int, float, list[float]]]) -> Path:
    """Write a CSV of frame, label, probability and rectangle."""
    lines = [f"{frame},{label},{p},{','.join(map(str, rect))}" for frame, label, p, rect in rows]
    path = folder / "rated.csv"
    path.write_text("\n".join(["frame,label,probability,x0,y0,x1,y1", *lines]) + "\n", encoding="utf-8")
    return path


def test_sightings_with_probabilities_are_ranked_and_their_labels_binned(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truth = write_keyframes(
        tmp_path, keyframes_document({0: [drawn(1, square(0))], 3: [drawn(1, square(0)), drawn(2, square(50))]})
    )
    result = write_rated(tmp_path, [(0, 5, 0.5, square(0)), (3, 5, 0.9, square(0)), (3, 6, 0.7, square(200))])
    at = evaluate_keyframes(result, truth).at[0]
    # Ranked: right (0.9), false (0.7), right (0.5); one of three rectangles is never found.
    assert at.ap == pytest.approx((1 + 2 / 3) / 3)
    # Label 5 is right and has the probability of its last sighting, 0.9; label 6 is false at 0.7.
    assert [(one.labels, one.right) for one in at.reliability.bins] == [(0, 0), (0, 0), (0, 0), (1, 0), (1, 1)]
    assert at.reliability.expected_calibration_error == pytest.approx((0.1 + 0.7) / 2)
    assert cli.main(["evaluate", str(result), str(truth), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["at"][0]["reliability"]["labels"] == 2
    assert cli.main(["evaluate", str(result), str(truth)]) == 0
    shown = capsys.readouterr().out
    assert "probability of labels" in shown
    assert "expected calibration error 0.400" in shown


def test_without_probabilities_there_is_neither_ranking_nor_reliability(tmp_path: Path) -> None:
    truth = write_keyframes(tmp_path, keyframes_document({0: [drawn(1, square(0))]}))
    path = tmp_path / "plain.csv"
    path.write_text("frame,label,x0,y0,x1,y1\n0,5,0,0,10,10\n", encoding="utf-8")
    at = evaluate_keyframes(path, truth).at[0]
    assert (at.recall, at.ap, at.reliability.labels) == (1.0, None, 0)
