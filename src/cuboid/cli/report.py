"""`cuboid report`: the 3D page of finished results, written anew."""

from __future__ import annotations

import argparse
from pathlib import Path

from cuboid.cli.results import add_output, add_results, give, refuse_existing

EXAMPLE = "cuboid report DIR --force"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what the command takes."""
    parser.add_argument("results", type=Path, metavar="DIR", help="what 'cuboid track' left behind")
    parser.add_argument("--recording", type=Path, metavar="PATH", help="the recording, where it is not where it was")
    add_output(parser, type=Path, metavar="FILE", help="the page (default: report.html in DIR)")
    parser.add_argument("--no-pictures", action="store_true", help="leave out the objects' pictures and the recording")
    add_results(parser)


def run(args: argparse.Namespace) -> int:
    """Write the page."""
    from cuboid.cli.tables import console
    from cuboid.core.errors import InputError
    from cuboid.core.threads import limit_threads
    from cuboid.outputs import Results
    from cuboid.outputs.folder import REPORT
    from cuboid.views.report import summarise, write_report

    limit_threads(1)
    path: Path = args.output or args.results / REPORT
    if path.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{path}: the page's name must end with .html")
    refuse_existing(path, force=args.force)
    results = Results(args.results, args.recording)
    read = None if args.no_pictures else results.recording.without_poses().read
    summary = summarise(results, read)
    write_report(path, summary)
    objects = len(summary.found.objects)
    line = f"page with {objects} objects in {path}"
    give(args, {"output": str(path), "objects": objects}, lambda: console().print(line, markup=False))
    return 0
