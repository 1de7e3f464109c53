"""`cuboid bench`: what a frame costs on this machine, stage by stage."""

from __future__ import annotations

import argparse
import platform
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cuboid.cli.json_option import PRINTED, add_json
from cuboid.cli.recording import add_recording, config_from, open_from
from cuboid.cli.threads import cores

if TYPE_CHECKING:
    from cuboid.run import RunOutcome

HELP = "measure milliseconds a stage, frames/s and memory on a recording"
EXAMPLE = "cuboid bench RECORDING --limit 100"

# Cost over time compares these parts of the used frames: early, but with a map to match against, and the end.
EARLY = (0.10, 0.35)
LATE = (0.80, 1.00)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what the command takes."""
    add_json(parser)
    add_recording(parser, default_threads=1)


def run(args: argparse.Namespace) -> int:
    """Track without writing anything, and print the measurements."""
    from cuboid.cli.progress import progress
    from cuboid.cli.tables import write_json
    from cuboid.run import track_recording

    with progress() as shown:
        outcome = track_recording(
            open_from(args),
            None,
            config=config_from(args),
            proposals=args.proposals,
            poses=args.poses,
            bridge=args.bridge,
            every=args.every,
            limit=args.limit,
            scale=args.scale,
            threads=args.threads,
            progress=shown,
        )
    measured = measurements(outcome)
    if args.json is not None:
        write_json(measured, args.json)
    if args.json != PRINTED:
        _print(measured, outcome)
    return 0


def measurements(outcome: RunOutcome) -> dict[str, Any]:
    """Return all that was measured, ready for JSON."""
    report = outcome.report
    document = report.to_dict()
    names = (
        "version",
        "recording",
        "format",
        "threads",
        "config",
        "frames",
        "milliseconds",
        "peak_memory_mb",
    )
    return {
        **{name: document[name] for name in names},
        "frames_per_second": round(outcome.frames_per_second, 2),
        "over_time": over_time(outcome.milliseconds["frame"]),
        "objects": len(outcome.objects),
        "machine": machine(),
    }


def over_time(frame_ms: Sequence[float]) -> dict[str, float] | None:
    """Return the median of an early part and of the end of a run, and their ratio; None for a short run."""
    from statistics import median

    parts = [frame_ms[round(a * len(frame_ms)) : round(b * len(frame_ms))] for a, b in (EARLY, LATE)]
    if len(parts[0]) < 2 or len(parts[1]) < 2:
        return None
    early, late = (median(part) for part in parts)
    return {"early_ms": round(early, 3), "late_ms": round(late, 3), "ratio": round(late / early, 3)}


def machine() -> dict[str, Any]:
    """Return what the figures depend on."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        lines = info.read_text(errors="replace").splitlines()
        model = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), model)
    return {"cpu": model, "cores": cores(), "system": platform.system(), "python": platform.python_version()}


def _print(measured: dict[str, Any], outcome: RunOutcome) -> None:
    from cuboid.cli.tables import console, skipped_lines, timings_table

    out, host, frames = console(), measured["machine"], measured["frames"]
    threads = f"{measured['threads']} thread{'' if measured['threads'] == 1 else 's'}"
    scale = measured["config"]["scale"]
    out.print(
        f"{frames['used']} frames of {measured['recording']} at scale {scale}, {threads}, "
        f"{host['cpu']}, Python {host['python']}",
        markup=False,
    )
    out.print(timings_table(outcome.report.milliseconds))
    out.print(f"{measured['frames_per_second']:.1f} frames/s, {measured['peak_memory_mb']:.0f} MB at most")
    drift = measured["over_time"]
    if drift is not None:
        out.print(
            f"cost over time: {drift['early_ms']:.1f} ms at 10-35 % of the frames, "
            f"{drift['late_ms']:.1f} ms at 80-100 %: x {drift['ratio']:.2f}"
        )
    for line in skipped_lines(outcome.report):
        out.print(line, markup=False)
