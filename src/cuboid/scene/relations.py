"""Which relation held from which recording to which: rows of the table `scene`, one a relation and time."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import get_args

from cuboid.core.results import Wall
from cuboid.core.values import RelationKind
from cuboid.outputs.text import LENGTH, rounded
from cuboid.relations import find_relations
from cuboid.scene.answers import PastRelation
from cuboid.scene.validation import DamagedError, Row
from cuboid.tracking.posed_tracker import PosedTracker

# The key of a row is this, label, kind, what it is to, and the first recording; its value the last one and the score.
KEY = "relation"
# The key of the number of the last recording whose relations were noted.
NOTED = "relations"
# Supporting planes have numbers that last, walls have none.
PLANE, WALL = "plane#", "wall"

# Label, kind, and what it is to: a label, `PLANE` with the plane's own number, or `WALL`.
Held = tuple[int, RelationKind, str]


def relations_now(tracker: PosedTracker, walls: Sequence[Wall]) -> dict[Held, float]:
    """Return the relations of all objects of a scene, each with its score.

    Parameters
    ----------
    tracker : PosedTracker
        Of the scene.
    walls : sequence of Wall
        In the scene's world.
    """
    identities, scores = tracker.plane_identities, dict[Held, float]()
    for label, relations in find_relations(tracker.objects, tracker.planes, tracker.up, walls).items():
        for one in relations:
            to = str(one.to)
            if to.startswith("plane:"):
                to = f"{PLANE}{identities[int(to.removeprefix('plane:'))]}"
            elif to.startswith("wall:"):
                to = WALL
            held = (label, one.kind, to)
            scores[held] = max(scores.get(held, 0.0), one.score)
    return scores


def write_relations(connection: sqlite3.Connection, recording: int, scores: Mapping[Held, float]) -> None:
    """Note the relations at the end of a recording, within the caller's transaction.

    A relation that held also when relations were noted last goes on; any other begins.
    """
    noted = connection.execute("SELECT value FROM scene WHERE key = ?", (NOTED,)).fetchone()
    going = {
        one.held: one.key
        for one in _spans(connection.execute("SELECT key, value FROM scene WHERE key GLOB ?", (f"{KEY}/*",)))
        if noted is not None and str(one.last) == noted[0]
    }
    for held, score in scores.items():
        label, kind, to = held
        key = going.get(held, f"{KEY}/{label}/{kind}/{to}/{recording}")
        value = f"{recording} {rounded(score, LENGTH)}"
        connection.execute("INSERT OR REPLACE INTO scene VALUES (?, ?)", (key, value))
    connection.execute("INSERT OR REPLACE INTO scene VALUES (?, ?)", (NOTED, str(recording)))


def read_relations(
    rows: Iterable[Row], labels: Sequence[int], survivor: Mapping[int, int], plane: Mapping[int, int]
) -> list[PastRelation]:
    """Return the relations that an object has or had, by kind and time.

    Parameters
    ----------
    rows : iterable of (str, str)
        Key and value.
    labels : sequence of int
        That of the object, and those that were merged into it.
    survivor : mapping of int to int
        The label that each merged label is now.
    plane : mapping of int to int
        Index of each supporting plane by its own number.

    Raises
    ------
    DamagedError
        A row makes no sense.
    """
    order = get_args(RelationKind)
    found = []
    for one in _spans(rows):
        label, kind, to = one.held
        if label in labels:
            found.append(PastRelation(label, kind, _now(to, survivor, plane), one.first, one.last, one.score))
    return sorted(found, key=lambda one: (order.index(one.kind), one.first_recording, str(one.to)))


def _now(to: str, survivor: Mapping[int, int], plane: Mapping[int, int]) -> int | str:
    """Return what a relation is to as it is called now; a plane that is no longer known is only "plane"."""
    if to == WALL:
        return WALL
    number = int(to.removeprefix(PLANE))
    if not to.startswith(PLANE):
        return survivor.get(number, number)
    return f"plane:{plane[number]}" if number in plane else "plane"


@dataclass(frozen=True, slots=True)
class _Span:
    key: str
    held: Held
    first: int
    last: int
    score: float


def _spans(rows: Iterable[Row]) -> list[_Span]:
    """Return what rows say; DamagedError where one makes no sense."""
    found = []
    for key, value in rows:
        try:
            _, label, kind, to, first = key.split("/")
            last, score = value.split(" ")
            if kind not in get_args(RelationKind) or not (to == WALL or to.removeprefix(PLANE).isdecimal()):
                raise ValueError
            span = _Span(key, (int(label), kind, to), int(first), int(last), min(max(float(score), 0.0), 1.0))
        except ValueError:
            raise DamagedError(f"the relation of an object is damaged: '{key}' is '{value}'") from None
        found.append(span)
    return found
