"""Track a recording, judge the result by its truth, and keep the figures that the benchmarks show."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np

from cuboid import open_recording
from cuboid.evaluation import Evaluation, Result, evaluate
from cuboid.run import RunOutcome, track_recording
from scenes import Case

# Absence, in frames, from which on coming back counts as a re-identification: shorter is a blink.
ABSENCE_FRAMES = 3


def run_and_score(case: Case, output: Path, **options: Any) -> dict[str, Any]:
    """Track a case into a folder, replacing what is there, and return its figures.

    Parameters
    ----------
    case : Case
    output : Path
    **options
        Those of `cuboid.run.track_recording`.
    """
    if output.exists():
        shutil.rmtree(output)
    output.parent.mkdir(parents=True, exist_ok=True)
    with processor_time():
        outcome = track_recording(open_recording(case.recording), output, **options)
    return {"scene": case.name, "kind": case.kind, **figures(evaluate(output, case.truth)), **costs(outcome)}


@contextmanager
def processor_time() -> Iterator[None]:
    """Let the tracker measure its stages in processor time: what else runs on the machine matters little then.

    It holds for one thread, which the benchmarks are run with.
    """
    clock = SimpleNamespace(perf_counter=time.process_time)
    with ExitStack() as patches:
        for module in ("tracker", "measuring", "decoding"):
            patches.enter_context(patch(f"cuboid.{module}.time", clock))
        yield


def score(case: Case, result: Result | Path) -> dict[str, Any]:
    """Return the figures of a result that is there already."""
    return {"scene": case.name, "kind": case.kind, **figures(evaluate(result, case.truth))}


def figures(found: Evaluation) -> dict[str, Any]:
    """Return what the tables show of an evaluation; what is undefined is None."""
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
    if found.proposals is not None:
        row["boxes_frame"] = found.proposals.per_frame
        for at, name in zip(found.proposals.at, ("25", "50"), strict=True):
            row |= {f"frame_precision_{name}": at.precision, f"frame_recall_{name}": at.recall}
            row[f"frame_f1_{name}"] = harmonic(at.precision, at.recall)
    if found.identity is not None:
        identity = found.identity
        back = next(at for at in identity.reidentification if at.absence_frames == ABSENCE_FRAMES)
        row |= {
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
    return row


def harmonic(precision: float | None, recall: float | None) -> float | None:
    """Return F1."""
    if precision is None or recall is None:
        return None
    return 2 * precision * recall / (precision + recall) if precision + recall else 0.0


def costs(outcome: RunOutcome) -> dict[str, Any]:
    """Return what a run took."""
    times = outcome.report.milliseconds
    return {
        "ms_frame": times["frame"].median_ms,
        "ms_frame_p95": times["frame"].p95_ms,
        "ms_stages": {stage: time.median_ms for stage, time in times.items() if stage != "frame"},
        "memory_mb": outcome.report.peak_memory_mb,
        "skipped": len(outcome.report.skipped),
    }


def mean(rows: Sequence[dict[str, Any]], name: str) -> float | None:
    """Return the mean of a figure over the rows that have it."""
    values = [row[name] for row in rows if row.get(name) is not None]
    return float(np.mean(values)) if values else None


def total(rows: Sequence[dict[str, Any]], name: str) -> int:
    """Return the sum of a count."""
    return sum(row.get(name) or 0 for row in rows)


def together(rows: Sequence[dict[str, Any]], part: str, whole: str) -> float | None:
    """Return the share of two counts over all rows."""
    count = total(rows, whole)
    return total(rows, part) / count if count else None
