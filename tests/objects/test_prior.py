"""Proposals that look like a labelled object count for more."""

from __future__ import annotations

import numpy as np
import pytest

from cuboid.frame import Intrinsics
from cuboid.geometry.box import Box
from cuboid.heatmap.pixel_heat import WeighedProposals
from cuboid.objects.entry import MapObject, State
from cuboid.objects.prior import prior_of
from cuboid.working import WorkingImage

IMAGE = WorkingImage(
    np.ones((20, 30), np.float32),
    np.zeros((20, 30, 3), np.uint8),
    Intrinsics(30.0, 30.0, 15.0, 10.0, 30, 20),
    1,
    (0, 0),
)
CANDIDATE = np.ones((20, 30), np.uint8)
OWNER = np.zeros((20, 30), np.int32)
OWNER[5:15, 0:10], OWNER[5:15, 15:25], OWNER[0, 29] = 2, 6, 9  # the last one is not in view


def entry(number: int, log_odds: float, state: State = State.CONFIRMED) -> MapObject:
    box = Box(np.zeros(3), np.ones(3), np.eye(3))
    return MapObject(number, box, 0, 0, state=state, label=number, log_odds=log_odds)


def weighed(*boxes: tuple[int, int, int, int]) -> WeighedProposals:
    sizes = [(x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in boxes]
    starts = np.cumsum([0, *sizes])[:-1].astype(np.int64)
    return WeighedProposals(
        np.array(boxes, np.int32), np.ones(sum(sizes), np.uint8), starts, np.ones(len(boxes), np.float32)
    )


def test_a_proposal_gains_by_how_much_it_is_a_sure_object() -> None:
    objects = [entry(2, 3.0), entry(6, 0.0)]
    exact, half, other, nothing, both = prior_of(
        objects, IMAGE, CANDIDATE, OWNER,
        weighed((0, 5, 10, 15), (0, 5, 5, 15), (15, 5, 25, 15), (10, 0, 15, 5), (0, 5, 25, 15)),
    )  # fmt: skip
    sure = 1 / (1 + np.exp(-3.0))
    assert exact == pytest.approx(1 + sure)
    assert half == pytest.approx(1 + 0.5 * sure)
    assert other == pytest.approx(1.5)
    assert nothing == 1.0
    assert both == pytest.approx(1 + 0.4 * sure), "of two objects the likelier one counts"


def test_what_has_no_label_is_not_expected() -> None:
    assert prior_of([entry(2, 3.0, State.CANDIDATE)], IMAGE, CANDIDATE, OWNER, weighed((0, 5, 10, 15))).tolist() == [
        1.0
    ]


def test_what_is_no_candidate_is_no_part_of_a_proposal() -> None:
    candidate = CANDIDATE.copy()
    candidate[:5] = 0
    found = prior_of([entry(2, 60.0)], IMAGE, candidate, OWNER, weighed((0, 0, 10, 15)))
    assert found == pytest.approx([2.0])


def test_without_objects_or_proposals_nothing_is_expected() -> None:
    assert prior_of([], IMAGE, CANDIDATE, OWNER, weighed((0, 5, 10, 15))).tolist() == [1.0]
    none = WeighedProposals(
        np.zeros((0, 4), np.int32), np.zeros(1, np.uint8), np.zeros(0, np.int64), np.zeros(0, np.float32)
    )
    assert prior_of([entry(2, 1.0)], IMAGE, CANDIDATE, OWNER, none).shape == (0,)
