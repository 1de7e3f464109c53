"""`cuboid name`: give names to objects of results, a scene or a store."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from cuboid.cli.results import add_results, give
from cuboid.cli.tables import console
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.extras import need_cluster

EXAMPLE = 'cuboid name RESULTS 1=bin 2="red cup"'
_GIVEN = re.compile(r"(?:(?P<recording>.*)#)?(?P<label>\d{1,9})=(?P<name>.*)", re.DOTALL)
Given = tuple[str, int, str]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("place", metavar="SCENE|RESULTS|STORE", help="a scene file, a result folder, or a store")
    parser.add_argument(
        "names",
        nargs="+",
        type=_given,
        metavar="LABEL=NAME",
        help="label and name, such as 1=bin or 2='red cup'; 1= removes the name; in a store kitchen-3#1=bin",
    )
    add_results(parser)


def run(args: argparse.Namespace) -> int:
    """Name the objects, and print them with their new names."""
    from cuboid.ground.core.results import tag_of

    name = _namer(args.place)
    rows: list[dict[str, Any]] = []
    for recording, label, text in args.names:
        name(recording, label, text)
        rows.append({**({"recording": recording} if recording else {}), "label": label, "name": text.strip() or None})

    def show() -> None:
        for row in rows:
            console().print(f"{row.get('recording', '')}{tag_of(row['label'], row['name'])}")

    give(args, {"named": rows}, show)
    return 0


def _namer(path: str) -> Callable[[str, int, str], object]:
    """Return the function that names an object of a place: (recording, label, name)."""
    from cuboid.services.queries.opening import is_place

    if not is_place(path):
        return _in_store(path)
    place = Path(path)
    if place.is_dir():
        from cuboid.results.files.naming import name_object as name
    else:
        from cuboid.runs.scene import Scene

        if not place.is_file():
            raise InputError(f"{place}: there is no such scene file")

        def name(_: Path, label: int, text: str) -> None:  # type: ignore[misc]  # both have the same arguments
            with Scene.open(place) as scene:
                scene.name(label, text)

    def named(recording: str, label: int, text: str) -> None:
        if recording:
            raise InputError(f"{recording}#{label}: only objects of a store are named with their recording")
        name(place, label, text)

    return named


def _in_store(url: str) -> Callable[[str, int, str], None]:
    """Return the function that names an object of a store."""
    need_cluster("cuboid name STORE")
    from cuboid.fleet.store.naming import name_in_store

    def named(recording: str, label: int, text: str) -> None:
        if not recording:
            raise InputError(f"{label}: expected RECORDING#LABEL=NAME for a store, such as kitchen-3#{label}=bin")
        name_in_store(url, recording, label, text)

    return named


def _given(text: str) -> Given:
    """Parse [RECORDING#]LABEL=NAME."""
    found = _GIVEN.fullmatch(text)
    if found is None:
        raise argparse.ArgumentTypeError(f"expected LABEL=NAME such as 1=bin, got {text!r}")
    return found["recording"] or "", int(found["label"]), found["name"]
