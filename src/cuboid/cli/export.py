"""`cuboid export`: write finished results in the formats of other programs."""

from __future__ import annotations

import argparse
from pathlib import Path

from cuboid.cli.names import export_names
from cuboid.cli.parser import takes_names
from cuboid.cli.results import add_output, add_results, give
from cuboid.cli.tables import console

EXAMPLE = "cuboid export DIR --to coco --output labels.json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("results", type=Path, metavar="DIR", help="results of 'cuboid track'")
    takes_names(parser.add_argument("--to", required=True, metavar="NAME", help="the format"), export_names)
    add_output(parser, type=Path, required=True, metavar="PATH", help="the file; for ply the folder of its files")
    parser.add_argument("--recording", type=Path, metavar="PATH", help="the recording, if it has moved since the run")
    shapes = parser.add_argument_group("shapes: glb, obj, stl, urdf, usd")
    shapes.add_argument("--close", action="store_true", help="extend the walls to the support, and close the foot")
    complete = "close all holes: space that no view saw as empty is solid; guessed parts are marked"
    shapes.add_argument("--complete", action="store_true", help=complete)
    collision = "add convex bodies for simulators to each mesh (default: none; hull for urdf)"
    shapes.add_argument("--collision", choices=("none", "box", "hull", "parts"), help=collision)
    add_results(parser)


def run(args: argparse.Namespace) -> int:
    """Write the export, and print its notes."""
    from cuboid.results.exports import export, fitting_path
    from cuboid.results.files import Results

    given = {name: value for name in ("close", "complete", "collision") if (value := getattr(args, name))}
    output = fitting_path(args.to, args.output)
    notes = export(Results(args.results, args.recording), args.to, output, force=args.force, **given)
    lines = "\n".join((f"{args.to} written to {output}", *notes))
    document = {"output": str(output), "form": args.to, "notes": notes}
    give(args, document, lambda: console().print(lines))
    return 0
