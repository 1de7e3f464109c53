"""`--output`, `--json` and `--force`, the same for all commands with results."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Mapping
from glob import escape, glob
from pathlib import Path
from typing import Any

from cuboid.cli.names import OPTIONAL
from cuboid.cli.tables import console
from cuboid.ground.core.errors import OutputError

PRINTED = OPTIONAL["--json"][0]
# Arguments that name an additional output file.
FILES = ("json", "html", "plot", "picture")


def add_output(parser: argparse._ActionsContainer, **options: Any) -> None:
    """Add `-o`, `--output` with the options of `add_argument`."""
    parser.add_argument("-o", "--output", **options)


def add_finished(parser: argparse.ArgumentParser, what: str = "results of 'cuboid track'") -> None:
    """Add the folder of finished results, and `--recording`."""
    parser.add_argument("results", type=Path, metavar="DIR", help=what)
    parser.add_argument("--recording", type=Path, metavar="PATH", help="the recording, if it has moved since the run")


def add_results(parser: argparse._ActionsContainer) -> None:
    """Add `--json` (None if not given) and `--force`."""
    parser.add_argument(
        "--json",
        nargs="?",
        const=PRINTED,
        metavar="FILE.json",
        help="print the results as JSON and nothing else; with a file, write them to it and print the tables",
    )
    parser.add_argument("--force", action="store_true", help="replace files that an earlier call wrote")


def refuse_existing_files(args: argparse.Namespace) -> None:
    """Refuse, before the work starts, an existing output file that `--force` does not allow to replace.

    Raises
    ------
    OutputError
    """
    for name in FILES:
        file = getattr(args, name, None)
        if file is not None and file != PRINTED:
            refuse_existing(Path(file), force=args.force)
    pictures: Path | None = getattr(args, "pictures", None)
    if pictures is not None and not args.force and glob(f"{escape(str(pictures))}/*"):
        raise OutputError(f"{pictures}: the folder exists; --force replaces the pictures in it")


def refuse_existing(file: Path, *, force: bool) -> None:
    """Refuse an existing file unless `force` is set.

    Raises
    ------
    OutputError
    """
    if not force and os.path.isfile(file):
        raise OutputError(f"{file}: exists; --force replaces it")


def give(args: argparse.Namespace, document: Mapping[str, Any], show: Callable[[], None]) -> None:
    """Print the results as JSON alone, or show them for people and also write JSON to a file, as `--json` says.

    Parameters
    ----------
    args : argparse.Namespace
        With the arguments that `add_results` adds.
    document : mapping
        The results, ready for JSON.
    show : callable
        Prints the results for people.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    import json

    from cuboid.results.files.pending import write_whole

    if args.json is not None:
        text = json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False) + "\n"
        if args.json == PRINTED:
            print(text, end="")
            return
        write_whole(Path(args.json), text)
    show()
    if args.json is not None:
        console().print(f"all figures in {args.json}")
