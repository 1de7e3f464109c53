"""`cuboid find`: find objects in a scene, in results, or over all recordings of a store."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from rich.table import Table

from cuboid.cli.parser import positive, probability
from cuboid.cli.results import add_results, give
from cuboid.cli.tables import console, fits, new_table
from cuboid.cli.text_model import add_text, ranking_model
from cuboid.ground.core.errors import InputError, counted
from cuboid.ground.core.extras import need_cluster
from cuboid.services.queries.words import length, moment, place, sizes, thing

if TYPE_CHECKING:
    from cuboid.method.text_search import TextModel
    from cuboid.services.queries.filters import Filters

EXAMPLE = "cuboid find STORE --size 8..14cm"

T = TypeVar("T")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("place", metavar="SCENE|RESULTS|STORE", help="a scene file, a result folder, or a store")
    parser.add_argument(
        "question",
        nargs="?",
        metavar="QUESTION",
        help="a question in English, such as 'the blue bin beside the chair'; further conditions must hold as well",
    )
    parser.add_argument(
        "--last",
        metavar="LABEL|NAME",
        help="where and when this object was seen last, from where, and whether it is still there; gone objects too",
    )
    _add_filters(parser)
    shown = parser.add_argument_group("output")
    shown.add_argument("--limit", type=positive, default=50, metavar="N", help="print at most N objects (default: 50)")
    shown.add_argument(
        "--picture", type=Path, metavar="FILE.jpg", help="write the picture of the last sighting of the first object"
    )
    shown.add_argument("--html", type=Path, metavar="FILE", help="also write the objects with pictures as an HTML page")
    add_results(parser)


def run(args: argparse.Namespace) -> int:
    """Find and print."""
    from cuboid.results.files.pending import write_whole
    from cuboid.services.queries.filters import Filters
    from cuboid.services.queries.opening import is_place
    from cuboid.services.queries.parameters import text_query
    from cuboid.services.queries.rows import plain

    model = ranking_model(args)
    text = text_query(args.text, model)
    filters = Filters(**{field: getattr(args, field) for _, field, *_ in CONDITIONS}, text=text, limit=args.limit)
    conditions = filters != Filters(within_m=filters.within_m, limit=args.limit)
    if args.last is not None and (conditions or args.question is not None):
        raise InputError(
            "expected --last alone, or a question in English or conditions such as --name ('cuboid find --help')"
        )
    answer = _in_place(args, filters, model) if is_place(args.place) else _in_store(args, filters)
    if args.html is not None:
        from cuboid.services.queries.search_page import found_page

        write_whole(args.html, found_page(answer.rows, f"Objects of {args.place}"))
    if args.picture is not None:
        picture = answer.picture(answer.rows[0]) if answer.rows else None
        if picture is None:
            raise InputError(f"{args.picture}: {'it has no picture' if answer.rows else 'no object found'}")
        write_whole(args.picture, picture)

    def show() -> None:
        _show(args, answer)
        for file, what in ((args.html, "the page with pictures"), (args.picture, "the picture of the last sighting")):
            if file is not None:
                console().print(f"{what} is {file}", soft_wrap=True)

    understood = {} if args.question is None else {"understood": list(answer.understood)}
    give(args, {**understood, "objects": [plain(row) for row in answer.rows]}, show)
    return 0


@dataclass(frozen=True)
class Answered:
    """The answer of a place or a store.

    Attributes
    ----------
    rows : list of dict
        With the columns of `cuboid find`.
    note : str or None
        Why there are no rows, if a name is not known.
    picture : callable
        Returns the picture of the last sighting of a row, or None.
    understood : tuple of str
        The conditions of a question in English.
    """

    rows: list[dict[str, Any]]
    note: str | None
    picture: Callable[[Mapping[str, Any]], bytes | None]
    understood: tuple[str, ...] = ()


def _in_store(args: argparse.Namespace, filters: Filters) -> Answered:
    need_cluster("cuboid find STORE")
    from cuboid.fleet.store.find import StoreObjects, ask, find, last_seen, picture_of
    from cuboid.fleet.store.query import Tables
    from cuboid.services.queries.questions import no_such_name

    tables, more = Tables(args.place), () if args.html is None else ("picture",)
    understood: tuple[str, ...] = ()
    note: str | None = None
    if args.question is not None:
        understood, rows, note = ask(tables, args.question, limit=args.limit, more=more, also=filters)
    elif args.last is not None:
        rows = last_seen(tables, args.last, more)[: args.limit]
    else:
        rows = find(tables, filters, more)
        note = None if rows else no_such_name(StoreObjects(tables), filters.name)

    def picture(row: Mapping[str, Any]) -> bytes | None:
        return picture_of(tables, row["recording"], row["label"], last=True)

    return Answered(rows, note, picture, understood)


def _in_place(args: argparse.Namespace, filters: Filters, model: TextModel | None) -> Answered:
    from cuboid.services.queries.opening import open_place
    from cuboid.services.queries.rows import row_of

    place, title = open_place(args.place, model), Path(args.place).stem
    understood: tuple[str, ...] = ()
    note: str | None = None
    if args.question is not None:
        answer = place.ask(args.question, args.limit, filters)
        understood, found, note = answer.understood, list(answer.objects), answer.note
    elif args.last is not None:
        found = place.last_seen(args.last)[: args.limit]
    else:
        found = place.find(filters)
        note = None if found else place.no_such_name(filters.name)
    rows = [row_of(one, title, place.picture(one.label) if args.html is not None else None) for one in found]
    return Answered(rows, note, lambda row: place.picture(row["label"], last=True), understood)


def _show(args: argparse.Namespace, answer: Answered) -> None:
    """Print the conditions that were understood, and the objects: as lines if the question is where they are."""
    from cuboid.services.queries.english import COUNT, WHERE
    from cuboid.services.queries.rows import last_seen_lines, tag

    if answer.understood:
        console().print(f"understood: {', '.join(answer.understood)}")
    if COUNT in answer.understood:
        least = "at least " if len(answer.rows) == args.limit else ""
        console().print(f"{least}{counted(len(answer.rows), 'object')}")
    if not answer.rows:
        console().print(answer.note or "no object found")
    elif args.last is not None or WHERE in answer.understood:
        for row in answer.rows:
            first, *others = last_seen_lines(row)
            console().print("\n  ".join((f"{tag(row)}: {first}", *others)))
    else:
        console().print(_table(answer.rows))


def _table(rows: list[dict[str, Any]]) -> Table:
    """Return the table; in a narrow terminal without the columns that matter least."""
    from cuboid.results.files.object_table import SIZE_HEADING, SURE_SIZE_HEADING
    from cuboid.services.queries.rows import cells_of

    last = next((name for name in ("text_score", "unlike", "distance_m") if name in rows[0]), None)
    middle = ["position x, y, z (m)", "color", "probability", "frames", "last seen (UTC)", "since then"]
    one_place = all(row["run"] is None for row in rows)
    table = new_table()
    for errors, least in (
        (True, ()),
        (False, ()),
        *((False, ("frames", "probability", "color", "position x, y, z (m)")[:count]) for count in range(1, 5)),
    ):
        names = ["object", SURE_SIZE_HEADING if errors else SIZE_HEADING, *middle, *([last] if last else [])]
        kept = [k for k, name in enumerate(names) if name not in least]
        table = new_table(*(names[k] for k in kept))
        for row in rows:
            cells = [*cells_of(row, errors=errors), *([f"{row[last]:.3f}"] if last else [])]
            cells[0] = cells[0].removeprefix(row["recording"]) if one_place else cells[0]
            table.add_row(*(cells[k] for k in kept))
        if fits(table, console()):
            break
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
    ("--on", "on", str, "LABEL|NAME|floor|table|plane:N", "on an object or a surface"),
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
