"""When frames that show two masks make two of one object, and when they do not."""

from __future__ import annotations

import numpy as np
import pytest

from cuboid.objects.holdings import Holdings, holdings
from cuboid.objects.splits import SURE_FRAMES, Splits

SHAPE = (20, 20)
SLOTS = np.arange(400, dtype=np.int32).reshape(SHAPE)
OWNER = np.full(SHAPE, 7, np.int32)
LEFT = np.arange(400).reshape(SHAPE) % 20 < 9


def frame(right_floats: float = 0.0, swap: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Claims of two halves, numbered either way, and heights that rise from the bottom row."""
    claim = np.where(LEFT ^ swap, 3, 5).astype(np.int32)
    heights = np.repeat(np.linspace(0.2, 0.0, 20)[:, None], 20, axis=1).astype(np.float32)
    return claim, np.where(LEFT, heights, heights + np.float32(right_floats))


def held(claim: np.ndarray) -> Holdings:
    found = holdings(claim, OWNER)
    assert found is not None
    return found


def see(splits: Splits, claim: np.ndarray, heights: np.ndarray, side: np.ndarray, times: int = 1) -> None:
    for _ in range(times):
        splits.see(held(claim), heights, SLOTS, side)


def test_two_that_stand_side_by_side_are_two_and_the_sides_are_told_apart() -> None:
    splits, side = Splits(), np.zeros(400, np.int32)
    for k in range(SURE_FRAMES):
        assert not splits.are_two(7)
        see(splits, *frame(swap=k % 2 == 1), side)  # the masks' numbers mean nothing
    assert splits.are_two(7)
    assert abs(side[LEFT.ravel()]).min() == SURE_FRAMES
    assert len(np.unique(side[LEFT.ravel()])) == 1
    np.testing.assert_array_equal(side[~LEFT.ravel()], -side[LEFT.ravel()][0])
    splits.forget(7)
    assert not splits.are_two(7)


@pytest.mark.parametrize("floats_m", [0.1, np.nan])
def test_a_part_that_does_not_stand_splits_nothing(floats_m: float) -> None:
    splits, side = Splits(), np.zeros(400, np.int32)
    see(splits, *frame(right_floats=floats_m), side, 5 * SURE_FRAMES)
    assert not splits.are_two(7)
    assert not side.any()


def test_frames_that_see_one_thing_outweigh_those_that_see_two() -> None:
    splits, side = Splits(), np.zeros(400, np.int32)
    _, heights = frame()
    see(splits, np.zeros(SHAPE, np.int32), heights, side, 2 * SURE_FRAMES)
    see(splits, *frame(), side, SURE_FRAMES)
    assert not splits.are_two(7)
    see(splits, *frame(), side, SURE_FRAMES)
    assert splits.are_two(7)
