from __future__ import annotations

import numpy as np

from cuboid.objects.bonds import Bonds
from cuboid.objects.holdings import Holdings, holdings


def picture(claims: dict[int, tuple[slice, slice]]) -> np.ndarray:
    image = np.full((40, 60), -1, np.int32)
    for k, where in claims.items():
        image[where] = k
    return image


LEFT, RIGHT = np.s_[10:20, 10:20], np.s_[10:20, 20:30]
OWNER = np.zeros((40, 60), np.int32)
OWNER[LEFT], OWNER[RIGHT], OWNER[30:38, 50:58] = 4, 9, 2


def held(claim: np.ndarray) -> Holdings:
    found = holdings(claim, OWNER)
    assert found is not None
    return found


def test_masks_of_their_own_part_two_objects_and_a_common_one_joins_them() -> None:
    apart, together = Bonds(), Bonds()
    for k in range(4):
        assert apart.verdict(4, 9) is None, k
        apart.see(held(picture({0: LEFT, 1: RIGHT})))
        together.see(held(picture({0: np.s_[10:20, 10:30]})))
    assert apart.verdict(4, 9) is False
    assert apart.verdict(9, 4) is False
    assert together.verdict(4, 9) is True


def test_a_rare_slip_does_not_matter_and_disagreement_gives_no_verdict() -> None:
    bonds = Bonds()
    one, two = picture({0: np.s_[10:20, 10:30]}), picture({0: LEFT, 1: RIGHT})
    for _ in range(6):
        bonds.see(held(two))
    bonds.see(held(one))
    assert bonds.verdict(4, 9) is False
    for _ in range(4):
        bonds.see(held(one))
    assert bonds.verdict(4, 9) is None


def test_far_things_and_masks_that_hold_less_than_half_say_nothing() -> None:
    bonds = Bonds()
    for _ in range(9):
        bonds.see(held(picture({0: LEFT, 1: np.s_[30:38, 50:58]})))
        bonds.see(held(picture({0: np.s_[10:20, 10:14], 1: np.s_[10:20, 14:17], 2: np.s_[10:20, 17:20], 3: RIGHT})))
    assert bonds.verdict(2, 4) is None
    assert bonds.verdict(4, 9) is None


def test_an_object_that_is_no_more_is_forgotten() -> None:
    bonds = Bonds()
    for _ in range(5):
        bonds.see(held(picture({0: LEFT, 1: RIGHT})))
    bonds.forget(9)
    assert bonds.verdict(4, 9) is None
