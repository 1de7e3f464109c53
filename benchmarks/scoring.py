"""Track a recording, judge the result by its truth, and keep the figures that the benchmarks show."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np

from cuboid import open_recording
from cuboid.lab.evaluation import Result, evaluate
from cuboid.lab.evaluation.figures import figures
from cuboid.runs.pipeline.options import TrackOptions
from cuboid.runs.pipeline.run import track_recording
from cuboid.runs.tracking.types import RunOutcome
from scenes import Case


def run_and_score(case: Case, output: Path, options: TrackOptions | None = None) -> dict[str, Any]:
    """Track a case into a folder, replacing what is there, and return its figures.

    Parameters
    ----------
    case : Case
    output : Path
    options : TrackOptions, optional
    """
    if output.exists():
        shutil.rmtree(output)
    output.parent.mkdir(parents=True, exist_ok=True)
    with processor_time():
        outcome = track_recording(open_recording(case.recording), output, options)
    return {"scene": case.name, "kind": case.kind, **figures(evaluate(output, case.truth)), **costs(outcome)}


@contextmanager
def processor_time() -> Iterator[None]:
    """Let the tracker measure its stages in processor time: what else runs on the machine matters little then.

    It holds for one thread, which the benchmarks are run with.
    """
    clock = SimpleNamespace(perf_counter=time.process_time)
    with patch("cuboid.ground.compiling.compiletime.time", clock):
        yield


def score(case: Case, result: Result | Path) -> dict[str, Any]:
    """Return the figures of a result that is there already."""
    return {"scene": case.name, "kind": case.kind, **figures(evaluate(result, case.truth))}


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


def summed_counts(rows: Sequence[dict[str, Any]], part: str, whole: str) -> float | None:
    """Return the fraction of two counts over all rows."""
    count = total(rows, whole)
    return total(rows, part) / count if count else None
