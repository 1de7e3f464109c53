"""`cuboid report`: write the 3D page of finished results."""

from __future__ import annotations

import argparse
from pathlib import Path

from cuboid.cli.results import add_finished, add_output, add_results, give, refuse_existing
from cuboid.cli.tables import console
from cuboid.ground.core.errors import InputError, counted
from cuboid.ground.formats.folder import REPORT

EXAMPLE = "cuboid report DIR --force"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    add_finished(parser)
    add_output(parser, type=Path, metavar="FILE", help="the page (default: report.html in DIR)")
    parser.add_argument(
        "--no-pictures", action="store_true", help="write no pictures of objects; the recording is not needed"
    )
    add_results(parser)


def run(args: argparse.Namespace) -> int:
    """Write the page."""
    from cuboid.results.files import Results
    from cuboid.results.views.report import summarise, write_report

    path: Path = args.output or args.results / REPORT
    if path.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{path}: the page's name must end with .html")
    refuse_existing(path, force=args.force)
    results = Results(args.results, args.recording)
    read = None if args.no_pictures else results.recording.without_poses().read
    summary = summarise(results, read)
    write_report(path, summary)
    objects = len(summary.found.objects)
    line = f"page with {counted(objects, 'object')} in {path}"
    give(args, {"output": str(path), "objects": objects}, lambda: console().print(line))
    return 0
