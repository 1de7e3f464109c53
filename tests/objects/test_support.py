"""What carries a thing, and what holds it where nothing does."""

from __future__ import annotations

import numpy as np
import pytest
from made_maps import box_of, grid, map_of, shell

from cuboid.ground.geometry.box import Box
from cuboid.method.objects.entry import MapObject
from cuboid.method.objects.support import (
    above_support_rim,
    encloses,
    find_attachment,
    find_coaxial,
    find_other_wall,
    seen_part,
)

UP = np.array([0.0, 0.0, 1.0])
TABLE = grid((0.0, 0.6), (0.0, 0.4), (-0.01, 0.0))
POT = shell((0.2, 0.32), (0.1, 0.22), (0.0, 0.12))


def table_around(*hidden: tuple[float, float]) -> np.ndarray:
    """The table as far as it was seen: nothing of it from so far to so far along x, metres."""
    seen = np.ones(len(TABLE), bool)
    for low, high in hidden:
        seen &= (TABLE[:, 0] < low) | (TABLE[:, 0] > high)
    return TABLE[seen]


def holder(table: np.ndarray, *things: np.ndarray) -> int:
    """What holds the first one of things, which are 1, 2, .. ; 0 for nothing."""
    numbered = list(enumerate(things, 1))
    entries = [MapObject(k, 0, 0, box_of(p), points=p.astype(np.float32)) for k, p in numbered]
    voxels = map_of((table, 0), *((points, number) for number, points in numbered))
    return find_attachment(entries[0], UP, 0.0, entries[1:], voxels)


def test_a_spout_over_the_table_is_held_by_its_pot() -> None:
    spout = grid((0.32, 0.38), (0.15, 0.17), (0.05, 0.11))
    assert holder(table_around((0.2, 0.32)), spout, POT) == 2


def test_where_the_table_below_was_not_seen_its_foot_may_be_hidden() -> None:
    top = grid((0.32, 0.38), (0.15, 0.17), (0.05, 0.11))
    assert holder(table_around((0.2, 0.4)), top, POT) == 0


def test_what_stands_on_the_table_is_held_by_nothing_it_touches() -> None:
    mug = shell((0.32, 0.4), (0.1, 0.18), (0.0, 0.1))
    assert holder(table_around((0.2, 0.4)), mug, POT) == 0


def test_what_stands_on_top_of_another_one_is_carried_by_that() -> None:
    book = shell((0.1, 0.36), (0.1, 0.28), (0.0, 0.05))
    jar = shell((0.2, 0.28), (0.14, 0.22), (0.05, 0.16))
    assert holder(table_around((0.1, 0.36)), jar, book) == 0


def test_a_plant_is_held_by_the_pot_around_its_foot_even_where_that_is_the_smaller_one() -> None:
    pot = shell((0.2, 0.32), (0.1, 0.22), (0.0, 0.09))
    plant = grid((0.22, 0.3), (0.12, 0.2), (0.06, 0.22))
    assert len(plant) > len(pot)
    assert holder(table_around((0.2, 0.32)), plant, pot) == 2


def test_a_screen_whose_stand_was_not_seen_is_no_part_of_a_cup_before_it() -> None:
    screen = grid((0.1, 0.5), (0.2, 0.22), (0.06, 0.36))
    cup = shell((0.2, 0.28), (0.12, 0.2), (0.0, 0.1))
    assert holder(table_around((0.2, 0.28)), screen, cup) == 0


def test_what_touches_nothing_is_held_by_nothing() -> None:
    lamp = grid((0.45, 0.5), (0.15, 0.2), (0.2, 0.3))
    assert holder(TABLE, lamp, POT) == 0


# What is seen of a jar on a shelf from before it, 0.6 m above the floor, and the rim of the shelf's board before it.
JAR = grid((0.3, 0.4), (0.3, 0.35), (0.62, 0.76))
RIM = grid((0.1, 0.45), (0.22, 0.26), (0.59, 0.62))


def stands(*parts: np.ndarray) -> list[bool]:
    """For each of the parts of a thing above a floor at height 0 whether most of it stands."""
    own = above_support_rim(np.concatenate(parts).astype(np.float32), UP, 0.0, 0.01)
    told = np.split(own, np.cumsum([len(part) for part in parts])[:-1])
    return [bool(part.mean() > 0.75) for part in told]


def test_the_rim_of_a_shelf_before_a_jar_and_lower_does_not_carry_it() -> None:
    side = grid((0.43, 0.45), (0.22, 0.26), (0.3, 0.59))[::4]  # of the shelf, beneath its board
    assert stands(JAR, RIM) == [True, False]
    assert stands(JAR, RIM, side) == [True, False, False]


def test_a_rim_is_found_wherever_it_begins() -> None:
    side = grid((0.43, 0.45), (0.22, 0.26), (0.3, 0.59))[::4]
    for more_m in np.arange(0.0, 0.03, 0.005):
        lowest = np.array([[0.44, 0.24, 0.3 - more_m]])
        assert stands(JAR, RIM, side, lowest) == [True, False, False, False]


def test_what_is_beneath_carries_however_wide_it_is() -> None:
    tray = grid((0.1, 0.6), (0.2, 0.45), (0.59, 0.62))
    neck = grid((0.33, 0.37), (0.3, 0.34), (0.76, 0.82))
    assert stands(JAR, tray[(tray[:, 0] > 0.25) & (tray[:, 0] < 0.45)]) == [True, True]
    assert stands(JAR, neck) == [True, True]


def test_what_is_no_wider_is_no_rim() -> None:
    leaf = grid((0.3, 0.42), (0.24, 0.28), (0.58, 0.61))
    assert stands(JAR, leaf) == [True, True]


def test_what_stands_on_its_plane_keeps_all_of_its_points() -> None:
    assert stands(JAR - [0.0, 0.0, 0.59], RIM - [0.0, 0.0, 0.59]) == [True, True]


CAN = shell((0.2, 0.27), (0.1, 0.17), (0.0, 0.12))
SIDES = [shell((0.0, 0.01), (0.0, 0.3), (0.0, 0.4)), shell((0.59, 0.6), (0.0, 0.3), (0.0, 0.4))]
BOARD = grid((0.0, 0.6), (0.0, 0.3), (0.24, 0.25))


def entry(number: int, *parts: np.ndarray) -> MapObject:
    points = np.concatenate(parts)
    return MapObject(number, 0, 0, box_of(points), points=points.astype(np.float32))


def test_a_shelf_encloses_what_stands_beneath_one_of_its_boards() -> None:
    assert encloses(entry(1, *SIDES, BOARD), [entry(2, CAN)], 0.01)


def test_an_open_box_and_a_lamp_enclose_nothing_of_what_stands_in_and_beneath_them() -> None:
    assert not encloses(entry(1, *SIDES, grid((0.0, 0.6), (0.0, 0.3), (0.0, 0.01))), [entry(2, CAN)], 0.01)
    arm = grid((0.22, 0.24), (0.0, 0.3), (0.38, 0.4))
    assert not encloses(entry(1, *SIDES, arm), [entry(2, CAN)], 0.01)


def test_a_shelf_does_not_enclose_what_stands_before_it_or_on_it() -> None:
    before, above = (CAN + np.array(shift) for shift in ((0.0, -0.12, 0.0), (0.0, 0.0, 0.25)))
    assert not encloses(entry(1, *SIDES, BOARD), [entry(2, before), entry(3, above)], 0.01)


def with_assumed_foot(number: int, points: np.ndarray, down_to_m: float = 0.0) -> MapObject:
    """An object whose box reaches down to a height, below its lowest points."""
    found = entry(number, points)
    low_m = found.box.foot_m(UP, 0.0)
    size = found.box.size + (low_m - down_to_m) * UP
    found.box = Box(found.box.center - 0.5 * (low_m - down_to_m) * UP, size, found.box.rotation)
    return found


LEAVES = grid((0.23, 0.29), (0.13, 0.19), (0.16, 0.2))
POT_RIM = grid((0.2, 0.32), (0.1, 0.22), (0.08, 0.1))


def test_the_seen_part_of_an_object_begins_at_its_lowest_points() -> None:
    whole = with_assumed_foot(1, LEAVES)
    part = seen_part(whole, UP)
    assert whole.box.size[2] == pytest.approx(part.size[2] + 0.16, abs=0.01)
    assert part.foot_m(UP, 0.0) == pytest.approx(0.16, abs=0.01)
    standing = entry(2, POT)
    np.testing.assert_allclose(seen_part(standing, UP).size, standing.box.size, atol=0.01)


def test_leaves_above_the_middle_of_a_pot_and_the_pot_are_one_where_nothing_was_seen_between() -> None:
    leaves, pot = with_assumed_foot(1, LEAVES), with_assumed_foot(2, POT_RIM)
    assert find_coaxial(leaves, UP, [pot], 0.01) == 2
    assert find_coaxial(pot, UP, [leaves], 0.01) == 1


def test_things_that_touch_stand_apart_or_show_free_space_between_do_not_share_an_axis() -> None:
    pot = with_assumed_foot(2, POT_RIM)
    beside = with_assumed_foot(1, LEAVES + np.array([0.03, 0.0, 0.0]))
    assert find_coaxial(beside, UP, [pot], 0.01) == 0
    on_top = with_assumed_foot(1, LEAVES - 0.06 * UP)
    assert find_coaxial(on_top, UP, [pot], 0.01) == 0
    # The box of an object beneath which free space was seen ends at its lowest points.
    assert find_coaxial(entry(1, LEAVES), UP, [pot], 0.01) == 0


def wall(
    first_deg: float, last_deg: float, radius_m: float = 0.045, low_m: float = 0.0, x_m: float = 0.3
) -> np.ndarray:
    """Points on a part of an upright round wall, 10 cm high."""
    turn = np.arange(np.radians(first_deg), np.radians(last_deg), 0.008 / radius_m)
    angle, height = (k.ravel() for k in np.meshgrid(turn, np.arange(low_m + 0.005, low_m + 0.1, 0.01)))
    return np.column_stack([x_m + radius_m * np.cos(angle), 0.2 + radius_m * np.sin(angle), height])


MUG = wall(0.0, 190.0)
HANDLE = grid((0.29, 0.31), (0.14, 0.16), (0.03, 0.07))


@pytest.mark.parametrize(
    ("other", "is_one"),
    [
        (wall(200.0, 350.0), True),
        (np.concatenate([wall(200.0, 350.0), HANDLE]), True),
        (np.concatenate([wall(195.0, 265.0), *(HANDLE - [0.0, 0.02 * k, 0.0] for k in range(3))]), True),
        (wall(0.0, 180.0, radius_m=0.04, x_m=0.215), False),  # a can beside it
        (wall(200.0, 350.0, radius_m=0.015), False),  # a pen in it
        (wall(0.0, 180.0, low_m=0.1), False),  # another one on top of it
        (grid((0.26, 0.34), (0.11, 0.15), (0.0, 0.1)), False),  # a box before it
    ],
)
def test_the_near_and_the_far_wall_of_a_mug_are_one_and_no_two_things_are(other: np.ndarray, is_one: bool) -> None:
    smaller, larger = sorted([entry(1, MUG), entry(2, other)], key=lambda one: len(one.points))
    found = find_other_wall(smaller, UP, 0.0, [larger], 0.01)
    assert found == (larger.number if is_one else 0)
    assert find_other_wall(larger, UP, 0.0, [smaller], 0.01) == 0, "the smaller part is held by the larger one"
