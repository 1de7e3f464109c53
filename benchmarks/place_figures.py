"""The figures of a place: what its truth files say of the results of its recordings, pooled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cuboid.ground.core.errors import CuboidError
from cuboid.lab.evaluation import evaluate, evaluate_keyframes
from cuboid.lab.evaluation.average_precision import average_precision
from cuboid.lab.evaluation.figures import figures, harmonic
from cuboid.lab.evaluation.keyframe_scores import ranking
from cuboid.lab.evaluation.keyframes import is_keyframes
from cuboid.lab.evaluation.matching import ratio
from cuboid.lab.evaluation.reliability import Reliability, pooled
from place_list import Place
from place_tracking import Checkout

# The figures of a place in the order of the tables; of all but the last, more is better.
FIGURES = {
    "recall": "recall",
    "precision": "precision",
    "f1": "F1",
    "ap": "AP",
    "one_label": "one label",
    "idf1": "IDF1",
    "hota": "HOTA",
    "calibration": "cal. error",
}


@dataclass(frozen=True, slots=True)
class Judgement:
    """The verdict of one truth file on one result, at the IoU of the place.

    Attributes
    ----------
    wanted, found, false : int
        Rectangles (or boxes) to be found, found ones, and sightings (or boxes) of no object.
    one_label, idf1, hota : float or None
        None where the truth does not give them.
    ranking : ((N,) float64, (N,) bool) or None
        Probability and rightness of the judged sightings; None for boxes.
    ap : float or None
    reliability : Reliability or None
    boxes : dict or None
        All figures of the final boxes; None for rectangles.
    """

    wanted: int
    found: int
    false: int
    one_label: float | None
    idf1: float | None
    hota: float | None
    ranking: tuple[np.ndarray, np.ndarray] | None
    ap: float | None
    reliability: Reliability | None
    boxes: dict[str, Any] | None = None


def place_row(place: Place, checkout: Checkout, failure: str | None) -> dict[str, Any]:
    """Return the row of a place: its figures, or why there are none."""
    row: dict[str, Any] = {"name": place.name, "kind": place.kind, "iou": place.iou, "made": place.made}
    row["parts"] = [part.name for part in place.parts]
    if failure is not None:
        return {**row, "failed": failure}
    try:
        found = [
            _judge(checkout.result(part), truth, place.iou, part.recording)
            for part in place.parts
            for truth in part.truths
        ]
    except CuboidError as error:
        return {**row, "failed": str(error)}
    boxes = [one.boxes for one in found if one.boxes is not None]
    return {**row, **pool(found), "boxes": boxes[0] if len(boxes) == 1 else None}


def _judge(result: Path, truth: Path, iou: float, recording: Path) -> Judgement:
    return _of_keyframes(result, truth, iou, recording) if is_keyframes(truth) else _of_boxes(result, truth, iou)


def _of_keyframes(result: Path, truth: Path, iou: float, recording: Path) -> Judgement:
    found = evaluate_keyframes(result, truth, recording)
    k, at = next((k, at) for k, at in enumerate(found.at) if at.threshold == iou)
    rows = None if at.ap is None else ranking(found.frames, k)
    return Judgement(
        at.rectangles, at.found, at.false, at.one_label, at.idf1, None, rows, at.ap, at.reliability
    )  # fmt: skip


def _of_boxes(result: Path, truth: Path, iou: float) -> Judgement:
    found = evaluate(result, truth)
    k, at = next((k, at) for k, at in enumerate(found.map.at) if at.threshold == iou)
    identity = found.identity
    counts = at.found + at.missed, at.found, at.wrong
    if identity is None:
        return Judgement(*counts, None, None, None, None, at.ap, None, figures(found))
    labels = identity.label_consistency, identity.at[k].idf1, identity.hota.hota
    return Judgement(*counts, *labels, None, at.ap, identity.reliability[k], figures(found))


def pool(found: Sequence[Judgement]) -> dict[str, Any]:
    """Return the figures of several judgements together.

    Recall and precision are those of the summed counts. AP is that of all sightings, ranked together; the AP of boxes,
    which no frame ranks with others, is averaged with it by the number of objects to be found, and so are IDF1 and
    HOTA. One label is averaged by the number of found ones. The labels in the bins of the reliability are summed.
    """
    wanted, hits, false = (sum(getattr(one, name) for one in found) for name in ("wanted", "found", "false"))
    recall, precision = ratio(hits, wanted), ratio(hits, hits + false)
    reliability = pooled([one.reliability for one in found if one.reliability is not None])
    return {
        "wanted": wanted,
        "found": hits,
        "false": false,
        "recall": recall,
        "precision": precision,
        "f1": harmonic(precision if hits + false else 0.0, recall),
        "ap": _pooled_ap(found),
        "one_label": _mean([(one.one_label, one.found) for one in found]),
        "idf1": _mean([(one.idf1, one.wanted) for one in found]),
        "hota": _mean([(one.hota, one.wanted) for one in found]),
        "calibration": reliability.expected_calibration_error,
        "reliability": asdict(reliability),
    }


def _pooled_ap(found: Sequence[Judgement]) -> float | None:
    """Return the AP of all ranked sightings, averaged with those of boxes."""
    ranked = [one for one in found if one.ranking is not None]
    wanted = sum(one.wanted for one in ranked)
    parts: list[tuple[float | None, int]] = [(one.ap, one.wanted) for one in found if one.ranking is None]
    if ranked:
        score, right = (np.concatenate(column) for column in zip(*(one.ranking for one in ranked), strict=True))
        parts.append((average_precision(score, right, wanted), wanted))
    return _mean(parts)


def _mean(parts: Sequence[tuple[float | None, int]]) -> float | None:
    """Return the weighted mean of the defined values."""
    defined = [(value, weight) for value, weight in parts if value is not None]
    return ratio(sum(value * weight for value, weight in defined), sum(weight for _, weight in defined))
