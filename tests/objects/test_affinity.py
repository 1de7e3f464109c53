"""Log-odds that two objects are one."""

from __future__ import annotations

from math import log

import pytest

from cuboid.method.objects.affinity import (
    ATTACHED_LOG_ODDS,
    CERTAIN_LOG_ODDS,
    DIFFERENT_LOG_ODDS,
    JOIN_RATE,
    MAX_LOG_ODDS,
    SAME_LOG_ODDS,
    SPLIT_RATE,
    Affinity,
)


def test_frames_add_up_as_far_as_they_are_news() -> None:
    affinity = Affinity()
    assert affinity.of(1, 2) is None
    affinity.add_evidence(1, 2, SAME_LOG_ODDS, novelty=1.0)
    affinity.add_evidence(2, 1, DIFFERENT_LOG_ODDS, novelty=0.5)
    assert affinity.of(1, 2) == affinity.of(2, 1) == pytest.approx(SAME_LOG_ODDS + 0.5 * DIFFERENT_LOG_ODDS)
    assert affinity.partners(1) == [2]


def test_the_odds_after_many_frames_are_those_of_bayes() -> None:
    """The odds that two are one, of which frames joined three and parted one, against the rates of both errors."""
    affinity = Affinity()
    for one in (True, False, True, True):
        affinity.add_evidence(1, 2, SAME_LOG_ODDS if one else DIFFERENT_LOG_ODDS, novelty=1.0)
    if_one = (1 - SPLIT_RATE) ** 3 * SPLIT_RATE
    if_two = JOIN_RATE**3 * (1 - JOIN_RATE)
    assert affinity.of(1, 2) == pytest.approx(log(if_one / if_two))


def test_a_mistake_of_long_ago_can_be_mended() -> None:
    affinity = Affinity()
    for _ in range(1000):
        affinity.add_evidence(1, 2, DIFFERENT_LOG_ODDS, novelty=1.0)
    assert affinity.of(1, 2) == -MAX_LOG_ODDS
    for _ in range(int(2 * MAX_LOG_ODDS / SAME_LOG_ODDS) + 1):
        affinity.add_evidence(1, 2, SAME_LOG_ODDS, novelty=1.0)
    assert (affinity.of(1, 2) or 0.0) > CERTAIN_LOG_ODDS


def test_the_borders_of_a_part_that_is_held_tell_nothing() -> None:
    affinity = Affinity()
    for _ in range(100):
        affinity.add_evidence(1, 2, DIFFERENT_LOG_ODDS, novelty=1.0)
    affinity.add_attachment(1, 2)
    assert affinity.of(1, 2) == pytest.approx(ATTACHED_LOG_ODDS)
    affinity.add_attachment(1, 2)
    assert affinity.of(1, 2) == pytest.approx(2.0 * ATTACHED_LOG_ODDS)


def test_what_is_no_more_is_beside_nothing() -> None:
    affinity = Affinity()
    for other in (2, 3):
        affinity.add_evidence(1, other, SAME_LOG_ODDS, novelty=1.0)
    affinity.add_evidence(2, 3, DIFFERENT_LOG_ODDS, novelty=1.0)
    affinity.remove(1)
    assert affinity.of(1, 2) is affinity.of(1, 3) is None
    assert (affinity.partners(1), affinity.partners(2), affinity.partners(3)) == ([], [3], [2])
    affinity.remove(17)  # never seen beside anything


def test_what_was_told_of_the_gone_holds_of_the_kept() -> None:
    affinity = Affinity()
    affinity.add_evidence(5, 2, SAME_LOG_ODDS, novelty=1.0)
    affinity.add_evidence(5, 3, DIFFERENT_LOG_ODDS, novelty=1.0)
    affinity.add_evidence(2, 3, DIFFERENT_LOG_ODDS, novelty=1.0)
    affinity.add_evidence(9, 5, SAME_LOG_ODDS, novelty=0.5)
    affinity.transfer(5, 2)
    assert affinity.partners(5) == []
    assert affinity.of(2, 5) is None
    assert affinity.partners(2) == [3, 9]
    assert affinity.of(2, 3) == pytest.approx(2 * DIFFERENT_LOG_ODDS)
    assert affinity.of(2, 9) == pytest.approx(0.5 * SAME_LOG_ODDS)


def test_partners_are_asked_for_by_how_likely_they_are_one_with_an_object() -> None:
    affinity = Affinity()
    for _ in range(100):
        affinity.add_evidence(4, 9, DIFFERENT_LOG_ODDS, novelty=1.0)
        affinity.add_evidence(2, 4, SAME_LOG_ODDS, novelty=1.0)
    affinity.add_evidence(4, 7, SAME_LOG_ODDS, novelty=0.1)
    assert affinity.partners(4) == [2, 7, 9]
    assert affinity.partners(4, min_log_odds=CERTAIN_LOG_ODDS) == [2]
    assert affinity.partners(4, max_log_odds=-CERTAIN_LOG_ODDS) == [9]
    assert affinity.partners(4, min_log_odds=-CERTAIN_LOG_ODDS, max_log_odds=CERTAIN_LOG_ODDS) == [7]
