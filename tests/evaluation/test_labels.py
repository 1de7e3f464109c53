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


def test_an_object_that_comes_back_with_its_old_label_is_reidentified() -> None:
    (one,) = reidentification(lines("333....333"), (1,))
    assert (one.reappearances, one.found, one.same_label, one.rate) == (1, 1, 1, 1.0)


def test_a_new_label_and_none_at_all_are_failures() -> None:
    (at,) = reidentification(lines("33...-44", "33...---", "33...333"), (1,))
    assert (at.reappearances, at.found, at.same_label) == (3, 2, 1)
    assert at.rate == pytest.approx(1 / 3)


def test_the_first_label_after_the_absence_decides_against_the_last_before() -> None:
    (at,) = reidentification(lines("3344...433"), (1,))
    assert at.same_label == 1
    (at,) = reidentification(lines("3344...344"), (1,))
    assert at.same_label == 0


def test_the_curve_counts_absences_of_at_least_so_many_frames() -> None:
    # Absent for 2 frames with the label kept, then for 5 with another.
    curve = reidentification(lines("111..111.....222"), (1, 2, 3, 5, 6))
    assert [at.reappearances for at in curve] == [2, 2, 1, 1, 0]
    assert [at.rate for at in curve] == [0.5, 0.5, 0.0, 0.0, None]


def test_absences_are_in_frames_of_the_recording() -> None:
    curve = reidentification(lines("111..111", every=10), (20, 21))
    assert [at.reappearances for at in curve] == [1, 0]


def test_what_had_no_label_or_flits_past_is_no_reappearance() -> None:
    assert reidentification(lines("---...111"), (1,))[0].reappearances == 0
    assert reidentification(lines("...111"), (1,))[0].reappearances == 0
    assert reidentification(lines("111...--"), (1,))[0].reappearances == 0
    assert reidentification(lines("111...--...-11"), (1,))[0].reappearances == 1


def test_the_labels_of_an_object() -> None:
    (had,) = object_labels(lines("..---22-3..333", first=100))
    assert had.labels == (2, 3)
    assert had.main_label == 3
    assert had.main_share == pytest.approx(4 / 6)
    assert had.switches == 1
    assert (had.frames_to_find, had.frames_found) == (10, 6)
    assert had.frames_to_first_label == 3


def test_an_object_never_found_has_no_label() -> None:
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
