"""`cuboid find`: find objects in a scene, in results, or over all recordings of a store."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from cuboid.cli.recording import probability
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
    text = text_query(args.text, model)
    filters = Filters(**{field: getattr(args, field) for _, field, *_ in CONDITIONS}, text=text, limit=args.limit)
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
    names = ["size L x M x S (cm)", "position x, y, z (m)", "color", "probability", "frames", "last seen (UTC)"]
    table = new_table("object", *names, *([last] if last else []))
    for row in rows:
        table.add_row(*cells_of(row), *([f"{row[last]:.3f}"] if last else []))
    return table


def _add_filters(parser: argparse.ArgumentParser) -> None:
    """Add the conditions on objects."""
    which = parser.add_argument_group("conditions")
    for option, field, read, metavar, meaning in CONDITIONS:
        default = 0.5 if field == "within_m" else None
        which.add_argument(option, dest=field, type=read, default=default, metavar=metavar, help=meaning)
        if field == "name":
            add_text(which)


def _word(read: Callable[[str], T]) -> Callable[[str], T]:
    """Return a reader of an argument; argparse prints its error message unchanged."""

    def read_word(text: str) -> T:
        try:
            return read(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return read_word


# Option, field of `Filters`, reader, placeholder, and help of each condition, in the order of the help.
CONDITIONS: tuple[tuple[str, str, Callable[[str], Any], str, str], ...] = (
    ("--size", "size_m", _word(sizes), "A..B", "range of the longest side, such as 8..14cm or 0.5m.."),
    ("--near", "near", _word(place), "X,Y,Z", "near a point in the world of the recordings, metres"),
    ("--within", "within_m", _word(length), "D", "largest distance from that point (default: 0.5m)"),
    ("--near-object", "near_object", str, "LABEL|NAME", "near another object, at most --within away"),
    ("--on", "on", str, "LABEL|NAME|plane:N", "on an object or a surface"),
    ("--in", "inside", str, "LABEL|NAME", "in an object"),
    ("--beside", "beside", str, "LABEL|NAME", "beside an object"),
    ("--recording", "recording", str, "GLOB", "in recordings with this name, such as 'kitchen*'"),
    (
        "--since",
        "since",
        _word(moment),
        "WHEN",
        "last seen after this date or time, such as 2026-03-01, or within the last 7d, 12h, 30min",
    ),
    ("--until", "until", _word(moment), "WHEN", "last seen before this date or time"),
    ("--color", "color", str, "WORD", "at least 30 %% of the object has this color: red, blue, grey, ..."),
    ("--name", "name", str, "NAME", "name of the object, or class that a detector gave"),
    ("--min-probability", "min_probability", probability, "P", "with at least this probability, 0 to 1"),
    ("--like", "like", _word(thing), "RECORDING#LABEL", "most similar to this object first, by size, shape and colors"),
)
