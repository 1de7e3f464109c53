"""Metrics of persistent labels: the same label after an absence, one label per object, given early."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cuboid.lab.evaluation.clear import Pairs
from cuboid.lab.evaluation.matching import FrameOverlap, ratio
from cuboid.lab.evaluation.result import IntArray

# Absences, in frames of the recording, at which the curve is computed: one frame up to ten seconds at 30 Hz.
ABSENCES = (1, 3, 10, 30, 100, 300)
# Minimum length of a reappearance, in judged frames: an object that passes faster cannot be confirmed.
STAY_FRAMES = 3


@dataclass(frozen=True, slots=True)
class ObjectLabels:
    """The labels that one object had.

    Attributes
    ----------
    labels : tuple of int
        Labels in order of appearance.
    main_label : int or None
        The most frequent label, the older one in a tie; None if the object was never found.
    main_share : float or None
        Fraction of the object's found frames that have the main label.
    switches : int
        Number of times that the object was found under a label other than its last one.
    frames_to_find, frames_found : int
        Judged frames that must find the object, and those that did.
    frames_to_first_label : int or None
        Frames of the recording from the first one that must find the object to the first one that did.
    """

    labels: tuple[int, ...]
    main_label: int | None
    main_share: float | None
    switches: int
    frames_to_find: int
    frames_found: int
    frames_to_first_label: int | None


@dataclass(frozen=True, slots=True)
class Reidentification:
    """Labels of objects that came back.

    Attributes
    ----------
    absence_frames : int
        Absences of at least this many frames of the recording are counted.
    reappearances : int
        Number of times that a labelled object was absent so long and came back for `STAY_FRAMES` or more.
    found : int
        Number of reappearances in which the object was found before its next such absence.
    same_label : int
        Number of reappearances in which the first label equals the last one before the absence.
    rate : float or None
        same_label / reappearances.
    """

    absence_frames: int
    reappearances: int
    found: int
    same_label: int
    rate: float | None


@dataclass(frozen=True, slots=True)
class Timelines:
    """The label of each object in each judged frame.

    Attributes
    ----------
    frames : (T,) int64
        Judged frames of the recording.
    must : (T, G) bool
        Whether the frame must find the object.
    label : (T, G) int64
        Label of the object in the frame, 0 if it is not found.
    """

    frames: IntArray
    must: np.ndarray[tuple[int, int], np.dtype[np.bool_]]
    label: np.ndarray[tuple[int, int], np.dtype[np.int64]]


def timelines(frames: Sequence[FrameOverlap], pairs: Sequence[Pairs], objects: int, labels: IntArray) -> Timelines:
    """Arrange the pairs of all frames over time; `labels` (N,) are the sequence's labels by number."""
    shape = len(frames), objects
    must, label = np.zeros(shape, bool), np.zeros(shape, np.int64)
    for t, (frame, frame_pairs) in enumerate(zip(frames, pairs, strict=True)):
        must[t, frame.truth] = True
        for item, number in frame_pairs:
            label[t, item] = labels[number]
    return Timelines(np.array([frame.frame for frame in frames], np.int64), must, label)


def object_labels(lines: Timelines) -> list[ObjectLabels]:
    """Return the labels of each object."""
    return [_labels_of(lines.frames, must, label) for must, label in zip(lines.must.T, lines.label.T, strict=True)]


def _labels_of(frames: IntArray, must: np.ndarray, label: np.ndarray) -> ObjectLabels:
    times = np.flatnonzero(label)
    found = label[times]
    order = tuple(dict.fromkeys(found.tolist()))
    main = max(order, key=lambda name: (int((found == name).sum()), -name), default=None)
    return ObjectLabels(
        labels=order,
        main_label=main,
        main_share=None if main is None else float((found == main).mean()),
        switches=int((found[1:] != found[:-1]).sum()),
        frames_to_find=int(must.sum()),
        frames_found=len(times),
        frames_to_first_label=int(frames[times[0]] - frames[must.argmax()]) if len(times) else None,
    )


def purity(lines: Timelines) -> float | None:
    """Return the fraction of sightings whose label belongs, in most of its sightings, to the same object.

    Manning, Raghavan, Schuetze, "Introduction to Information Retrieval", 2008, section 16.3, with the labels as
    clusters and the objects as classes. Many labels for one object do not lower it; see `consistency`.
    """
    return _agreement(lines, by_label=True)


def consistency(lines: Timelines) -> float | None:
    """Return the fraction of sightings with their object's most frequent label: the inverse of purity."""
    return _agreement(lines, by_label=False)


def _agreement(lines: Timelines, *, by_label: bool) -> float | None:
    time, item = np.nonzero(lines.label)
    pairs = np.stack([lines.label[time, item], item], axis=1)
    distinct, count = np.unique(pairs, axis=0, return_counts=True)
    groups = distinct[:, 0 if by_label else 1]
    agreeing = sum(int(count[groups == group].max()) for group in np.unique(groups))
    return ratio(agreeing, len(time))


def reidentification(lines: Timelines, absences: Sequence[int] = ABSENCES) -> tuple[Reidentification, ...]:
    """Return the re-identification rate for absences of at least this many frames.

    An absence of an object lasts from the first judged frame that need not find it to the next one that must. Absences
    that are shorter than requested do not interrupt its presence. Objects that were not found before the absence had no
    label to keep, and are not counted.
    """
    return tuple(_reidentified(lines, absence) for absence in absences)


def _reidentified(lines: Timelines, absence_frames: int) -> Reidentification:
    came, found, same = 0, 0, 0
    for must, label in zip(lines.must.T, lines.label.T, strict=True):
        stays = _stays(lines.frames, must, absence_frames)
        old = 0
        for k, (start, end) in enumerate(stays):
            found_labels = label[start:end][label[start:end] > 0]
            if k > 0 and old and must[start:end].sum() >= STAY_FRAMES:
                came += 1
                found += len(found_labels) > 0
                same += int(len(found_labels) > 0 and found_labels[0] == old)
            old = int(found_labels[-1]) if len(found_labels) else old
    return Reidentification(absence_frames, came, found, same, ratio(same, came))


def _stays(frames: IntArray, must: np.ndarray, absence_frames: int) -> list[tuple[int, int]]:
    """Return the intervals [start, end) of an object's presence between absences of `absence_frames` or more."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], must, [False]]).astype(np.int8)))
    stays: list[tuple[int, int]] = []
    for start, end in edges.reshape(-1, 2).tolist():
        if stays and frames[start] - frames[stays[-1][1]] < absence_frames:
            stays[-1] = stays[-1][0], end
        else:
            stays.append((start, end))
    return stays
