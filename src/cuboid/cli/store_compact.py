"""`cuboid store compact`: merge the small files of a store into large ones."""

from __future__ import annotations

import argparse
from dataclasses import asdict

from cuboid.cli.results import add_results, give
from cuboid.ground.core.extras import need_cluster

EXAMPLE = "cuboid store compact STORE"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("store", metavar="STORE", help="the store of 'cuboid batch': a folder or URL")
    add_results(parser)


def run(args: argparse.Namespace) -> int:
    """Merge files, and remove the leftovers of killed tasks."""
    need_cluster("cuboid store compact")
    from cuboid.fleet.store.compact import compact, tidy
    from cuboid.fleet.store.folder import StoreFolder
    from cuboid.fleet.store.page import write_summary
    from cuboid.fleet.store.query import Tables

    Tables(args.store)  # raises if there is no store
    place = StoreFolder(args.store)
    done = compact(place)
    left = tidy(place)
    write_summary(args.store)
    line = f"{done.runs} runs merged: {done.files_before} files became {done.files_after}; {left} leftovers removed"
    give(args, {**asdict(done), "removed": left}, lambda: print(line))
    return 0
