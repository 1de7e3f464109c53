"""`cuboid slam`: estimate the trajectory of the camera of a recording."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from cuboid.cli.interrupt import interruptible
from cuboid.cli.recording import add_reading, open_from
from cuboid.cli.results import add_output, add_results, give
from cuboid.cli.tables import console, skipped_lines
from cuboid.cli.workers import add_threads
from cuboid.ground.core.threads import cores

if TYPE_CHECKING:
    from cuboid.runs.pipeline.slam import SlamOutcome

EXAMPLE = "cuboid slam RECORDING --output DIR"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    results = parser.add_argument_group("results")
    add_output(results, type=Path, required=True, metavar="DIR", help="folder of the results")
    add_results(results)
    add_threads(add_reading(parser), min(2, cores()))


def run(args: argparse.Namespace) -> int:
    """Estimate, and print a summary."""
    with interruptible() as interruption:
        from cuboid.cli.progress import counting
        from cuboid.runs.pipeline.slam import estimate_trajectory

        with counting("estimating poses") as shown:
            outcome = estimate_trajectory(
                open_from(args),
                args.output,
                every=args.every,
                limit=args.limit,
                threads=args.threads,
                force=args.force,
                progress=shown,
                stop=interruption,
            )
    document = {
        "output": str(args.output),
        "run": outcome.report.to_dict(),
        "lost": outcome.lost,
        "keyframes": outcome.keyframes,
        "loops": outcome.loops,
    }
    give(args, document, lambda: print_outcome(outcome, args.output))
    return interruption.status_of(outcome.report)


def print_outcome(outcome: SlamOutcome, output: Path) -> None:
    """Print the summary of the run."""
    out, report = console(), outcome.report
    for warning in report.warnings:
        out.print(f"warning: {warning}", soft_wrap=not out.is_terminal)
    for line in skipped_lines(report):
        out.print(line)
    timing = report.milliseconds.get("poses")
    each = f", {timing.median_ms:.1f} ms per frame (p95 {timing.p95_ms:.1f}) without decoding" if timing else ""
    out.print(
        f"{report.frames_used} of {report.frames_read} frames tracked, {outcome.lost} lost, "
        f"{outcome.keyframes} keyframes, {outcome.loops} loops closed by appearance; "
        f"{report.seconds:.1f} s{each}; results in {output}"
    )
