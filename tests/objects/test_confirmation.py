"""What keeps a candidate from a label: it may be the foot of another thing, its end, or a part of a labelled one."""

from __future__ import annotations

import numpy as np
import pytest
from made_maps import box_of, grid, map_of

from cuboid.ground.core.config import TrackerConfig
from cuboid.method.objects.confirmation import is_confirmable
from cuboid.method.objects.entry import MapObject
from cuboid.method.objects.store import ObjectStore
from cuboid.method.surfaces.kernels.outlines import (
    BORDER,
    BOTTOM,
    FREE,
    HIDDEN,
    KINDS,
    LEFT,
    RIGHT,
    SUPPORT,
    TOP,
    UNSURE,
)

UP = np.array([0.0, 0.0, 1.0])


class _Table:
    """A plane z = 0 that everything stands on, and nothing reaches up to."""

    def find(self, identity: int) -> int:
        return identity

    def in_world(self, plane: int) -> tuple[np.ndarray, float]:
        return UP, 0.0

    def has_plane_on_top(self, box: object) -> bool:
        return False


def candidate(points: np.ndarray, top: int, bottom: int) -> MapObject:
    """A thing that was seen to end in air at its sides, and at one kind of neighbour above and below."""
    low, high = points.min(0), points.max(0)
    box = box_of(np.array([[low[0], low[1], 0.005], high]))  # down to the table
    entry = MapObject(1, 0, 0, box, plane=0)
    entry.points = points.astype(np.float32)
    entry.outline = np.zeros((4, KINDS))
    for side, kind in ((TOP, top), (BOTTOM, bottom), (LEFT, FREE), (RIGHT, FREE)):
        entry.outline[side, kind] = 20
    return entry


def whole(entry: MapObject, beside: np.ndarray, *, labelled: bool = False) -> bool:
    """Tell whether a candidate is whole, another thing with points (N, 3) beside it."""
    store = ObjectStore(map_of((entry.points, 1), (beside, 2)))
    store.place(store.add(entry.box, 0), entry.box)
    other = store.add(box_of(beside), 0)
    other.points = beside.astype(np.float32)
    if labelled:
        store.confirm(other)
    return is_confirmable(entry, store, _Table(), TrackerConfig())  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("top", "height_m", "expected"), [(UNSURE, 0.12, False), (UNSURE, 0.04, True), (FREE, 0.12, True)]
)
def test_a_label_waits_where_a_thing_may_be_the_foot_of_a_higher_one(top: int, height_m: float, expected: bool) -> None:
    brim = candidate(grid((0.12, 0.2), (0.0, 0.1), (0.0, 0.03)), top, SUPPORT)
    assert whole(brim, grid((0.0, 0.12), (0.0, 0.12), (0.0, height_m))) is expected


@pytest.mark.parametrize(
    ("begin_m", "height_m", "side", "expected"),
    [
        (0.13, 0.12, HIDDEN, False),  # the brim of a cap
        (0.13, 0.12, FREE, True),  # a book beside it, seen all round
        (0.13, 0.12, UNSURE, True),  # or of another color, before it
        (0.13, 0.05, HIDDEN, True),  # one behind something that is hardly higher
        (0.20, 0.12, HIDDEN, True),  # or farther off
    ],
)
def test_a_label_waits_where_a_flat_thing_goes_on_behind_a_far_higher_one(
    begin_m: float, height_m: float, side: int, expected: bool
) -> None:
    brim = candidate(grid((begin_m, begin_m + 0.1), (0.0, 0.1), (0.0, 0.03)), FREE, SUPPORT)
    brim.outline[RIGHT] = 0
    brim.outline[RIGHT, side] = 20
    dome = grid((0.0, 0.12), (0.0, 0.12), (0.0, height_m))
    store = ObjectStore(map_of((brim.points, 1), (dome, 2)))
    store.place(store.add(brim.box, 0), brim.box)
    other = store.add(box_of(dome), 0)
    other.points = dome.astype(np.float32)
    store.confirm(other)
    for _ in range(8):
        store.affinity.add_evidence(1, 2, same=False, novelty=1.0)
    assert is_confirmable(brim, store, _Table(), TrackerConfig()) is expected  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("labelled", "begin_m", "expected"), [(True, 0.02, False), (False, 0.02, True), (True, 0.08, True)]
)
def test_a_label_waits_where_a_thing_shares_room_with_a_labelled_one(
    labelled: bool, begin_m: float, expected: bool
) -> None:
    inside = candidate(grid((0.0, 0.12), (0.0, 0.1), (0.0, 0.08)), FREE, SUPPORT)
    rim = grid((begin_m, 0.3), (0.0, 0.1), (0.0, 0.08))
    assert whole(inside, rim, labelled=labelled) is expected


@pytest.mark.parametrize(
    ("length_m", "kind", "expected"), [(0.4, BORDER, True), (0.6, BORDER, False), (0.6, FREE, True)]
)
def test_a_label_waits_where_the_picture_may_have_cut_off_more_than_an_object(
    length_m: float, kind: int, expected: bool
) -> None:
    rim = candidate(grid((0.0, length_m), (0.0, 0.2), (0.0, 0.05)), FREE, SUPPORT)
    rim.outline[LEFT] = 0
    rim.outline[LEFT, kind] = 20
    assert whole(rim, grid((1.0, 1.1), (0.0, 0.1), (0.0, 0.1))) is expected


RED, ORANGE, BLUE, GREY, DARK_GREY = (180, 40, 30), (180, 60, 40), (30, 40, 180), (120, 120, 120), (110, 110, 110)


@pytest.mark.parametrize(
    ("color", "pot", "foot_m", "bottom", "expected"),
    [
        (RED, ORANGE, 0.06, HIDDEN, False),  # the spout of a pot that hides its foot
        (RED, None, 0.06, HIDDEN, False),  # of which nothing is known yet
        (RED, BLUE, 0.06, HIDDEN, True),  # a red thing behind a blue one
        (GREY, DARK_GREY, 0.06, HIDDEN, True),  # many things are grey
        (RED, ORANGE, 0.02, HIDDEN, True),  # its foot was seen
        (RED, ORANGE, 0.06, SUPPORT, False),  # air beneath: then the pot holds it
    ],
)
def test_a_label_waits_where_a_thing_may_be_the_end_of_a_larger_one_of_its_color(
    color: tuple[int, int, int], pot: tuple[int, int, int] | None, foot_m: float, bottom: int, expected: bool
) -> None:
    spout = candidate(grid((0.14, 0.18), (0.0, 0.04), (foot_m, 0.1)), FREE, bottom)
    spout.colors = np.tile(np.array(color, np.uint8), (len(spout.points), 1))
    body = grid((0.0, 0.1), (0.0, 0.1), (0.0, 0.12))
    store = ObjectStore(map_of((spout.points, 1), (body, 2)))
    store.place(store.add(spout.box, 0), spout.box)
    other = store.add(box_of(body), 0)
    other.log_odds = 1.0
    if pot is not None:
        other.points, other.colors = body.astype(np.float32), np.tile(np.array(pot, np.uint8), (len(body), 1))
    assert is_confirmable(spout, store, _Table(), TrackerConfig())  # type: ignore[arg-type]
    store.affinity.add_evidence(1, 2, same=False, novelty=1.0)  # beside each other in a picture
    assert is_confirmable(spout, store, _Table(), TrackerConfig()) is expected  # type: ignore[arg-type]


def test_what_was_found_to_carry_a_plane_gets_no_label() -> None:
    leg = candidate(grid((0.0, 0.04), (0.0, 0.04), (0.0, 0.5)), FREE, SUPPORT)
    leg.supports_plane = True
    assert not whole(leg, grid((0.5, 0.6), (0.5, 0.6), (0.0, 0.1)))


@pytest.mark.parametrize(
    ("labelled", "sightings", "expected"), [(True, 8, True), (True, 2, False), (False, 8, False), (True, 0, False)]
)
def test_a_side_that_a_known_other_thing_hides_need_not_be_seen(labelled: bool, sightings: int, expected: bool) -> None:
    stapler = candidate(grid((0.14, 0.24), (0.0, 0.04), (0.0, 0.04)), FREE, SUPPORT)
    stapler.outline[LEFT] = 0
    stapler.outline[LEFT, HIDDEN] = 20
    telephone = grid((0.0, 0.1), (0.0, 0.2), (0.0, 0.06))
    store = ObjectStore(map_of((stapler.points, 1), (telephone, 2)))
    store.place(store.add(stapler.box, 0), stapler.box)
    other = store.add(box_of(telephone), 0)
    if labelled:
        store.confirm(other)
    for _ in range(sightings):
        store.affinity.add_evidence(1, 2, same=False, novelty=1.0)
    assert is_confirmable(stapler, store, _Table(), TrackerConfig()) is expected  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("height_m", "sides", "expected"),
    [
        (0.02, (FREE, FREE, SUPPORT), False),  # the lip of a shelf, at its far left corner
        (0.02, (SUPPORT, FREE, FREE), False),  # its end
        (0.02, (FREE, SUPPORT, SUPPORT), True),  # a telephone at the far edge of a desk
        (0.06, (FREE, FREE, FREE), True),  # what is higher is seen before what is far behind
    ],
)
def test_a_label_waits_where_a_flat_thing_may_be_the_rim_of_its_plane(
    height_m: float, sides: tuple[int, int, int], expected: bool
) -> None:
    lip = candidate(grid((0.0, 0.3), (0.0, 0.06), (0.0, height_m)), FREE, SUPPORT)
    for side, kind in zip((TOP, LEFT, RIGHT), sides, strict=True):
        lip.outline[side] = 0
        lip.outline[side, kind] = 20
    assert whole(lip, grid((1.0, 1.1), (0.0, 0.1), (0.0, 0.1))) is expected
