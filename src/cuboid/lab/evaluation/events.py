"""Evaluation of reported events of moving objects, and of labels given to people, against ground truth."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cuboid.ground.formats.truth_file import EventOfTruth
from cuboid.ground.geometry.overlap import overlap_min_matrix, pack
from cuboid.lab.evaluation.clear import Pairs
from cuboid.lab.evaluation.matching import FrameOverlap, ratio
from cuboid.lab.evaluation.result import BoxRows, IntArray
from cuboid.lab.evaluation.truth import Truth
from cuboid.results.files.rows import EventRow

# A reported event is correct if it comes after the start of a true event, and at most this many frames after its end
# (four seconds at 30 Hz).
LATEST_FRAMES = 120
# Tolerance for the place of an object in an event, metres.
PLACE_M = 0.1
# A box lies on a person if it shares this fraction of the smaller volume with a part of the person.
ON_AGENT = 0.3


@dataclass(frozen=True, slots=True)
class EventQuality:
    """Quality of reported events.

    Attributes
    ----------
    events, reported, right : int
        Numbers of true events, of reported events that are judged, and of correct ones among these.
    precision, recall : float or None
    median_delay_frames : float or None
        Median delay from the end of a true event to its report, over the correct reports.
    agent_labels : tuple of int
        Labels given to people: of their sightings on an object or a person, most are on a person.
    missed, wrong : tuple of str
        Texts for users: events that were not reported, and reported events that are not true.
    """

    events: int
    reported: int
    right: int
    precision: float | None
    recall: float | None
    median_delay_frames: float | None
    agent_labels: tuple[int, ...]
    missed: tuple[str, ...]
    wrong: tuple[str, ...]


def event_quality(
    truth: Truth, objects: Mapping[int, int], unjudged: Sequence[int], reported: Sequence[EventRow]
) -> EventQuality:
    """Compare reported events with the true ones.

    Parameters
    ----------
    truth : Truth
    objects : mapping of int to int
        Object (id) of each label.
    unjudged : sequence of int
        Labels of objects that count neither way.
    reported : sequence of EventRow
    """
    judged = {item.id for item in truth.objects if item.judged}
    open_events = [event for event in truth.events or () if event.id in judged]
    true, delays, wrong = len(open_events), [], []
    counted = [row for row in reported if row.label not in unjudged]
    for row in sorted(counted, key=lambda row: row.frame):
        fits = [event for event in open_events if _matches(row, event, objects.get(row.label))]
        if fits:
            open_events.remove(fits[0])
            delays.append(row.frame - fits[0].end)
        else:
            wrong.append(f"frame {row.frame}: #{row.label} {row.event}")
    missed = tuple(f"frames {event.begin} to {event.end}: object {event.id} {event.event}" for event in open_events)
    right = len(delays)
    delay = float(np.median(delays)) if delays else None
    precision, recall = ratio(right, len(counted)), ratio(right, true)
    return EventQuality(true, len(counted), right, precision, recall, delay, (), missed, tuple(wrong))


def _matches(row: EventRow, event: EventOfTruth, number: int | None) -> bool:
    """Return whether a reported event, of the object with id `number`, matches a true one."""
    if row.event != event.event or number != event.id or not event.begin <= row.frame <= event.end + LATEST_FRAMES:
        return False
    if event.to is None:
        return True
    return row.to_m is not None and float(np.linalg.norm(row.to_m - event.to)) <= PLACE_M


def objects_of_labels(frames: Sequence[FrameOverlap], pairs: Sequence[Pairs], ids: Sequence[int]) -> dict[int, int]:
    """Return the object (id) that each label (numbered as in `frames`) is most often paired with."""
    counts: dict[int, Counter[int]] = {}
    for frame_pairs in pairs:
        for item, label in frame_pairs:
            counts.setdefault(label, Counter())[ids[item]] += 1
    return {label: found.most_common(1)[0][0] for label, found in counts.items()}


def labels_on_agents(truth: Truth, tracks: BoxRows, frames: IntArray, paired: Mapping[int, int]) -> tuple[int, ...]:
    """Return the labels that were given to people.

    Parameters
    ----------
    truth : Truth
    tracks : BoxRows
    frames : (T,) int64
        Judged frames.
    paired : mapping of int to int
        Number of frames in which each label is paired with an object.
    """
    frames_on_agents: Counter[int] = Counter()
    for frame in frames.tolist() if truth.agents else ():
        rows = slice(*np.searchsorted(tracks.frame, [frame, frame + 1]))
        parts = pack([agent.path.at(frame, agent.size) for agent in truth.agents])
        shared = overlap_min_matrix(tracks.boxes[rows], parts)
        frames_on_agents.update(tracks.label[rows][(shared >= ON_AGENT).any(1)].tolist())
    return tuple(sorted(label for label, count in frames_on_agents.items() if count > paired.get(label, 0)))
