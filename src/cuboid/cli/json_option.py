"""`--json`: the same for all commands that have figures."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

PRINTED = "-"


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add `--json`, which prints, and `--json FILE`, which writes; None in the arguments where it is not given."""
    parser.add_argument(
        "--json",
        nargs="?",
        const=PRINTED,
        metavar="FILE.json",
        help="print JSON and no tables; with a file, write it there and print the tables",
    )


def without_guessing(words: Sequence[str]) -> list[str]:
    """Return a command line in which `--json` takes no word that is no name of a JSON file, a recording's say."""
    words = list(words)
    for k, word in enumerate(words):
        follows = words[k + 1] if k + 1 < len(words) else PRINTED
        if word == "--json" and follows != PRINTED and not follows.endswith(".json"):
            words[k] = f"--json={PRINTED}"
    return words
