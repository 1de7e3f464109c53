"""What bounds a thing tells whether it is an object."""

from __future__ import annotations

from math import log

import numpy as np
import pytest

from cuboid.method.objects.affinity import CERTAIN_LOG_ODDS
from cuboid.method.objects.outline import (
    CLEAR,
    FULLY_READ_FRACTION,
    enclosed,
    ends_above,
    ends_beside,
    with_viewpoint_change,
)
from cuboid.method.objects.outline import log_odds_of as told_by_each
from cuboid.method.surfaces.kernels.outlines import (
    BORDER,
    BOTTOM,
    CONTACT,
    FREE,
    HIDDEN,
    KINDS,
    LEFT,
    RIGHT,
    SUPPORT,
    TOP,
    UNSURE,
)


def outline(top: int, bottom: int, left: int, right: int, pixels: int = 20) -> np.ndarray:
    """One kind of neighbour at each side."""
    kinds = np.zeros((4, KINDS))
    for side, kind in ((TOP, top), (BOTTOM, bottom), (LEFT, left), (RIGHT, right)):
        kinds[side, kind] = pixels
    return kinds


def log_odds_of(kinds: np.ndarray, read: float = 1.0) -> float:
    """What one sighting tells, among others."""
    told = told_by_each(np.stack([outline(UNSURE, UNSURE, UNSURE, UNSURE), kinds]), np.array([1.0, read]))
    return float(told[1])


def test_two_sightings_of_what_stands_free_are_enough() -> None:
    free = outline(FREE, SUPPORT, FREE, FREE)
    assert log_odds_of(free) == pytest.approx(log(99) / 2)
    assert 2 * log_odds_of(free) >= CERTAIN_LOG_ODDS
    assert enclosed(free)


def test_a_clear_sighting_from_elsewhere_counts_once_more_and_one_from_the_same_place_does_not() -> None:
    assert CLEAR + with_viewpoint_change(CLEAR, viewpoint_angle=0.2) >= 1.5 * CERTAIN_LOG_ODDS - 1e-9
    assert with_viewpoint_change(CLEAR, viewpoint_angle=0.0) == CLEAR, "a hundred from one place tell no more each"
    assert with_viewpoint_change(CLEAR, viewpoint_angle=0.1) == pytest.approx(1.5 * CLEAR)
    assert with_viewpoint_change(CLEAR / 2.0, viewpoint_angle=np.inf) == pytest.approx(0.75 * CLEAR), (
        "as far as it is clear"
    )
    assert with_viewpoint_change(-1.0, viewpoint_angle=np.inf) == -1.0


def test_three_sightings_of_what_is_fairly_clear_are_enough_where_the_camera_goes_round_it() -> None:
    fair = 0.6 * CLEAR
    assert fair + 2 * with_viewpoint_change(fair, viewpoint_angle=0.4) >= CERTAIN_LOG_ODDS > 3 * fair


def test_what_is_contact_at_the_bottom_may_stand_there() -> None:
    assert log_odds_of(outline(FREE, CONTACT, FREE, FREE)) == log_odds_of(outline(FREE, SUPPORT, FREE, FREE))


@pytest.mark.parametrize("kind", [BORDER, HIDDEN])
def test_a_foot_that_is_cut_off_or_hidden_takes_nothing_from_what_the_rest_tells(kind: int) -> None:
    free = log_odds_of(outline(FREE, SUPPORT, FREE, FREE))
    assert log_odds_of(outline(FREE, kind, FREE, FREE)) == free
    assert log_odds_of(outline(FREE, SUPPORT, FREE, kind)) == pytest.approx(0.75 * free)


def test_a_patch_of_a_wall_is_none() -> None:
    patch = outline(CONTACT, CONTACT, CONTACT, CONTACT)
    assert log_odds_of(patch) < -0.5
    assert not enclosed(patch)


def test_a_side_that_goes_on_keeps_a_thing_from_being_enclosed() -> None:
    for k, side in enumerate((TOP, LEFT, RIGHT)):
        kinds = [FREE, SUPPORT, FREE, FREE]
        kinds[(0, 2, 3)[k]] = CONTACT
        assert not enclosed(outline(*kinds)), side
        kinds[(0, 2, 3)[k]] = HIDDEN
        assert not enclosed(outline(*kinds)), side
    assert enclosed(outline(FREE, HIDDEN, FREE, FREE)), "its foot may be hidden"
    assert enclosed(outline(FREE, HIDDEN, FREE, HIDDEN), beside=True), "by what is known to be another thing"
    assert not enclosed(outline(HIDDEN, HIDDEN, FREE, FREE), beside=True), "but its top is seen"
    assert not enclosed(outline(FREE, HIDDEN, HIDDEN, HIDDEN), beside=True), "and some side of it"
    assert enclosed(outline(UNSURE, SUPPORT, FREE, UNSURE)), "another thing ends it as air does"


def test_a_leg_whose_top_is_hidden_or_touches_what_it_bears_does_not_end() -> None:
    leg = outline(HIDDEN, SUPPORT, FREE, FREE, pixels=40)
    leg[TOP] = np.array([8, 0, 0, 8, 24, 0])  # FREE, SUPPORT, UNSURE, CONTACT, HIDDEN, BORDER
    assert not enclosed(leg), "what goes on was not seen to end, nor was what is hidden"
    leg[TOP, [FREE, CONTACT]] = 16, 0
    assert enclosed(leg)


def test_what_always_ends_above_at_another_thing_does_not_end_by_itself() -> None:
    brim = outline(UNSURE, SUPPORT, FREE, FREE)
    assert enclosed(brim)
    assert not ends_above(brim)
    brim[TOP, FREE] = 11
    assert ends_above(brim), "a third of its top was seen to end in air"


def test_what_goes_on_behind_another_thing_was_not_seen_to_end_beside() -> None:
    assert ends_beside(outline(CONTACT, CONTACT, SUPPORT, FREE)), "whatever is above, and beneath"
    assert ends_beside(outline(FREE, SUPPORT, FREE, UNSURE)), "another thing ends it as air does"
    for kinds in ((FREE, SUPPORT, HIDDEN, FREE), (FREE, SUPPORT, FREE, CONTACT)):
        assert not ends_beside(outline(*kinds))


def test_the_border_of_the_picture_may_cut_off_the_left_or_the_right() -> None:
    assert enclosed(outline(FREE, SUPPORT, FREE, BORDER))
    assert enclosed(outline(FREE, SUPPORT, BORDER, FREE))
    assert not enclosed(outline(FREE, SUPPORT, BORDER, BORDER))
    assert not enclosed(outline(FREE, SUPPORT, BORDER, FREE), cut_off=False), "it may be larger than an object"
    assert enclosed(outline(FREE, SUPPORT, FREE, HIDDEN), cut_off=False, beside=True), "which no border tells"
    assert not enclosed(outline(BORDER, SUPPORT, FREE, FREE)), "a post goes on, too"
    assert not enclosed(outline(HIDDEN, SUPPORT, FREE, BORDER)), "and nothing else may hide in the unknown"
    assert not enclosed(outline(CONTACT, SUPPORT, FREE, BORDER))
    assert log_odds_of(outline(FREE, SUPPORT, FREE, BORDER)) < log_odds_of(outline(FREE, SUPPORT, FREE, FREE))


def test_what_the_picture_cut_off_at_the_top_was_seen_at_other_times() -> None:
    box = outline(FREE, SUPPORT, FREE, FREE, pixels=80)
    box[TOP] = np.array([28, 0, 0, 0, 4, 56])  # FREE, SUPPORT, UNSURE, CONTACT, HIDDEN, BORDER
    assert enclosed(box), "the camera came near, and saw it whole before"
    box[TOP, [FREE, BORDER]] = 4, 240
    assert not enclosed(box), "of a post hardly more than the middle was ever seen"


def test_what_cannot_be_judged_tells_nothing_either_way() -> None:
    assert log_odds_of(outline(HIDDEN, HIDDEN, HIDDEN, HIDDEN)) == 0.0
    assert log_odds_of(np.zeros((4, KINDS))) == 0.0
    half = outline(FREE, SUPPORT, HIDDEN, HIDDEN)
    assert log_odds_of(half) == pytest.approx(log(99) / 4)


def test_among_others_a_thing_takes_longer_than_alone() -> None:
    crowded = log_odds_of(outline(FREE, SUPPORT, UNSURE, UNSURE))
    assert 0 < crowded < log_odds_of(outline(FREE, SUPPORT, FREE, FREE))
    assert log_odds_of(outline(UNSURE, UNSURE, UNSURE, UNSURE)) < 0


def test_what_was_filled_tells_nothing() -> None:
    free, wall = outline(FREE, SUPPORT, FREE, FREE), outline(CONTACT, CONTACT, CONTACT, CONTACT)
    assert log_odds_of(free, FULLY_READ_FRACTION) == log_odds_of(free), "a thing with holes is seen well enough"
    assert log_odds_of(free, FULLY_READ_FRACTION / 10) == pytest.approx(log_odds_of(free) / 10)
    assert log_odds_of(wall, FULLY_READ_FRACTION / 10) == pytest.approx(log_odds_of(wall) / 10), (
        "it tells nothing against it, either"
    )
    assert log_odds_of(free, 0.0) == 0.0


def test_the_outline_is_left_as_it_was() -> None:
    kinds = outline(FREE, CONTACT, FREE, FREE)
    before = kinds.copy()
    log_odds_of(kinds)
    enclosed(kinds)
    np.testing.assert_array_equal(kinds, before)
