"""Whether labelled objects are still in their place, from the rays of frames to their points."""

from __future__ import annotations

from math import log

import pytest

from cuboid.method.objects.presence import DOUBTED, GONE, Rays, doubts


def test_a_frame_that_sees_through_an_object_adds_its_weight() -> None:
    rays = {1: Rays(10, 90), 2: Rays(300, 5), 3: Rays(60, 40), 4: Rays(19, 80), 5: Rays(1, 9)}
    after = doubts(rays, {1: 0.5, 2: -GONE, 3: 1.0, 4: GONE, 5: -2.0}, 0.25)
    step = 0.25 * log(0.85 / 0.15)
    assert after == pytest.approx({1: 0.5 + step, 2: -GONE, 3: 1.0 - step, 4: GONE, 5: step})


def test_what_is_hidden_stays_as_it_was() -> None:
    assert doubts({1: Rays(2, 3), 2: Rays(0, 0)}, {1: 2.0, 2: 0.0}, 1.0) == {}


def test_a_frame_with_an_error_of_its_pose_shows_neither() -> None:
    assert doubts({1: Rays(40, 60), 2: Rays(21, 79)}, {1: 1.0, 2: 2.0}, 1.0) == {}


@pytest.mark.parametrize(("other", "expected"), [(Rays(100, 0), 40), (Rays(0, 0), 199), (Rays(0, 100), 199)])
def test_an_object_is_gone_after_a_second_and_a_third_if_another_one_confirms_the_pose(
    other: Rays, expected: int
) -> None:
    doubt, frames = {1: 0.0, 2: 0.0}, 0
    for _ in range(1000):
        doubt |= doubts({1: Rays(100, 0), 2: Rays(100, 0)}, doubt, 0.1)
    while doubt[1] < GONE:  # 30 Hz: a third of a second has the weight of one
        doubt |= doubts({1: Rays(0, 100), 2: other}, doubt, 0.1)
        frames += 1
        assert (doubt[1] > DOUBTED) == (frames > (expected + 1) / 3)
    assert frames == expected
    assert doubts({1: Rays(0, 100), 2: other}, doubt, 1.0)[1] == GONE


def test_an_object_confirms_a_pose_after_a_second_and_a_third_in_its_place() -> None:
    rays, before = {1: Rays(0, 100), 2: Rays(100, 0)}, {1: 0.0, 2: 0.0}
    for frame in range(45):
        step = doubts(rays, {**before, 1: 0.0}, 0.1)[1]
        assert step == pytest.approx(0.1 * log(0.85 / 0.15) * (0.2 if frame < 40 else 1.0))
        before |= doubts(rays, before, 0.1)
