"""`--threads`: how many threads a command uses."""

from __future__ import annotations

import argparse


def add_threads(parser: argparse._ActionsContainer, default: int) -> None:
    """Add `--threads`."""
    parser.add_argument(
        "--threads",
        type=positive,
        default=default,
        metavar="N",
        help="threads in use: 1 is the tracker alone, with 2 the next frames are decoded meanwhile, "
        "more go to the libraries (default: %(default)s)",
    )


def positive(text: str) -> int:
    """Read a whole number of at least 1 from the command line."""
    try:
        value = int(text)
    except ValueError:
        value = 0
    if value < 1:
        raise argparse.ArgumentTypeError(f"expected a whole number of at least 1, got '{text}'")
    return value
