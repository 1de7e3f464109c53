"""CLEAR MOT and IDF1: misses, false positives, switches at one threshold, and identity over the whole sequence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cuboid.lab.evaluation.matching import FrameOverlap, match, ratio
from cuboid.method.objects.matching import assign

Pairs = list[tuple[int, int]]


@dataclass(frozen=True, slots=True)
class Clear:
    """The scores of a tracker at one IoU threshold.

    Attributes
    ----------
    threshold : float
        Minimum IoU of a pair.
    mota : float or None
        1 - (misses + false positives + switches) / objects to be found; None if there is nothing to find.
    motp : float or None
        Mean IoU of the pairs.
    matches, misses, false_positives : int
        Over all frames.
    switches : int
        Number of times that an object is found under a label other than its last one.
    fragmentations : int
        Number of times that an object is missed, although it must be found, between frames in which it is found.
    idf1, id_precision, id_recall : float or None
        Scores of the sightings, for the best one-to-one pairing of objects with labels over the whole sequence.
    """

    threshold: float
    mota: float | None
    motp: float | None
    matches: int
    misses: int
    false_positives: int
    switches: int
    fragmentations: int
    idf1: float | None
    id_precision: float | None
    id_recall: float | None


def correspondences(frames: Sequence[FrameOverlap], threshold: float) -> list[Pairs]:
    """Pair objects with labels in each frame.

    An object keeps its last label while both still overlap enough. The others are matched to maximise first the number
    of pairs, then the summed IoU.

    Parameters
    ----------
    frames : sequence of FrameOverlap
    threshold : float
        Minimum IoU of a pair.

    Returns
    -------
    list of list of (int, int)
        For each frame, object and label, numbered as in `frames`.

    Notes
    -----
    Bernardin, Stiefelhagen, "Evaluating Multiple Object Tracking Performance: The CLEAR MOT Metrics",
    EURASIP Journal on Image and Video Processing 2008.
    """
    last: dict[int, int] = {}
    result = []
    for frame in frames:
        truth, found = frame.truth.tolist(), frame.found.tolist()
        column = {label: j for j, label in enumerate(found)}
        kept: Pairs = []
        taken: set[int] = set()
        for i, item in enumerate(truth):
            j = column.get(last.get(item, -1))
            if j is not None and j not in taken and frame.iou[i, j] >= threshold:
                kept.append((i, j))
                taken.add(j)
        open_iou = frame.iou.copy()
        for i, j in kept:
            open_iou[i], open_iou[:, j] = -1.0, -1.0
        pairs = [(truth[i], found[j]) for i, j in sorted([*kept, *match(open_iou, threshold)])]
        last.update(pairs)
        result.append(pairs)
    return result


def clear(frames: Sequence[FrameOverlap], pairs: Sequence[Pairs], threshold: float) -> Clear:
    """Return CLEAR MOT and IDF1 of a sequence.

    Parameters
    ----------
    frames : sequence of FrameOverlap
    pairs : sequence of list of (int, int)
        Their `correspondences` at `threshold`.
    threshold : float

    Notes
    -----
    MOTA, MOTP, switches: Bernardin and Stiefelhagen 2008. Fragmentations: Li, Huang, Nevatia, "Learning to
    Associate", CVPR 2009. IDF1: Ristani, Solera, Zou, Cucchiara, Tomasi, "Performance Measures and a Data Set for
    Multi-Target, Multi-Camera Tracking", ECCV workshops 2016.
    """
    to_find = sum(len(frame.truth) for frame in frames)
    boxes = sum(len(frame.found) for frame in frames)
    matches, switches, fragmentations, overlap = 0, 0, 0, 0.0
    last: dict[int, int] = {}
    lost: set[int] = set()
    for frame, frame_pairs in zip(frames, pairs, strict=True):
        row, column = ({int(key): k for k, key in enumerate(keys)} for keys in (frame.truth, frame.found))
        matches += len(frame_pairs)
        overlap += sum(frame.iou[row[item], column[label]] for item, label in frame_pairs)
        switches += sum(last.get(item, label) != label for item, label in frame_pairs)
        found = {item for item, _ in frame_pairs}
        fragmentations += len(found & lost)
        lost = (lost | (last.keys() & row.keys())) - found
        last.update(frame_pairs)
    true_positives = _identity_matches(frames, threshold)
    return Clear(
        threshold=threshold,
        mota=None if to_find == 0 else 1.0 - (to_find - matches + boxes - matches + switches) / to_find,
        motp=ratio(overlap, matches),
        matches=matches,
        misses=to_find - matches,
        false_positives=boxes - matches,
        switches=switches,
        fragmentations=fragmentations,
        idf1=ratio(2 * true_positives, to_find + boxes),
        id_precision=ratio(true_positives, boxes),
        id_recall=ratio(true_positives, to_find),
    )


def _identity_matches(frames: Sequence[FrameOverlap], threshold: float) -> int:
    """Return the number of sightings that agree with the best one-to-one pairing of objects and labels."""
    objects = 1 + max((int(frame.truth.max(initial=-1)) for frame in frames), default=-1)
    labels = 1 + max((int(frame.found.max(initial=-1)) for frame in frames), default=-1)
    together = np.zeros((objects, labels))
    for frame in frames:
        together[np.ix_(frame.truth, frame.found)] += frame.iou >= threshold
    return int(sum(together[i, j] for i, j in assign(together, 1.0)))
