"""`cuboid bench`: measure the time of a frame on this machine, stage by stage."""

from __future__ import annotations

import argparse
import platform
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cuboid.cli.recording import add_recording, open_from, tracking_from
from cuboid.cli.results import add_results, give
from cuboid.cli.tables import console, skipped_lines, timings_table
from cuboid.ground.core.threads import cores

if TYPE_CHECKING:
    from cuboid.runs.tracking.types import RunOutcome

EXAMPLE = "cuboid bench RECORDING --limit 100"

# Cost over time compares these parts of the used frames: an early part that already has a map, and the end.
EARLY = (0.10, 0.35)
LATE = (0.80, 1.00)
# Printed figures of the frames, and their names.
TAIL = {"median": "median", "99th percentile": "p99", "worst": "worst"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    add_recording(parser, default_threads=1)
    add_results(parser)


def run(args: argparse.Namespace) -> int:
    """Track without writing anything, and print the measurements."""
    from cuboid.cli.progress import progress
    from cuboid.runs.pipeline.options import RunHooks
    from cuboid.runs.pipeline.run import track_recording

    with progress() as shown:
        outcome = track_recording(open_from(args), None, tracking_from(args), hooks=RunHooks(progress=shown))
    measured = measurements(outcome)
    give(args, measured, lambda: _print(measured, outcome))
    return 0


def measurements(outcome: RunOutcome) -> dict[str, Any]:
    """Return all measurements, ready for JSON."""
    report = outcome.report
    document = report.to_dict()
    names = ("version", "recording", "format", "threads", "config", "frames", "milliseconds", "peak_memory_mb")
    return {
        **{name: document[name] for name in names},
        "frames_per_second": round(outcome.frames_per_second, 2),
        "tail": tail(outcome.milliseconds["frame"], outcome.milliseconds["decode"])
        if outcome.report.frames_used
        else None,
        "over_time": over_time(outcome.milliseconds["frame"]),
        "map": {
            "points": outcome.points,
            "bytes": outcome.map_bytes,
            "bytes_per_point": round(outcome.map_bytes / outcome.points, 1) if outcome.points else None,
        },
        "objects": len(outcome.objects),
        "machine": machine(),
    }


def tail(frame_ms: Sequence[float], decode_ms: Sequence[float]) -> dict[str, float]:
    """Return median, 99th percentile and worst of the frames after warm-up, in milliseconds and in units of decoding.

    The unit is the median time of decoding color and depth of the same frames in the same run. Machines differ in
    speed, and the speed of one machine varies, but tracking and decoding then slow down together.
    """
    import numpy as np

    from cuboid.runs.tracking.measuring import warm_up_of

    warm = warm_up_of(len(frame_ms))
    unit_ms = float(np.median(decode_ms[warm:]))
    median, p99 = np.percentile(frame_ms[warm:], (50, 99)).tolist()
    values = {"median": median, "p99": p99, "worst": max(frame_ms[warm:])}
    found = {"decode_ms": round(unit_ms, 3)}
    found |= {f"{name}_ms": round(value, 3) for name, value in values.items()}
    return found | {f"{name}_decodes": round(value / unit_ms, 2) for name, value in values.items() if unit_ms > 0}


def over_time(frame_ms: Sequence[float]) -> dict[str, float] | None:
    """Return the median of an early part and of the end of a run, and their ratio; None for a short run."""
    from statistics import median

    parts = [frame_ms[round(a * len(frame_ms)) : round(b * len(frame_ms))] for a, b in (EARLY, LATE)]
    if len(parts[0]) < 2 or len(parts[1]) < 2:
        return None
    early, late = (median(part) for part in parts)
    return {"early_ms": round(early, 3), "late_ms": round(late, 3), "ratio": round(late / early, 3)}


def machine() -> dict[str, Any]:
    """Return the properties of the machine on which the figures depend."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        lines = info.read_text(errors="replace").splitlines()
        model = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), model)
    return {"cpu": model, "cores": cores(), "system": platform.system(), "python": platform.python_version()}


def _print(measured: dict[str, Any], outcome: RunOutcome) -> None:
    out, host, frames = console(), measured["machine"], measured["frames"]
    threads = f"{measured['threads']} thread{'' if measured['threads'] == 1 else 's'}"
    scale = measured["config"]["scale"]
    out.print(
        f"{frames['used']} frames of {measured['recording']} at scale {scale}, {threads}, "
        f"{host['cpu']}, Python {host['python']}"
    )
    out.print(timings_table(outcome.report.milliseconds))
    out.print(f"{measured['frames_per_second']:.1f} frames/s, {measured['peak_memory_mb']:.0f} MB at peak")
    for line in _tail_lines(measured):
        out.print(line)
    drift = measured["over_time"]
    if drift is not None:
        out.print(
            f"cost over time: {drift['early_ms']:.1f} ms at 10-35 % of the frames, "
            f"{drift['late_ms']:.1f} ms at 80-100 %: x {drift['ratio']:.2f}"
        )
    for line in skipped_lines(outcome.report):
        out.print(line)


def _tail_lines(measured: dict[str, Any]) -> list[str]:
    """Return the lines about slow frames and about the memory of the map."""
    lines, found, points = [], measured["tail"], measured["map"]["points"]
    if found is not None and "median_decodes" in found:
        values = (f"{name} {found[f'{key}_ms']:.1f} ms = {found[f'{key}_decodes']:.1f}" for name, key in TAIL.items())
        lines.append(f"a frame: {', '.join(values)} times the decoding of its images ({found['decode_ms']:.1f} ms)")
    if points:
        lines.append(f"map: {points} points, {measured['map']['bytes_per_point']:.0f} bytes each")
    return lines
