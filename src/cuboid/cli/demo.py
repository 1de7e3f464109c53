"""`cuboid demo`: make a recording, track it, and compare the result with the known truth."""

from __future__ import annotations

import argparse
from pathlib import Path

from cuboid.cli.interrupt import interruptible
from cuboid.cli.parser import positive
from cuboid.cli.results import add_output, add_results, give
from cuboid.cli.workers import add_threads
from cuboid.ground.core.errors import OutputError
from cuboid.ground.core.threads import cores

EXAMPLE = "cuboid demo"

RECORDING, RESULTS = "recording", "results"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    add_output(
        parser,
        type=Path,
        default=Path("cuboid-demo"),
        metavar="DIR",
        help="folder of the recording and the results; an earlier demo in it is replaced (default: %(default)s)",
    )
    parser.add_argument("--frames", type=positive, metavar="N", help="number of frames")
    parser.add_argument("--no-video", action="store_true", help="do not write labelled.mp4")
    add_results(parser)
    add_threads(parser, default=min(2, cores()))


def run(args: argparse.Namespace) -> int:
    """Make, track, compare."""
    from cuboid.cli.evaluate import print_comparison
    from cuboid.cli.progress import progress
    from cuboid.cli.track import outcome_document, print_outcome
    from cuboid.inputs.readers import open_recording
    from cuboid.lab.evaluation import evaluate
    from cuboid.lab.synthetic.truth import TRUTH
    from cuboid.runs.pipeline.options import ResultOptions, RunHooks, TrackOptions
    from cuboid.runs.pipeline.run import track_recording

    recording, results = args.output / RECORDING, args.output / RESULTS
    _make(recording, args.frames, args.threads)
    with interruptible() as interruption, progress() as shown:
        outcome = track_recording(
            open_recording(recording),
            results,
            TrackOptions(threads=args.threads),
            results=ResultOptions(video=not args.no_video, force=True),
            hooks=RunHooks(progress=shown, stop=interruption),
        )
    found = evaluate(results, recording / TRUTH)

    def show() -> None:
        print_outcome(outcome, results)
        print_comparison(found)

    give(args, {**outcome_document(outcome, results), "evaluation": found.to_dict()}, show)
    return interruption.status_of(outcome.report)


def _make(path: Path, frames: int | None, threads: int) -> None:
    from cuboid.cli.progress import counting
    from cuboid.lab.synthetic import demo_scene, render_recording
    from cuboid.lab.synthetic.truth import TRUTH

    if path.exists() and not (path / TRUTH).is_file():
        raise OutputError(f"{path}: exists, and no demo has made it; choose another --output")
    with counting("making a recording") as count:
        scene = demo_scene() if frames is None else demo_scene(frames)
        render_recording(scene, path, workers=threads, force=True, progress=count)
