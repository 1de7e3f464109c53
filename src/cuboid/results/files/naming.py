"""Names that people give to objects of finished results."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from cuboid.ground.core.errors import InputError, shown
from cuboid.ground.core.results import TrackedObject
from cuboid.ground.formats.folder import OBJECTS
from cuboid.method.objects.naming import chosen_name
from cuboid.results.files.objects import read_objects, write_objects
from cuboid.results.files.pending import PendingFile

# Largest number of characters of a name, which is shown beside its label.
LONGEST_NAME = 100


def checked_name(where: object, name: str) -> str:
    """Return a name without surrounding space; an empty name stands for no name.

    Raises
    ------
    InputError
        The name is not a single line of at most `LONGEST_NAME` characters; the message begins with `where`.
    """
    name = name.strip()
    if not name.isprintable() or len(name) > LONGEST_NAME:
        raise InputError(f"{where}: a name is one line of at most {LONGEST_NAME} characters, got {shown(name)}")
    return name


def renamed_object(item: TrackedObject, name: str) -> TrackedObject:
    """Return an object with a name given by a user; with an empty name, the detector's class is its name again."""
    if name:
        return item.with_given_name(name)
    seen = () if item.name_score is None else ((item.name or "", item.name_score),)
    return dataclasses.replace(item, **chosen_name((*seen, *item.names)))


def name_object(folder: Path, label: int, name: str) -> TrackedObject:
    """Set the name of an object or a piece of furniture of a result folder, and return it; an empty name removes it.

    Parameters
    ----------
    folder : Path
        Result folder of `cuboid track`; its `objects.json` is replaced.
    label : int
    name : str

    Raises
    ------
    InputError
        No object has the label, or the name is not a single line of at most `LONGEST_NAME` characters.
    OutputError
        The file cannot be written; it is unchanged.
    """
    path = folder / OBJECTS
    name = checked_name(path, name)
    found = read_objects(path)
    item = next((item for item in (*found.objects, *found.furniture) if item.label == label), None)
    if item is None:
        raise InputError(f"{path}: no object has the label {label}")
    named = renamed_object(item, name)
    objects, furniture = (
        tuple(named if other is item else other for other in entries) for entries in (found.objects, found.furniture)
    )
    file = PendingFile(path)
    with file.writing():
        write_objects(file.partial, dataclasses.replace(found, objects=objects, furniture=furniture))
        file.show()
    return named
