"""`cuboid find`: find objects in a scene, in results, or over all recordings of a store."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from cuboid.cli.results import add_results, give
from cuboid.cli.text_model import add_text, ranking_model
from cuboid.cli.workers import positive
from cuboid.services.queries.words import length, moment, place, sizes, thing

if TYPE_CHECKING:
    from rich.table import Table

    from cuboid.method.text_search import TextModel
    from cuboid.services.queries.filters import Filters

EXAMPLE = "cuboid find STORE --size 8..14cm"

T = TypeVar("T")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("place", metavar="SCENE|RESULTS|STORE", help="a scene file, a result folder, or a store")
    _add_filters(parser)
    shown = parser.add_argument_group("output")
    shown.add_argument("--limit", type=positive, default=50, metavar="N", help="print at most N objects (default: 50)")
    shown.add_argument("--html", type=Path, metavar="FILE", help="also write the table with pictures as an HTML page")
    add_results(parser)


def run(args: argparse.Namespace) -> int:
    """Find and print."""
    from cuboid.cli.tables import console
    from cuboid.ground.core.threads import limit_threads
    from cuboid.results.files.pending import write_whole
    from cuboid.services.queries.filters import Filters
    from cuboid.services.queries.opening import is_place
    from cuboid.services.queries.parameters import text_query
    from cuboid.services.queries.rows import plain

    limit_threads(1)
    model = ranking_model(args)
    filters = Filters(
        size_m=args.size,
        near=args.near,
        near_object=args.near_object,
        within_m=args.within,
        on=args.on,
        inside=args.inside,
        beside=args.beside,
        recording=args.recording,
        since=args.since,
        until=args.until,
        color=args.color,
        name=args.name,
        min_score=args.min_score,
        like=args.like,
        text=text_query(args.text, model),
        limit=args.limit,
    )
    pictures = args.html is not None
    if is_place(args.place):
        rows = _in_place(args.place, filters, model, pictures=pictures)
    else:
        rows = _in_store(args.place, filters, pictures=pictures)
    if args.html is not None:
        from cuboid.fleet.store.page import found_page

        write_whole(args.html, found_page(rows, f"Objects of {args.place}"))

    def show() -> None:
        console().print(_table(rows) if rows else "no object found")
        if args.html is not None:
            console().print(f"the page with pictures is {args.html}", markup=False, soft_wrap=True)

    give(args, {"objects": [plain(row) for row in rows]}, show)
    return 0


def _in_store(store: str, filters: Filters, *, pictures: bool) -> list[dict[str, Any]]:
    from cuboid.ground.core.extras import need_cluster

    need_cluster("cuboid find STORE")
    from cuboid.fleet.store.find import find
    from cuboid.fleet.store.query import Tables

    return find(Tables(store), filters, pictures=pictures)


def _in_place(path: str, filters: Filters, model: TextModel | None, *, pictures: bool) -> list[dict[str, Any]]:
    from cuboid.ground.core.extras import need_cluster
    from cuboid.services.queries.opening import open_place
    from cuboid.services.queries.rows import row_of

    if pictures:
        need_cluster("cuboid find --html")
    place, title = open_place(path, model), Path(path).stem
    found = place.find(filters)
    return [row_of(one, title, place.picture(one.label) if pictures else None) for one in found]


def _table(rows: list[dict[str, Any]]) -> Table:
    from cuboid.cli.tables import new_table
    from cuboid.services.queries.rows import cells_of

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
    which.add_argument("--near-object", metavar="LABEL|NAME", help="near another object, at most --within away")
    which.add_argument("--on", metavar="LABEL|NAME|plane:N", help="on an object or a surface")
    which.add_argument("--in", dest="inside", metavar="LABEL|NAME", help="in an object")
    which.add_argument("--beside", metavar="LABEL|NAME", help="beside an object")
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
    which.add_argument("--name", metavar="NAME", help="name of the object, or class that a detector gave")
    add_text(which)
    which.add_argument("--min-score", type=float, metavar="S", help="least confidence that it is an object, 0 to 1")
    which.add_argument(
        "--like",
        type=_word(thing),
        metavar="RECORDING#LABEL",
        help="most similar to this object first, by size, shape and colors",
    )


def _word(read: Callable[[str], T]) -> Callable[[str], T]:
    """Return a reader of an argument; argparse prints its error message unchanged."""

    def read_word(text: str) -> T:
        try:
            return read(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return read_word
