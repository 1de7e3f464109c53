"""`cuboid store compact`: gather the small files of a store into large ones."""

from __future__ import annotations

import argparse

HELP = "gather the small files of a store into large ones, and remove what killed tasks left"
EXAMPLE = "cuboid store compact STORE"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what the command takes."""
    parser.add_argument("store", metavar="STORE", help="what 'cuboid batch' wrote: a folder or URL")


def run(args: argparse.Namespace) -> int:
    """Gather and tidy."""
    from cuboid.extras import need_cluster

    need_cluster("cuboid store compact")
    from cuboid.store.compact import compact, tidy
    from cuboid.store.page import write_summary
    from cuboid.store.place import Place
    from cuboid.store.query import Tables

    Tables(args.store)  # there is one
    place = Place(args.store)
    done = compact(place)
    left = tidy(place)
    write_summary(args.store)
    print(f"{done.runs} runs gathered: {done.files_before} files became {done.files_after}; {left} leftovers removed")
    return 0
