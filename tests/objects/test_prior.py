"""Proposals that look like a labelled object count for more."""

from __future__ import annotations

import numpy as np
import pytest

from cuboid.ground.geometry.box import Box
from cuboid.method.heatmap.pixel_heat import WeighedProposals
from cuboid.method.objects.association import prior_of
from cuboid.method.objects.entry import MapObject, State

OWNER = np.zeros((20, 30), np.int32)
OWNER[5:15, 0:10], OWNER[5:15, 15:25], OWNER[0, 29] = 2, 6, 9  # the last one is not in view


def entry(number: int, probability: float, state: State = State.CONFIRMED) -> MapObject:
    box = Box(np.zeros(3), np.ones(3), np.eye(3))
    return MapObject(number, 0, 0, box, state=state, label=number, probability=probability)


def weighed(*boxes: tuple[int, int, int, int]) -> WeighedProposals:
    """Proposals that cover their whole boxes."""
    starts = np.cumsum([0, *((x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in boxes)])
    return WeighedProposals(
        np.array(boxes, np.int64).reshape(-1, 4), starts, np.ones(starts[-1], np.uint8), np.ones(len(boxes), np.float32)
    )


def test_a_proposal_gains_by_the_probability_of_the_object_that_it_shows() -> None:
    objects = [entry(2, 0.9), entry(6, 0.5)]
    exact, half, other, nothing, both = prior_of(
        objects, OWNER, weighed((0, 5, 10, 15), (0, 5, 5, 15), (15, 5, 25, 15), (10, 0, 15, 5), (0, 5, 25, 15))
    )
    assert exact == pytest.approx(1.9)
    assert half == pytest.approx(1.45)
    assert other == pytest.approx(1.5)
    assert nothing == 1.0
    assert both == pytest.approx(1.36), "of two objects the likelier one counts"


def test_what_has_no_label_is_not_expected() -> None:
    assert prior_of([entry(2, 0.9, State.CANDIDATE)], OWNER, weighed((0, 5, 10, 15))).tolist() == [1.0]


def test_what_a_proposal_does_not_cover_is_no_part_of_it() -> None:
    whole = weighed((0, 0, 10, 15))
    whole.covered[:50] = 0  # rows 0 to 4
    assert prior_of([entry(2, 1.0)], OWNER, whole) == pytest.approx([2.0])


def test_without_objects_or_proposals_nothing_is_expected() -> None:
    assert prior_of([], OWNER, weighed((0, 5, 10, 15))).tolist() == [1.0]
    assert prior_of([entry(2, 1.0)], OWNER, weighed()).shape == (0,)
