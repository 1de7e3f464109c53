"""`cuboid sql`: any question to the tables of a store, answered by DuckDB in this process."""

from __future__ import annotations

import argparse

from cuboid.cli.threads import cores, positive

HELP = "ask the tables of a store in SQL"
EXAMPLE = 'cuboid sql STORE "select count(*) from objects"'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what the command takes."""
    parser.add_argument("store", metavar="STORE", help="what 'cuboid batch' wrote: a folder or URL")
    parser.add_argument("question", metavar="SQL", help='such as "select color, count(*) from objects group by color"')
    parser.add_argument("--csv", action="store_true", help="print the answer as CSV, whole")
    parser.add_argument(
        "--threads", type=positive, default=cores(), metavar="N", help="threads in use (default: %(default)s)"
    )


def run(args: argparse.Namespace) -> int:
    """Ask and print."""
    import sys

    from cuboid.extras import need_cluster

    need_cluster("cuboid sql")
    from cuboid.cli.tables import console, new_table
    from cuboid.store.query import Tables

    answer = Tables(args.store, args.threads).ask(args.question)
    if args.csv:
        from pyarrow import csv

        sys.stdout.flush()
        csv.write_csv(answer, sys.stdout.buffer)
        return 0
    table = new_table(*answer.column_names)
    for row in answer.to_pylist():
        table.add_row(*(_cell(value) for value in row.values()))
    console().print(table)
    return 0


def _cell(value: object) -> str:
    from cuboid.errors import shown

    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.6g}"
    return value if isinstance(value, str) else shown(value) if isinstance(value, bytes | list | dict) else str(value)
