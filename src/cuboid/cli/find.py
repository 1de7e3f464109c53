"""`cuboid find`: where is a thing like this, over all recordings of a store."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cuboid.cli.filters import add_filters
from cuboid.cli.results import add_results, give
from cuboid.cli.threads import positive

if TYPE_CHECKING:
    from rich.table import Table

EXAMPLE = "cuboid find STORE --size 8..14cm"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what the command takes."""
    parser.add_argument("store", metavar="STORE", help="what 'cuboid batch' wrote: a folder or URL")
    add_filters(parser)
    shown = parser.add_argument_group("answer")
    shown.add_argument("--limit", type=positive, default=50, metavar="N", help="at most N objects (default: 50)")
    shown.add_argument("--html", type=Path, metavar="FILE", help="write the table with pictures as a page")
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
        min_score=args.min_score,
        like=args.like,
        limit=args.limit,
    )
    rows = find(Tables(args.store), filters, pictures=args.html is not None)
    if args.html is not None:
        write_whole(args.html, found_page(rows, f"Objects of {args.store}"))

    def show() -> None:
        console().print(_table(rows) if rows else "no object found")
        if args.html is not None:
            console().print(f"with pictures in {args.html}", markup=False, soft_wrap=True)

    give(args, {"objects": [plain(row) for row in rows]}, show)
    return 0


def _table(rows: list[dict[str, Any]]) -> Table:
    from cuboid.cli.tables import new_table
    from cuboid.store.page import cells_of

    last = next((name for name in ("unlike", "distance_m") if name in rows[0]), None)
    names = ["size L x M x S (cm)", "position x, y, z (m)", "color", "frames", "last seen (UTC)"]
    table = new_table("object", *names, *([last] if last else []))
    for row in rows:
        table.add_row(*cells_of(row), *([f"{row[last]:.3f}"] if last else []))
    return table
