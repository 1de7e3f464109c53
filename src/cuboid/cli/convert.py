"""`cuboid convert`: convert a recording to another format."""

from __future__ import annotations

import argparse
from pathlib import Path

from cuboid.cli.parser import positive, whole
from cuboid.cli.recording import add_reading, open_from
from cuboid.cli.results import add_output, add_results, give
from cuboid.cli.tables import console
from cuboid.ground.core.errors import InputError, OutputError

EXAMPLE = "cuboid convert RECORDING --to mcap --output DIR"
FORMS = ("plain", "tum", "mcap")
# Number of omitted frames whose reasons are printed.
SHOWN = 8


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    results = parser.add_argument_group("results")
    add_output(results, type=Path, required=True, metavar="DIR", help="folder of the new recording")
    add_results(results)
    results.add_argument("--to", choices=FORMS, default="plain", help="format of the new recording (default: plain)")
    cut = parser.add_argument_group("frames")
    cut.add_argument("--first", type=whole, default=0, metavar="N", help="first frame, counted from 0")
    cut.add_argument("--last", type=whole, metavar="N", help="last frame")
    cut.add_argument("--every", type=positive, default=1, metavar="N", help="use every N-th frame")
    add_reading(parser, thinned=False, tracked=False)


def run(args: argparse.Namespace) -> int:
    """Convert, and print the omitted frames."""
    from cuboid.cli.progress import counting
    from cuboid.ground.formats.reading import real_path
    from cuboid.inputs.recordings.converting import convert_recording

    recording = open_from(args)
    if real_path(args.output) == recording.path.resolve():
        raise OutputError(f"{args.output}: is the recording itself; choose another output folder")
    last = len(recording) - 1 if args.last is None else args.last
    frames = range(args.first, min(last + 1, len(recording)), args.every)
    if not frames:
        raise InputError(f"{recording.path}: has {len(recording)} frames, none of them from {args.first} to {last}")
    with counting("converting") as shown:
        skipped = convert_recording(recording, args.output, args.to, frames, force=args.force, progress=shown)
    document = {
        "output": str(args.output),
        "form": args.to,
        "frames": len(frames) - len(skipped),
        "left_out": [{"frame": frame, "reason": reason} for frame, reason in skipped.items()],
    }
    done = f"{len(frames) - len(skipped)} of {len(recording)} frames in {args.output}"
    give(args, document, lambda: _print(skipped, done))
    return 0


def _print(skipped: dict[int, str], done: str) -> None:
    out = console()
    for index, reason in list(skipped.items())[:SHOWN]:
        out.print(f"  frame {index} left out: {reason}")
    if len(skipped) > SHOWN:
        out.print(f"  and {len(skipped) - SHOWN} others")
    out.print(done)
