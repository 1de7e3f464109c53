"""`cuboid models`: list and download the known detectors."""

from __future__ import annotations

import argparse
from typing import Any

from cuboid.cli.results import add_results, give
from cuboid.cli.tables import console, new_table
from cuboid.ground.core.errors import InputError

EXAMPLE = "cuboid models fetch yolox-nano"
LEGEND = (
    "ms: an image, measured with one thread on a quiet core; -: not measured, 'cuboid track --detector NAME' prints "
    "the time on this computer; kept: downloaded before"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument(
        "verb",
        nargs="?",
        choices=("list", "fetch"),
        default="list",
        help="list the models, or download some (default: list)",
    )
    parser.add_argument("names", nargs="*", default=[], metavar="NAME", help="models to download")
    add_results(parser)


def run(args: argparse.Namespace) -> int:
    """List the models, or fetch some and list them."""
    from cuboid.cli.progress import counting
    from cuboid.method.detection.fetching import fetch
    from cuboid.method.detection.models import MODELS

    unknown = next((name for name in args.names if name not in MODELS), None)
    if unknown is not None:
        raise InputError(f"unknown model '{unknown}'; known models: {', '.join(MODELS)}")
    if (args.verb == "fetch") != bool(args.names):
        raise InputError("cuboid models: expected 'list' without names, or 'fetch' with names")
    if args.verb == "fetch":
        for name in args.names:
            with counting(f"{name}, bytes") as on_progress:
                fetch(MODELS[name], on_progress)
    rows = [_row(name) for name in args.names or MODELS]
    give(args, {"models": rows}, lambda: _show(rows))
    return 0


def _row(name: str) -> dict[str, Any]:
    from cuboid.method.detection.models import MODELS

    model = MODELS[name]
    return {
        "name": name,
        "what": model.what,
        "license": model.license,
        "publisher": model.publisher,
        "size_bytes": model.size_bytes,
        "milliseconds": model.milliseconds,
        "sha256": model.sha256,
        "url": model.url,
        "path": str(model.path) if model.kept else None,
    }


def _show(rows: list[dict[str, Any]]) -> None:
    out = console()
    table = new_table("model", "what", "license", "publisher", "MB", "ms", "kept", left=4)
    for row in rows:
        kept = "yes" if row["path"] else "no"
        size_mb = f"{row['size_bytes'] / 1e6:.1f}"
        took = "-" if row["milliseconds"] is None else f"{row['milliseconds']:.0f}"
        table.add_row(row["name"], row["what"], row["license"], row["publisher"], size_mb, took, kept)
    out.print(table)
    out.print(LEGEND)
    for row in rows:
        out.print(f"{row['name']}: {row['path'] or row['url']}", soft_wrap=True)
