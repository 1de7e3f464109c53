"""Events and people: hand-computed cases."""

from __future__ import annotations

import numpy as np
import pytest

from cuboid.ground.core.errors import InputError
from cuboid.ground.formats.truth_file import EventOfTruth
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.overlap import pack
from cuboid.ground.geometry.se3 import compose
from cuboid.lab.evaluation.events import event_quality, labels_on_agents, objects_of_labels
from cuboid.lab.evaluation.matching import FrameOverlap
from cuboid.lab.evaluation.result import BoxRows
from cuboid.lab.evaluation.scope import Scope
from cuboid.lab.evaluation.truth import Path3D, Truth, TruthAgent, TruthObject
from cuboid.results.files.rows import EVENTS_HEADER, EventRow, read_events

HERE, THERE = np.array([0.0, 0, 0]), np.array([0.5, 0, 0])
SIZE = np.full(3, 0.1)


def at(place):
    return compose((1.0, 0, 0, 0), place)


def box(place):
    return Box(np.asarray(place, float), SIZE, np.eye(3))


@pytest.fixture
def truth(tmp_path):
    path = Path3D(np.array([0, 50]), np.array([at(HERE), at(THERE)]))
    objects = (TruthObject(1, "mug", True, box(THERE), path=path), TruthObject(2, "can", True, box((1.0, 0, 0))))
    moved = EventOfTruth(event="moved", id=1, begin=45, end=55, begun_at=tuple(HERE), to=tuple(THERE))
    events = (moved, EventOfTruth(event="gone", id=2, begin=70, end=80, begun_at=(1.0, 0.0, 0.0)))
    agent = TruthAgent(SIZE, Path3D(np.array([0]), at((2.0, 0, 0))[None]))
    return Truth(tmp_path, "made", 100, objects, None, (), np.ones((100, 2)), events, (agent,))


def test_an_event_is_right_in_kind_object_place_and_time(truth):
    labels = {7: 1, 8: 2}
    right = [EventRow("moved", 7, HERE, THERE, 1.0, 60, 2.0), EventRow("gone", 8, THERE, None, 1.0, 90, 3.0)]
    found = event_quality(truth, labels, (), right)
    assert (found.events, found.reported, found.right, found.median_delay_frames) == (2, 2, 2, 7.5)
    assert (found.precision, found.recall, found.missed, found.wrong) == (1.0, 1.0, (), ())
    wrong = [
        EventRow("moved", 8, HERE, THERE, 1.0, 60, 2.0),  # another object
        EventRow("moved", 7, HERE, HERE, 1.0, 60, 2.0),  # another place
        EventRow("gone", 8, HERE, None, 1.0, 60, 2.0),  # before it happens
        EventRow("appeared", 7, None, THERE, 1.0, 60, 2.0),  # another kind
    ]
    found = event_quality(truth, labels, (), wrong)
    assert (found.reported, found.right, found.recall) == (4, 0, 0.0)
    assert len(found.missed) == 2
    assert len(found.wrong) == 4
    assert event_quality(truth, labels, (7, 8), wrong).reported == 0
    assert event_quality(truth, labels, (), right * 2).right == 2


def test_a_moving_object_is_judged_where_it_is_in_each_frame(truth):
    rows = BoxRows(np.array([10, 60, 61]), np.array([7, 7, 7]), pack([box(HERE), box(THERE), box(HERE)]))
    frames = Scope(truth, np.arange(100)).frame_overlaps(rows)
    assert frames[10].iou[0, 0] == pytest.approx(1.0)
    assert frames[60].iou[0, 0] == pytest.approx(1.0)
    assert frames[61].iou.max() == 0.0
    assert len(frames[61].found) == 1  # it counts as false


def test_what_is_gone_in_the_end_need_not_be_in_the_map(truth):
    assert Scope(truth, np.arange(100)).must_map().tolist() == [True, False]


def test_a_label_is_an_objects_by_most_of_its_pairs():
    frame = FrameOverlap(0, np.array([0, 1]), np.array([0, 1]), np.eye(2))
    assert objects_of_labels([frame] * 3, [[(0, 0)], [(1, 0)], [(1, 0), (0, 1)]], [5, 6]) == {0: 6, 1: 5}


def test_labels_on_people_are_told(truth):
    rows = BoxRows(np.array([1, 2, 3]), np.array([7, 9, 9]), pack([box(HERE), box((2.02, 0, 0)), box((2.0, 0, 0))]))
    assert labels_on_agents(truth, rows, np.arange(100), {7: 1}) == (9,)
    assert labels_on_agents(truth, rows, np.arange(100), {7: 1, 9: 5}) == ()


def test_events_are_read_as_they_are_written(tmp_path):
    rows = [EventRow("moved", 7, HERE, THERE, 0.5, 60, 2.0), EventRow("gone", 8, THERE, None, 1.0, 90, 3.0)]
    path = tmp_path / "events.csv"
    path.write_text("\n".join([EVENTS_HEADER, *(row.line() for row in rows)]) + "\n")
    assert EVENTS_HEADER == "frame,timestamp,event,label,from_x,from_y,from_z,to_x,to_y,to_z,score"
    first, second = read_events(path)
    assert (first.event, first.label, first.frame, first.score) == ("moved", 7, 60, 0.5)
    np.testing.assert_array_equal(first.to_m, THERE)
    assert second.to_m is None
    path.write_text(f"{EVENTS_HEADER}\n1,0.1,flew,1,,,,,,,1\n")
    with pytest.raises(InputError, match=r"events.csv:2: event: "):
        read_events(path)
    path.write_text(f"{EVENTS_HEADER}\n1,0.1,gone,1,1,2,,,,,1\n")
    with pytest.raises(InputError, match=r"from_x, from_y and from_z, or none"):
        read_events(path)
