"""Evidence of a frame for pairs of objects, and which points one object may take from another."""

from __future__ import annotations

import numpy as np
import pytest
from made_maps import map_of, shell

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.geometry.box import Box
from cuboid.method.boxes.top_edges import Picture
from cuboid.method.objects import fitting, object_map
from cuboid.method.objects.affinity import CERTAIN_LOG_ODDS, DIFFERENT_LOG_ODDS, SAME_LOG_ODDS
from cuboid.method.objects.association import Association
from cuboid.method.objects.object_map import ObjectMap
from cuboid.method.surfaces.planes import PlaneTracker

JAR = np.array([0.1, 0.1, 0.16])


@pytest.mark.parametrize("labelled", [1, 2])
def test_a_pair_in_one_place_is_told_once_a_frame_however_many_of_it_have_labels(labelled: int) -> None:
    config = TrackerConfig()
    voxels = map_of((shell((0.3, 0.4), (0.3, 0.4), (0.0, 0.16)), 1), (shell((0.32, 0.4), (0.3, 0.4), (0.0, 0.1)), 2))
    objects = ObjectMap(config, voxels, PlaneTracker(config))
    pair = [objects.store.add(Box(np.array([0.35, 0.35, 0.08]), JAR, np.eye(3)), 0) for _ in range(2)]
    for entry in pair:
        entry.points = voxels.stored.xyz(voxels.stored.rows_of(entry.number))
    for entry in pair[:labelled]:
        objects.store.confirm(entry)
    objects._add_overlaps(pair, 0.5, {frozenset((1, 2))})
    assert not objects.store.affinity.of(1, 2), "the frame shows them side by side"
    objects._add_overlaps(pair, 0.5, set())
    assert objects.store.affinity.of(1, 2) == pytest.approx(0.5 * SAME_LOG_ODDS)


@pytest.mark.parametrize(
    ("labelled", "told", "takes"),
    [
        (True, 0.4 * CERTAIN_LOG_ODDS, 0),
        (True, 0.6 * CERTAIN_LOG_ODDS, 1),
        (False, 0.6 * CERTAIN_LOG_ODDS, 0),
        (False, 1.1 * CERTAIN_LOG_ODDS, 1),
    ],
)
def test_from_a_label_another_one_takes_when_that_is_likely_and_a_candidate_when_it_is_sure(
    labelled: bool, told: float, takes: int
) -> None:
    config = TrackerConfig()
    objects = ObjectMap(config, map_of((shell((0.3, 0.4), (0.3, 0.4), (0.0, 0.16)), 1)), PlaneTracker(config))
    pair = [objects.store.add(Box(np.array([x, 0.35, 0.08]), JAR, np.eye(3)), 0) for x in (0.35, 0.47)]
    for entry in pair if labelled else pair[1:]:
        objects.store.confirm(entry)
    objects.store.affinity.add_evidence(1, 2, DIFFERENT_LOG_ODDS, novelty=-told / DIFFERENT_LOG_ODDS)
    only, found = np.zeros(1, np.int64), np.zeros((1, 2))
    shown = Association(pair, only, only - 1, found, np.ones(1), found.astype(np.int64), np.zeros(2, np.int64))
    column, allowed = objects._allowed_transfers(np.array([1], np.int32), shown)
    assert allowed[0, column[[0, 2]]].tolist() == [1, takes]


def test_of_the_objects_of_a_frame_the_most_probable_one_has_the_first_label(monkeypatch: pytest.MonkeyPatch) -> None:
    config = TrackerConfig()
    points = shell((0.3, 0.4), (0.3, 0.4), (0.0, 0.16))
    objects = ObjectMap(config, map_of((points, 1)), PlaneTracker(config))
    entries = [objects.store.add(Box(np.array([x, 0.35, 0.08]), JAR, np.eye(3)), 0) for x in (0.3, 0.5, 0.7, 0.9)]
    for entry in entries:
        entry.points = points.astype(np.float32)
    probabilities = dict(zip(entries, (0.5, 0.9, 0.1, 0.8), strict=True))
    monkeypatch.setattr("cuboid.method.objects.object_map.quantities_of", lambda entry: entry)
    monkeypatch.setattr(object_map, "probability", probabilities.__getitem__)
    confirmed = objects.record_seen(7, entries, lambda entry: entry is not entries[3])
    assert confirmed == [entries[1], entries[0]]
    assert [entry.label for entry in entries] == [2, 1, 0, 0]


def test_few_objects_of_a_frame_are_measured_those_with_the_fewest_views_first(monkeypatch: pytest.MonkeyPatch) -> None:
    config, measured = TrackerConfig(), []

    def nothing_clear(box: Box, picture: Picture, *_: object, **__: object) -> np.ndarray:
        assert picture.color.flags.c_contiguous
        measured.append(round(float(box.center[0])))
        return np.full(4, np.nan)

    monkeypatch.setattr(fitting, "top_sides", nothing_clear)
    objects = ObjectMap(config, map_of((shell((0.3, 0.4), (0.3, 0.4), (0.0, 0.16)), 1)), PlaneTracker(config))
    entries = [objects.store.add(Box(np.array([float(k), 0.0, 0.08]), JAR, np.eye(3)), 0) for k in range(4)]
    for entry in entries:
        objects.store.confirm(entry)
        entry.sightings = 4
    objects.store.set_box(entries[0], entries[0].box, np.array([[0.1, 0.1, 1e-3, 1e-3]]))
    match, none = np.arange(4), np.zeros((4, 4))
    found = Association(entries, match, match - 9, none, np.ones(4), none.astype(np.int64), np.zeros(4, np.int64))
    color = np.zeros((48, 64, 3), np.uint8)[..., ::-1]
    picture = Picture(color, np.ones((48, 64), np.float32), Intrinsics(60.0, 60.0, 31.5, 23.5, 64, 48), np.eye(4), 1e-3)
    for _ in range(3):
        objects._measure(found, picture, new_viewpoint=True)
        measured.append(-1)
    assert measured == [1, 2, -1, 3, 0, -1, -1]
    assert [len(entry.sides_m) for entry in entries] == [1, 0, 0, 0]
    for entry in entries:
        entry.sightings = 7
    objects._measure(found, picture, new_viewpoint=False)
    objects._measure(found, picture, new_viewpoint=False)
    assert measured[7:] == [1, 2, 3], "a second view needs another viewpoint, or twice as many sightings"
