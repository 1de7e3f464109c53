"""What keeps a candidate from a label: it may be the foot of another thing, or a part of a labelled one."""

from __future__ import annotations

import numpy as np
import pytest
from made_maps import box_of, grid, map_of

from cuboid.config import TrackerConfig
from cuboid.kernels.outlines import BOTTOM, FREE, KINDS, LEFT, RIGHT, SUPPORT, TOP, UNSURE
from cuboid.objects.entry import MapObject
from cuboid.objects.store import ObjectStore
from cuboid.objects.wholeness import is_whole

UP = np.array([0.0, 0.0, 1.0])


class _Table:
    """A plane z = 0 that everything stands on, and nothing reaches up to."""

    def find(self, identity: int) -> int:
        return identity

    def in_world(self, plane: int) -> tuple[np.ndarray, float]:
        return UP, 0.0

    def lies_on(self, box: object) -> bool:
        return False


def candidate(points: np.ndarray, top: int, bottom: int) -> MapObject:
    """A thing that was seen to end in air at its sides, and at one kind of neighbour above and below."""
    low, high = points.min(0), points.max(0)
    box = box_of(np.array([[low[0], low[1], 0.005], high]))  # down to the table
    entry = MapObject(1, box, 0, 0, plane=0)
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
    return is_whole(entry, store, _Table(), TrackerConfig())  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("top", "height_m", "expected"), [(UNSURE, 0.12, False), (UNSURE, 0.04, True), (FREE, 0.12, True)]
)
def test_a_label_waits_where_a_thing_may_be_the_foot_of_a_higher_one(top: int, height_m: float, expected: bool) -> None:
    brim = candidate(grid((0.12, 0.2), (0.0, 0.1), (0.0, 0.03)), top, SUPPORT)
    assert whole(brim, grid((0.0, 0.12), (0.0, 0.12), (0.0, height_m))) is expected


@pytest.mark.parametrize(
    ("labelled", "begin_m", "expected"), [(True, 0.02, False), (False, 0.02, True), (True, 0.08, True)]
)
def test_a_label_waits_where_a_thing_shares_room_with_a_labelled_one(
    labelled: bool, begin_m: float, expected: bool
) -> None:
    inside = candidate(grid((0.0, 0.12), (0.0, 0.1), (0.0, 0.08)), FREE, SUPPORT)
    rim = grid((begin_m, 0.3), (0.0, 0.1), (0.0, 0.08))
    assert whole(inside, rim, labelled=labelled) is expected
