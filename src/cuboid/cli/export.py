"""`cuboid export`: finished results in the forms that other programs read."""

from __future__ import annotations

import argparse
from pathlib import Path

HELP = "write the results of a run for other programs: PLY, COCO, KITTI, MCAP, JSON, CSV, rerun"
EXAMPLE = "cuboid export DIR --to coco --output labels.json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what the command takes."""
    parser.add_argument("results", type=Path, metavar="DIR", help="what 'cuboid track' left behind")
    parser.add_argument(
        "--to", required=True, metavar="NAME", help="the form: ply, coco, kitti, mcap, json, csv, rerun"
    )
    parser.add_argument(
        "--output", type=Path, required=True, metavar="PATH", help="the file; for ply the folder of its files"
    )
    parser.add_argument("--recording", type=Path, metavar="PATH", help="the recording, where it is not where it was")
    parser.add_argument("--force", action="store_true", help="replace an earlier export")


def run(args: argparse.Namespace) -> int:
    """Write the export, and say what it lacks."""
    from cuboid.cli.tables import console
    from cuboid.cli.threads import limit_threads

    limit_threads(1)
    from cuboid.exports import export
    from cuboid.outputs import Results

    notes = export(Results(args.results, args.recording), args.to, args.output, force=args.force)
    out = console()
    for line in (f"{args.to} written to {args.output}", *notes):
        out.print(line, markup=False)
    return 0
