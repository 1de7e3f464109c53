"""What a detector saw in a scene's objects, classes and kinds: rows of the table `scene`, one a class and label."""

from __future__ import annotations

import sqlite3
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence

from cuboid.outputs.text import LENGTH, rounded
from cuboid.scene.validation import DamagedError, Row, read_rows

# The key of a row is this, the label, and the place of the class among the object's, the most likely first; its value
# the probability and the name.
KEY = "class"
# The key of the kind of an object that depth does not read: this, the label, and 0.
KIND, KINDS = "kind", ("box", "flat")
# Classes that are kept: the name and the next three.
KEPT = 4
# Longer names are cut, characters: the table has no room for more.
LONGEST = 100


def write_classes(connection: sqlite3.Connection, classes: Mapping[int, Sequence[tuple[str, float]]]) -> None:
    """Write the classes of objects that a detector saw, by label, within the caller's transaction."""
    for label, seen in classes.items():
        if seen:
            _replace(connection, KEY, label, [f"{rounded(score, LENGTH)} {name[:LONGEST]}" for name, score in seen])


def _replace(connection: sqlite3.Connection, key: str, label: int, values: Sequence[str]) -> None:
    connection.execute("DELETE FROM scene WHERE key GLOB ?", (f"{key}/{label}/*",))
    rows = [(f"{key}/{label}/{place}", value) for place, value in enumerate(values[:KEPT])]
    connection.executemany("INSERT INTO scene VALUES (?, ?)", rows)


def write_kinds(connection: sqlite3.Connection, kinds: Mapping[int, str | None]) -> None:
    """Write of labels which kind of object they are, where it is none that depth reads; None removes it."""
    for label, kind in kinds.items():
        _replace(connection, KIND, label, [] if kind is None else [kind])


def read_kinds(connection: sqlite3.Connection) -> dict[int, str]:
    """Return the kinds of objects that depth does not read, by label.

    Raises
    ------
    DamagedError
        A row makes no sense.
    """
    columns = ("scene.key", "scene.value")
    return {
        _label_of(key, value): value
        for key, value in read_rows(connection, columns, "scene WHERE key GLOB ?", [f"{KIND}/*"])
    }


def _label_of(key: str, value: str) -> int:
    _, _, rest = key.partition("/")
    label, _, _ = rest.partition("/")
    if value not in KINDS or not label.isdecimal():
        raise DamagedError(f"the kind of an object is damaged: '{key}' is '{value}'")
    return int(label)


def read_classes(rows: Iterable[Row]) -> dict[int, list[tuple[str, float]]]:
    """Return classes with their probabilities, the most likely first, by label.

    Parameters
    ----------
    rows : iterable of (str, str)
        Key and value, by key.

    Raises
    ------
    DamagedError
        A row makes no sense.
    """
    found: dict[int, list[tuple[str, float]]] = defaultdict(list)
    for key, value in rows:
        try:
            _, label, _ = key.split("/")
            score, name = value.split(" ", 1)
            found[int(label)].append((name, min(max(float(score), 0.0), 1.0)))
        except ValueError:
            raise DamagedError(f"the class of an object is damaged: '{key}' is '{value}'") from None
    return found
