from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cuboid.objects.holdings import holdings


@given(st.integers(0, 2**32 - 1), st.integers(1, 400))
def test_each_pixel_is_counted_for_its_object_and_its_mask(seed: int, largest: int) -> None:
    rng = np.random.default_rng(seed)
    claim = rng.integers(-1, 5, (12, 17)).astype(np.int32)
    owner = (rng.integers(0, 3, (12, 17)) * rng.integers(1, largest + 1, (12, 17))).astype(np.int32)
    held = holdings(claim, owner)
    assert held is not None
    assert held.numbers.tolist() == sorted(set(owner[(owner > 0) & (claim >= 0)].tolist()))
    for k, number in enumerate(held.numbers):
        for mask in range(held.table.shape[1]):
            expected = np.flatnonzero((owner == number) & (claim == mask))
            np.testing.assert_array_equal(held.of(k, mask), expected)
            assert held.table[k, mask] == len(expected)


def test_nothing_is_held_where_no_mask_meets_an_object() -> None:
    claim, owner = np.full((4, 4), -1, np.int32), np.ones((4, 4), np.int32)
    assert holdings(claim, owner) is None
    assert holdings(np.zeros((4, 4), np.int32), np.zeros((4, 4), np.int32)) is None
