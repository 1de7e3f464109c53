"""`--json`: the same for all commands that have figures."""

from __future__ import annotations

import argparse

from cuboid.cli.optional_words import OPTIONAL

PRINTED = OPTIONAL["--json"][0]


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add `--json`, which prints, and `--json FILE`, which writes; None in the arguments where it is not given."""
    parser.add_argument(
        "--json",
        nargs="?",
        const=PRINTED,
        metavar="FILE.json",
        help="print JSON and no tables; with a file, write it there and print the tables",
    )
