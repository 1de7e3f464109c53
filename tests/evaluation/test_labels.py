"""Labels for life, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from cuboid.lab.evaluation.labels import (
    Timelines,
    consistency,
    object_labels,
    purity,
    reidentification,
)


def lines(*objects: str, first: int = 0, every: int = 1) -> Timelines:
    """Return time lines drawn as text: `.` not to be found, `-` missed, a digit is the label found."""
    must = np.array([[mark != "." for mark in row] for row in objects]).T
    label = np.array([[int(mark) if mark.isdigit() else 0 for mark in row] for row in objects]).T
    return Timelines(first + every * np.arange(len(must)), must, label)


@pytest.mark.parametrize(
    ("rows", "reappearances", "found", "same"),
    [
        (["333....333"], 1, 1, 1),
        (["33...-44", "33...---", "33...333"], 3, 2, 1),  # a new label and none at all are failures
        (["3344...433"], 1, 1, 1),  # the first label after the absence decides, against the last one before
        (["3344...344"], 1, 1, 0),
        (["---...111"], 0, 0, 0),  # without a label before it is no reappearance
        (["...111"], 0, 0, 0),
        (["111...--"], 0, 0, 0),  # neither is one that flits past
        (["111...--...-11"], 1, 1, 1),
    ],
)
def test_an_object_that_comes_back_is_reidentified(rows: list[str], reappearances: int, found: int, same: int) -> None:
    (at,) = reidentification(lines(*rows), (1,))
    assert (at.reappearances, at.found, at.same_label) == (reappearances, found, same)
    assert at.rate == (pytest.approx(same / reappearances) if reappearances else None)


def test_the_curve_counts_absences_of_at_least_so_many_frames_of_the_recording() -> None:
    # Absent for 2 frames with the label kept, then for 5 with another.
    curve = reidentification(lines("111..111.....222"), (1, 2, 3, 5, 6))
    assert [at.reappearances for at in curve] == [2, 2, 1, 1, 0]
    assert [at.rate for at in curve] == [0.5, 0.5, 0.0, 0.0, None]
    assert [at.reappearances for at in reidentification(lines("111..111", every=10), (20, 21))] == [1, 0]


def test_the_labels_of_an_object() -> None:
    (had,) = object_labels(lines("..---22-3..333", first=100))
    assert had.labels == (2, 3)
    assert had.main_label == 3
    assert had.main_share == pytest.approx(4 / 6)
    assert had.switches == 1
    assert (had.frames_to_find, had.frames_found) == (10, 6)
    assert had.frames_to_first_label == 3
    (had,) = object_labels(lines("..---"))
    assert (had.labels, had.main_label, had.main_share, had.frames_to_first_label) == ((), None, None, None)


def test_purity_and_consistency_are_opposite_faults() -> None:
    # Label 1 means the first object in 3 of 4 sightings, label 2 the second in both.
    shared = lines("111", "122")
    assert purity(shared) == pytest.approx((3 + 2) / 6)
    assert consistency(shared) == pytest.approx((3 + 2) / 6)
    many = lines("1234", "5555")
    assert purity(many) == 1.0
    assert consistency(many) == pytest.approx((1 + 4) / 8)
    assert purity(lines("---")) is None
