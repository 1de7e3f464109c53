"""The classes that a detector saw in a scene's objects: rows of the table `scene`, one a class and label."""

from __future__ import annotations

import sqlite3
from collections import defaultdict
from collections.abc import Iterable

from cuboid.objects.entry import MapObject
from cuboid.objects.naming import name_scores
from cuboid.outputs.text import LENGTH, rounded
from cuboid.scene.validation import DamagedError, Row

# The key of a row is this, the label, and the place of the class among the object's, the most likely first; its value
# the probability and the name.
KEY = "class"
# Classes that are kept: the name and the next three.
KEPT = 4
# Longer names are cut, characters: the table has no room for more.
LONGEST = 100


def write_classes(connection: sqlite3.Connection, objects: Iterable[tuple[MapObject, int]]) -> None:
    """Write the classes of objects that a detector saw, within the caller's transaction."""
    for entry, other in objects:
        if other or not entry.name_log_odds:
            continue
        connection.execute("DELETE FROM scene WHERE key GLOB ?", (f"{KEY}/{entry.label}/*",))
        for place, (name, score) in enumerate(name_scores(entry.name_log_odds)[:KEPT]):
            value = f"{rounded(score, LENGTH)} {name[:LONGEST]}"
            connection.execute("INSERT INTO scene VALUES (?, ?)", (f"{KEY}/{entry.label}/{place}", value))


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
