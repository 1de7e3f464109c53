"""Names that people give to objects of a store: a file for each run, which the tables put in place of other names."""

from __future__ import annotations

import tempfile
from pathlib import Path

import msgspec

from cuboid.fleet.store.find import the_one
from cuboid.fleet.store.folder import StoreFolder
from cuboid.fleet.store.query import NAMES, Tables, read_names
from cuboid.ground.formats.folder import OBJECTS, REPORT
from cuboid.results.files.naming import checked_name, name_object


def name_in_store(url: str, recording: str, label: int, name: str) -> None:
    """Set the name of an object of a store; an empty name removes it.

    The result files of the run, if the store has them, get the name too.

    Parameters
    ----------
    url : str
    recording : str
    label : int
    name : str

    Raises
    ------
    InputError
        There is no such object, or the name is not a single line of at most 100 characters.
    OutputError
        The store cannot be written.
    """
    name = checked_name(f"{recording}#{label}", name)
    tables, place = Tables(url), StoreFolder(url)
    run = the_one(tables, recording, label, "run")["run"]
    names = {str(one): text for one, text in read_names(place).get(run, {}).items() if one != label}
    if name:
        names[str(label)] = name
    (folder,) = (row["results"] for row in tables.rows("select results from runs where run = ?", [run]))
    if folder is not None:
        _name_in_results(place, folder, label, name)
    place.put(f"{NAMES}/{run}.json", msgspec.json.encode(names, order="sorted"))


def _name_in_results(place: StoreFolder, folder: str, label: int, name: str) -> None:
    """Name an object in the result files of a run."""
    with tempfile.TemporaryDirectory(prefix="cuboid-names-") as work:
        copied = []
        for file in (OBJECTS, REPORT):
            try:
                (Path(work) / file).write_bytes(place.read(f"{folder}/{file}"))
            except FileNotFoundError:
                continue
            copied.append(file)
        if OBJECTS not in copied:
            return
        name_object(Path(work), label, name)
        for file in copied:
            place.put(f"{folder}/{file}", (Path(work) / file).read_bytes())
