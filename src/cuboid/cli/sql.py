"""`cuboid sql`: query the tables of a store, with DuckDB in this process."""

from __future__ import annotations

import argparse
from math import isfinite

from cuboid.cli.parser import positive
from cuboid.cli.results import add_results, give
from cuboid.cli.tables import console, new_table
from cuboid.ground.core.errors import InputError, shown
from cuboid.ground.core.extras import need_cluster
from cuboid.ground.core.threads import cores

EXAMPLE = 'cuboid sql STORE "select count(*) from objects"'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("store", metavar="STORE", help="the store of 'cuboid batch': a folder or URL")
    parser.add_argument(
        "question", metavar="SQL", help='a query such as "select color, count(*) from objects group by color"'
    )
    parser.add_argument("--csv", action="store_true", help="print the whole answer as CSV")
    add_results(parser)
    parser.add_argument(
        "--threads", type=positive, default=cores(), metavar="N", help="number of threads (default: %(default)s)"
    )


def run(args: argparse.Namespace) -> int:
    """Query and print."""
    import sys

    need_cluster("cuboid sql")
    from cuboid.fleet.store.query import Tables

    answer = Tables(args.store, args.threads).ask(args.question)
    if args.csv:
        if args.json is not None:
            raise InputError("--csv and --json cannot be combined")
        from pyarrow import csv

        sys.stdout.flush()
        csv.write_csv(answer, sys.stdout.buffer)
        return 0
    rows = answer.to_pylist()

    def show() -> None:
        table = new_table(*answer.column_names)
        for row in rows:
            table.add_row(*(_cell(value) for value in row.values()))
        console().print(table)

    give(args, {"rows": [{name: _plain(value) for name, value in row.items()} for row in rows]}, show)
    return 0


def _plain(value: object) -> object:
    """Return a value ready for JSON: bytes as base64, times as ISO 8601, non-finite numbers as null."""
    from base64 import b64encode
    from datetime import date, time

    if isinstance(value, dict):
        return {str(name): _plain(item) for name, item in value.items()}
    if isinstance(value, list):
        return [_plain(item) for item in value]
    if isinstance(value, bytes):
        return b64encode(value).decode("ascii")
    if isinstance(value, date | time):
        return value.isoformat()
    if isinstance(value, float):
        return value if isfinite(value) else None
    return value if value is None or isinstance(value, str | int | bool) else str(value)


def _cell(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.6g}"
    return value if isinstance(value, str) else shown(value) if isinstance(value, bytes | list | dict) else str(value)
