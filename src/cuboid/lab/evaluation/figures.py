"""The figures of an evaluation as one flat row, for tables over many scenes."""

from __future__ import annotations

from typing import Any

from cuboid.lab.evaluation.evaluate import Evaluation

# Minimum absence, in frames, for a re-identification: a shorter one is a single missed detection.
ABSENCE_FRAMES = 3


def figures(found: Evaluation) -> dict[str, Any]:
    """Return the figures of an evaluation for tables; undefined figures are None."""
    low, high = found.map.at
    row: dict[str, Any] = {
        "objects": found.map.objects,
        "recall_25": low.recall,
        "precision_25": low.precision,
        "f1_25": low.f1,
        "recall_50": high.recall,
        "precision_50": high.precision,
        "f1_50": high.f1,
        "mean_iou": low.mean_iou,
        "center_cm": low.center_error_cm,
        "fragments": found.map.fragments,
        "merges": found.map.merges,
        "false_alarms": found.map.false_alarms,
        "proposals": found.map.boxes,
        "frames": found.frames_judged,
    }
    return row | _of_frames(found) | _of_identity(found)


def _of_frames(found: Evaluation) -> dict[str, Any]:
    """Return the figures of the boxes of single frames."""
    if found.proposals is None:
        return {}
    row: dict[str, Any] = {"boxes_frame": found.proposals.per_frame}
    for at, name in zip(found.proposals.at, ("25", "50"), strict=True):
        row |= {f"frame_precision_{name}": at.precision, f"frame_recall_{name}": at.recall}
        row[f"frame_f1_{name}"] = harmonic(at.precision, at.recall)
    return row


def _of_identity(found: Evaluation) -> dict[str, Any]:
    """Return the figures of labels over time."""
    if found.identity is None:
        return {}
    identity = found.identity
    back = next(at for at in identity.reidentification if at.absence_frames == ABSENCE_FRAMES)
    return {
        "hota": identity.hota.hota,
        "det_a": identity.hota.det_a,
        "ass_a": identity.hota.ass_a,
        "idf1_25": identity.at[0].idf1,
        "idf1_50": identity.at[1].idf1,
        "mota_25": identity.at[0].mota,
        "switches": identity.at[0].switches,
        "purity": identity.label_purity,
        "consistency": identity.label_consistency,
        "reappearances": back.reappearances,
        "same_label": back.same_label,
        "reid": back.rate,
        "first_label": identity.median_frames_to_first_label,
    }


def harmonic(precision: float | None, recall: float | None) -> float | None:
    """Return F1."""
    if precision is None or recall is None:
        return None
    return 2 * precision * recall / (precision + recall) if precision + recall else 0.0
