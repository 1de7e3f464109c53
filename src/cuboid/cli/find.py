"""`cuboid find`: find objects over all recordings of a store."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from cuboid.cli.results import add_results, give
from cuboid.cli.text_model import add_text, query_from
from cuboid.cli.workers import positive
from cuboid.store.filter_words import length, moment, place, sizes, thing

if TYPE_CHECKING:
    from rich.table import Table

EXAMPLE = "cuboid find STORE --size 8..14cm"

T = TypeVar("T")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("store", metavar="STORE", help="the store of 'cuboid batch': a folder or URL")
    _add_filters(parser)
    shown = parser.add_argument_group("output")
    shown.add_argument("--limit", type=positive, default=50, metavar="N", help="print at most N objects (default: 50)")
    shown.add_argument("--html", type=Path, metavar="FILE", help="also write the table with pictures as an HTML page")
    add_results(parser)


def run(args: argparse.Namespace) -> int:
    """Find and print."""
    from cuboid.core.extras import need_cluster

    need_cluster("cuboid find")
    from cuboid.cli.tables import console
    from cuboid.outputs.pending import write_whole
    from cuboid.store.find import Filters, find, plain
    from cuboid.store.page import found_page
    from cuboid.store.query import Tables

    filters = Filters(
        size_m=args.size,
        near=args.near,
        within_m=args.within,
        recording=args.recording,
        since=args.since,
        until=args.until,
        color=args.color,
        name=args.name,
        min_score=args.min_score,
        like=args.like,
        text=query_from(args),
        limit=args.limit,
    )
    rows = find(Tables(args.store), filters, pictures=args.html is not None)
    if args.html is not None:
        write_whole(args.html, found_page(rows, f"Objects of {args.store}"))

    def show() -> None:
        console().print(_table(rows) if rows else "no object found")
        if args.html is not None:
            console().print(f"the page with pictures is {args.html}", markup=False, soft_wrap=True)

    give(args, {"objects": [plain(row) for row in rows]}, show)
    return 0


def _table(rows: list[dict[str, Any]]) -> Table:
    from cuboid.cli.tables import new_table
    from cuboid.store.page import cells_of

    last = next((name for name in ("text_score", "unlike", "distance_m") if name in rows[0]), None)
    names = ["size L x M x S (cm)", "position x, y, z (m)", "color", "frames", "last seen (UTC)"]
    table = new_table("object", *names, *([last] if last else []))
    for row in rows:
        table.add_row(*cells_of(row), *([f"{row[last]:.3f}"] if last else []))
    return table


def _add_filters(parser: argparse.ArgumentParser) -> None:
    """Add the conditions on objects."""
    which = parser.add_argument_group("conditions")
    which.add_argument(
        "--size", type=_word(sizes), metavar="A..B", help="range of the longest side, such as 8..14cm or 0.5m.."
    )
    which.add_argument(
        "--near", type=_word(place), metavar="X,Y,Z", help="near a point in the world of the recordings, metres"
    )
    which.add_argument(
        "--within",
        type=_word(length),
        default=0.5,
        metavar="D",
        help="largest distance from that point (default: 0.5m)",
    )
    which.add_argument("--recording", metavar="GLOB", help="in recordings with this name, such as 'kitchen*'")
    which.add_argument(
        "--since",
        type=_word(moment),
        metavar="WHEN",
        help="last seen after this date or time, such as 2026-03-01, or within the last 7d, 12h, 30min",
    )
    which.add_argument("--until", type=_word(moment), metavar="WHEN", help="last seen before this date or time")
    which.add_argument(
        "--color", metavar="WORD", help="at least 30 %% of the object has this color: red, blue, grey, ..."
    )
    which.add_argument("--name", metavar="NAME", help="class that a detector gave")
    add_text(which)
    which.add_argument("--min-score", type=float, metavar="S", help="least confidence that it is an object, 0 to 1")
    which.add_argument(
        "--like",
        type=_word(thing),
        metavar="RECORDING#LABEL",
        help="most similar to this object first, by size, shape and colors",
    )


def _word(read: Callable[[str], T]) -> Callable[[str], T]:
    """Return a reader whose message argparse prints unchanged."""

    def read_word(text: str) -> T:
        try:
            return read(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return read_word
