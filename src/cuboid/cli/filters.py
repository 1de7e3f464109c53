"""How objects are asked for on the command line, in the words of people."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import TypeVar

from cuboid.store.filter_words import length, moment, place, sizes, thing

T = TypeVar("T")


def add_filters(parser: argparse.ArgumentParser) -> None:
    """Add what tells objects apart."""
    which = parser.add_argument_group("which objects")
    which.add_argument(
        "--size", type=_word(sizes), metavar="A..B", help="length of the longest side, as 8..14cm or 0.5m.."
    )
    which.add_argument(
        "--near", type=_word(place), metavar="X,Y,Z", help="near a place in the recordings' world, metres"
    )
    which.add_argument("--within", type=_word(length), default=0.5, metavar="D", help="so near (default: 0.5m)")
    which.add_argument("--recording", metavar="GLOB", help="in recordings of this name, as 'kitchen*'")
    which.add_argument(
        "--since", type=_word(moment), metavar="WHEN", help="last seen since 2026-03-01, or for 7d, 12h, 30min"
    )
    which.add_argument("--until", type=_word(moment), metavar="WHEN", help="last seen before")
    which.add_argument("--color", metavar="WORD", help="red, blue, grey, ...: of which a third of it is")
    which.add_argument("--min-score", type=float, metavar="S", help="confidence that it is an object, 0 to 1")
    which.add_argument(
        "--like", type=_word(thing), metavar="RECORDING#LABEL", help="the most like this one, by size, shape and colors"
    )


def _word(read: Callable[[str], T]) -> Callable[[str], T]:
    """Return a reader whose complaint argparse prints as it is."""

    def read_word(text: str) -> T:
        try:
            return read(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return read_word
