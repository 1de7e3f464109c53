"""The one store of objects: labels only grow, merging keeps the older one, what is retired leaves no trace."""

from __future__ import annotations

import numpy as np
import pytest
from made_maps import grid, map_of

from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.kernels.overlap import BATCH
from cuboid.ground.geometry.overlap import pack
from cuboid.method.objects.affinity import SAME_LOG_ODDS
from cuboid.method.objects.entry import ObjectWithoutDepth, State
from cuboid.method.objects.objectness import PRIOR_AGREEMENT, quantities_of
from cuboid.method.objects.store import ObjectStore
from cuboid.method.objects.store.evidence import MAX_LOG_ODDS


def box(x: float, size: float = 0.1) -> Box:
    return Box(np.array([x, 0.0, 0.0]), np.full(3, size), np.eye(3))


def store_of(count: int) -> ObjectStore:
    """Objects 1, 2, .. a metre apart, each with 100 voxels."""
    parts = [(grid((k, k + 0.1), (0, 0.1), (0, 0.01)), k) for k in range(1, count + 1)]
    store = ObjectStore(map_of(*parts))
    for k in range(1, count + 1):
        assert store.add(box(float(k)), frame=10 * k).number == k
    return store


def owners(store: ObjectStore) -> dict[int, int]:
    return {number: len(rows) for number, rows in store._voxels.stored.owned().items()}


def test_labels_count_up_in_the_order_of_confirmation() -> None:
    store = store_of(3)
    assert store.confirmed() == []
    store.confirm(store[3])
    store.confirm(store[1])
    assert [(o.number, o.label) for o in store.confirmed()] == [(3, 1), (1, 2)]
    assert [o.number for o in store.living()] == [1, 2, 3]
    assert len(store.confirmed()) == 2


def test_a_retired_label_is_never_given_again_and_its_voxels_are_no_ones() -> None:
    store = store_of(3)
    store.confirm(store[1])
    store.affinity.add_evidence(1, 2, SAME_LOG_ODDS, novelty=1.0)
    store.retire(store[1])
    assert store[1].state is State.RETIRED
    assert [o.number for o in store.living()] == [2, 3]
    assert store.all_of([3, 1, 2, 77]) == [store[2], store[3]]
    assert owners(store) == {2: 100, 3: 100}
    assert store.affinity.partners(2) == []
    store.confirm(store[2])
    assert store[2].label == 2
    assert len(store.confirmed()) == 1
    assert store.add(box(9.0), 0).number == 4


def test_a_candidate_that_ends_is_forgotten() -> None:
    store = store_of(2)
    store.retire(store[1])
    assert 1 not in store
    assert owners(store) == {2: 100}
    assert store.add(box(0.0), 0).number == 3, "numbers are not given again"


@pytest.mark.parametrize("order", [(1, 2), (2, 1)])
def test_merging_keeps_the_older_label_and_records_the_younger(order: tuple[int, int]) -> None:
    store = store_of(3)
    store.confirm(store[2])  # label 1
    store.confirm(store[1])  # label 2
    store[1].merged_labels = [7]
    store[1].supports, store[2].supports = {4: 10, 5: 1}, {4: 1}
    store[1].outline[0, 0], store[2].outline[0, 0] = 3, 4
    store[1].sightings, store[2].sightings = 9, 5
    store.affinity.add_evidence(1, 3, SAME_LOG_ODDS, novelty=1.0)
    gone_one = store[1]
    kept, gone = store.merge(*(store[k] for k in order))
    assert (kept.number, kept.label, kept.merged_labels) == (2, 1, [2, 7])
    assert gone is gone_one
    assert gone.survivor is kept
    assert 1 not in store
    assert [o.label for o in store.confirmed()] == [1]
    assert owners(store) == {2: 200, 3: 100}
    assert (kept.first_frame, kept.last_frame) == (10, 20)
    assert kept.supports == {4: 11, 5: 1}
    assert kept.outline[0, 0] == 7
    assert kept.sightings == 9
    assert store.affinity.partners(2) == [3]
    assert kept.fitted == 0, "its box is fitted anew"


def test_a_label_outlives_an_older_candidate() -> None:
    store = store_of(2)
    store.confirm(store[2])
    kept, _ = store.merge(store[1], store[2])
    assert (kept.number, kept.label, kept.merged_labels) == (2, 1, [])


def test_the_table_has_the_boxes_of_those_that_live_and_grows_with_them() -> None:
    store = ObjectStore(map_of((grid((0, 0.1), (0, 0.1), (0, 0.1)), 0)))
    entries = [store.add(box(0.5 * k), 0) for k in range(200)]
    store.place(entries[7], box(70.0))
    for k in (3, 150):
        store.retire(entries[k])
    store.place(entries[3], box(1.0))  # no one's box any more
    living = [e for k, e in enumerate(entries) if k not in (3, 150)]
    known = np.flatnonzero(~np.isnan(store.boxes[:, 0]))
    assert known.tolist() == [e.number for e in living]
    np.testing.assert_array_equal(store.boxes[known], pack([e.box for e in living]))
    assert store.numbers == 201


def test_neighbours_are_those_whose_spheres_come_near() -> None:
    rng = np.random.default_rng(1)
    store = ObjectStore(map_of((grid((0, 0.1), (0, 0.1), (0, 0.1)), 0)))
    boxes = [Box(rng.uniform(-1, 1, 3), rng.uniform(0.05, 0.5, 3), np.eye(3)) for _ in range(150)]
    entries = [store.add(one, 0) for one in boxes]
    here = entries[17].box

    def gap(other: Box) -> float:
        apart = np.linalg.norm(other.center - here.center)
        return float(apart - (np.linalg.norm(other.size) + np.linalg.norm(here.size)) / 2)

    expected = [e.number for e in entries if gap(e.box) <= 0.1]
    assert [e.number for e in store.near(here, 0.1)] == expected
    assert 5 < len(expected) < 145
    # The bounds of their batches follow those that move, and those that are no more.
    for k, entry in enumerate(entries):
        if entry.number in expected and entry.box is not here:
            store.place(entry, Box(entry.box.center + 10.0, entry.box.size, np.eye(3))) if k % 2 else store.retire(
                entry
            )
    assert [e.number for e in store.near(here, 0.1)] == [entries[17].number]
    assert len(store.near(Box(here.center + 10.0, here.size, np.eye(3)), 1.0)) > 1
    assert len(store.bounds) * BATCH == len(store.boxes)


def test_frames_without_a_match_add_up_in_a_row_by_their_weight() -> None:
    store = store_of(1)
    counted = []
    for weight, matched in ((1.0, True), (0.5, False), (0.0, False), (1.0, False), (1.0, True), (0.5, False)):
        store.record_shown(store[1], weight=weight, matched=matched)
        counted.append((store[1].shown, store[1].missed))
    assert counted == [(1.0, 0.0), (1.5, 0.5), (1.5, 0.5), (2.5, 1.5), (3.5, 0.0), (4.0, 0.5)]


def test_an_object_that_is_moved_is_retired_until_it_is_set_down_and_keeps_its_label() -> None:
    store = store_of(2)
    store.confirm(store[1])
    entry = store[1]
    entry.supports, entry.plane, entry.sightings = {4: 10}, 4, 7
    store.attach(entry, 2, supports_plane=True)
    store.lift(entry)
    assert owners(store) == {2: 100}
    store.move(entry, box(5.0), np.ones((3, 3), np.float32))
    assert not entry.confirmed
    assert np.isnan(store.boxes[1]).all(), "an object that is being moved is beside no other"
    store.set_down(entry, box(6.0))
    assert (entry.label, entry.moved, entry.confirmed) == (1, True, True)
    assert [o.number for o in store.near(box(6.0), 0.0)] == [1]
    assert (entry.plane, entry.supports, entry.holder, entry.supports_plane) == (None, {}, 0, False)
    assert entry.fitted == entry.sightings == 1.0, "what was seen elsewhere counts little"
    assert len(store.confirmed()) == 1


def test_sightings_of_an_earlier_visit_count_less_with_the_same_means() -> None:
    store = store_of(1)
    entry = store[1]
    entry.sightings, entry.fitted, entry.shown = 21.0, 20.0, 42.0
    entry.compared, entry.agreement = 20.0, 20.0 * PRIOR_AGREEMENT
    entry.whole_log_odds, entry.scored = 30.0, 20.0
    entry.outline = entry.outline + 21.0
    before = quantities_of(entry)
    store.begin_visit(3.0)
    assert (entry.sightings, entry.fitted, entry.shown) == (3.0, 3.0, 6.0)
    after = quantities_of(entry)
    assert entry.agreement / entry.compared == pytest.approx(PRIOR_AGREEMENT)
    assert after.unrepeated > before.unrepeated
    assert entry.whole_log_odds / entry.scored == pytest.approx(1.5)
    for name in ("agreement", "top_free", "side_judged"):
        assert getattr(after, name) == pytest.approx(getattr(before, name)), name
    store.begin_visit(3.0)
    assert quantities_of(entry) == after


def test_scores_of_segments_are_weighted_and_limited() -> None:
    store = store_of(1)
    entry = store[1]
    store.add_score(entry, 2.0, 0.5)
    store.add_score(entry, -9.0, 1.0)
    assert (entry.whole_log_odds, entry.scored) == (0.5 * 2.0 - MAX_LOG_ODDS, 1.5)


def test_a_label_that_is_taken_over_is_on_one_object_alone() -> None:
    store = store_of(2)
    store.confirm(store[1])
    store.confirm(store[2])
    store[1].frames_seen, store[2].frames_seen = 3, 4
    old, entry = store[1], store[2]
    store.retire(old)
    store.take_over(entry, old)
    assert (entry.label, entry.merged_labels, entry.first_frame, entry.frames_seen) == (1, [2], 10, 7)
    assert store.ever_labelled() == [entry]


def without_depth(store: ObjectStore, x: float, frame: int) -> ObjectWithoutDepth:
    return store.add_without_depth(np.eye(3), np.array([x, 0.0, 0.0]), frame)


def test_objects_with_and_without_depth_share_the_labels() -> None:
    store = store_of(1)
    entry = without_depth(store, 3.0, 5)
    store.confirm(entry)
    store.confirm(store[1])
    assert (entry.label, store[1].label, len(store.confirmed())) == (1, 2, 1)
    store.retire(entry)
    assert (entry.state, store.without_depth()) == (State.RETIRED, [])
    other = without_depth(store, 3.0, 6)
    store.confirm(other)
    assert (other.number, other.label) == (2, 3)


def test_an_object_without_depth_that_is_one_of_the_map_gives_it_the_older_label() -> None:
    store = store_of(1)
    entry = without_depth(store, 1.0, 5)
    store.confirm(entry)
    store.confirm(store[1])
    store.join_map(entry, store[1])
    assert (store[1].label, store[1].merged_labels, store[1].first_frame) == (1, [2], 5)
    assert (entry.label, entry.merged_labels, entry.partner) == (1, [], 1)
    store.retire(store[1])
    store.leave_map(entry)
    assert (entry.label, entry.partner, entry.confirmed) == (1, 0, True)
    other = store.add(box(1.0), 30)
    store.confirm(other)
    store.join_map(entry, other)
    store.join_map(entry, other)
    assert (other.label, other.merged_labels) == (1, [3]), "a label is not merged into itself"


def test_of_two_objects_without_depth_the_older_label_stays() -> None:
    store = store_of(1)
    kept, gone = without_depth(store, 1.0, 5), without_depth(store, 1.1, 2)
    store.confirm(kept)
    store.confirm(gone)
    for entry, hits in ((kept, 2), (gone, 4)):
        for _ in range(hits):
            store.add_hit(entry, 0.1 * hits, keyframe=1)
    store.add_evidence(gone, 2.0)
    store.merge_without_depth(kept, gone, (np.ones(3), np.array([0.3, 0.2])))
    assert (kept.label, kept.merged_labels, kept.first_frame) == (1, [2], 2)
    assert (kept.hits, kept.log_odds) == (4, 2.0)
    assert kept.read == pytest.approx((2 * 0.2 + 4 * 0.4) / 6), "the mean of all detections"
    np.testing.assert_allclose(kept.center, 0.5)
    assert store.without_depth() == [kept]


def test_a_state_keeps_the_objects_without_depth() -> None:
    store = store_of(1)
    entries = [without_depth(store, float(k), k) for k in range(3)]
    store.confirm(entries[1])
    store.retire(entries[2])
    saved = store.state_without_depth()
    store.add_evidence(entries[0], 1.0)
    assert saved[0].log_odds == 0.0, "later updates do not change it"
    again = store_of(1)
    again.restore_without_depth(saved)
    assert [o.number for o in again.without_depth()] == [1, 2]
    assert [o.confirmed for o in again.without_depth()] == [False, True]
    assert without_depth(again, 0.0, 9).number == 3


def test_measured_sides_follow_the_axes_of_a_new_box_and_a_box_that_only_moves() -> None:
    store, c, s = store_of(1), np.cos(0.6), np.sin(0.6)
    entry, views = store[1], np.array([[0.12, 0.1, 1e-3, 2e-3]])
    turned = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    store.confirm(entry)
    store.set_box(entry, entry.box, views)
    store.lift(entry)
    store.move(entry, Box(entry.box.center, entry.box.size, turned), np.ones((3, 3), np.float32))
    store.set_down(entry, entry.box)
    np.testing.assert_array_equal(entry.sides_m, views)
    store.set_box(entry, Box(entry.box.center, entry.box.size, turned @ quarter))
    np.testing.assert_array_equal(entry.sides_m, views[:, [1, 0, 3, 2]])
    entry.sightings = 9
    store.count_measured(entry)
    assert entry.measured == 9
    store.set_down(entry, Box(entry.box.center, entry.box.size, np.eye(3)))
    assert entry.sides_m.shape == (0, 4), "they are of other axes"
    assert entry.measured == 0, "it is measured anew"
