"""Classes, kinds, accuracy and least probability of a scene's objects: rows of the table `scene`."""

from __future__ import annotations

import math
import sqlite3
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import get_args

from cuboid.ground.core.values import SideName
from cuboid.results.files.text import LENGTH, rounded
from cuboid.runs.scene.validation import DamagedError, Row, read_rows

# A row's key is KEY, the label, and the rank of the class (the most likely first); its value is the probability and the
# class name.
KEY = "class"
# A row's key for the kind of an object without usable depth: KIND, the label, and 0.
KIND, KINDS = "kind", ("box", "flat")
# A row's key for how sure the box of an object is: ACCURACY, the label, and 0; its value holds the standard deviations
# of its size and of its centre, metres, and the sides that were seen.
ACCURACY = "accuracy"
# Key of the probability that the scene's present objects have at least.
MIN_PROBABILITY = "min_probability"
# Maximum number of classes kept per object: its name and the next three.
KEPT = 4
# Maximum length of a class name, characters; longer names are cut.
LONGEST = 100
SIDE_NAMES: tuple[SideName, ...] = get_args(SideName)


@dataclass(frozen=True, slots=True)
class Accuracy:
    """How sure the box of an object is: see the fields of `TrackedObject` with these names."""

    size_sigma_m: tuple[float, ...]
    center_sigma_m: tuple[float, ...]
    sides_seen: tuple[SideName, ...]


def write_classes(connection: sqlite3.Connection, classes: Mapping[int, Sequence[tuple[str, float]]]) -> None:
    """Write the detected classes of objects, by label, within the caller's transaction."""
    for label, seen in classes.items():
        if seen:
            _replace(connection, KEY, label, [f"{rounded(score, LENGTH)} {name[:LONGEST]}" for name, score in seen])


def _replace(connection: sqlite3.Connection, key: str, label: int, values: Sequence[str]) -> None:
    connection.execute("DELETE FROM scene WHERE key GLOB ?", (f"{key}/{label}/*",))
    rows = [(f"{key}/{label}/{place}", value) for place, value in enumerate(values[:KEPT])]
    connection.executemany("INSERT INTO scene VALUES (?, ?)", rows)


def write_kinds(connection: sqlite3.Connection, kinds: Mapping[int, str | None]) -> None:
    """Write the kinds of objects without usable depth, by label; None removes an entry."""
    for label, kind in kinds.items():
        _replace(connection, KIND, label, [] if kind is None else [kind])


def read_kinds(connection: sqlite3.Connection) -> dict[int, str]:
    """Return the kinds of objects without usable depth, by label.

    Raises
    ------
    DamagedError
        A row is invalid.
    """
    columns = ("scene.key", "scene.value")
    return {
        _label_of(key, value): value
        for key, value in read_rows(connection, columns, "scene WHERE key GLOB ?", [f"{KIND}/*"])
    }


def write_accuracy(connection: sqlite3.Connection, accuracy: Mapping[int, Accuracy]) -> None:
    """Write how sure the boxes of objects are, by label."""
    for label, one in accuracy.items():
        values = [*one.size_sigma_m, *one.center_sigma_m]
        _replace(connection, ACCURACY, label, [" ".join([*(str(rounded(v, LENGTH)) for v in values), *one.sides_seen])])


def read_accuracy(connection: sqlite3.Connection) -> dict[int, Accuracy]:
    """Return how sure the boxes of objects are, by label; scenes of an older version do not say it.

    Raises
    ------
    DamagedError
        A row is invalid.
    """
    found = {}
    columns = ("scene.key", "scene.value")
    for key, value in read_rows(connection, columns, "scene WHERE key GLOB ?", [f"{ACCURACY}/*"]):
        words = value.split(" ")
        try:
            seen = tuple(name for name in SIDE_NAMES if name in words)
            numbers = [float(word) for word in words if word not in SIDE_NAMES]
            # Of an object without depth only the size is known.
            if len(numbers) not in (3, 6) or not all(0.0 <= one < math.inf for one in numbers):
                raise ValueError
            found[int(key.split("/")[1])] = Accuracy(tuple(numbers[:3]), tuple(numbers[3:]), seen)
        except (ValueError, IndexError):
            raise DamagedError(f"the accuracy of an object is damaged: '{key}' is '{value}'") from None
    return found


def _label_of(key: str, value: str) -> int:
    _, _, rest = key.partition("/")
    label, _, _ = rest.partition("/")
    if value not in KINDS or not label.isdecimal():
        raise DamagedError(f"the kind of an object is damaged: '{key}' is '{value}'")
    return int(label)


def read_min_probability(rows: Iterable[Row]) -> float:
    """Return the probability that present objects have at least; 0 without a row, in a scene of an older version.

    Raises
    ------
    DamagedError
        The row is invalid.
    """
    for (value,) in rows:
        try:
            return min(max(float(value), 0.0), 1.0)
        except ValueError:
            raise DamagedError(f"the minimum probability of objects is damaged: it is '{value}'") from None
    return 0.0


def read_classes(rows: Iterable[Row]) -> dict[int, list[tuple[str, float]]]:
    """Return classes with their probabilities, the most likely first, by label.

    Parameters
    ----------
    rows : iterable of (str, str)
        Key and value, sorted by key.

    Raises
    ------
    DamagedError
        A row is invalid.
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
