"""Relations and the recordings in which they held: rows of the table `scene`, one per relation and time span."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import get_args

from cuboid.ground.core.results import Wall
from cuboid.ground.core.values import RelationKind
from cuboid.method.relations import find_relations
from cuboid.results.files.text import LENGTH, rounded
from cuboid.runs.scene.answers import PastRelation
from cuboid.runs.scene.validation import DamagedError, Row
from cuboid.runs.tracking.posed_tracker import PosedTracker

# A row's key is KEY, label, kind, target, and the first recording; its value is the last recording and the score.
KEY = "relation"
# Key of the row with the number of the last recording whose relations were noted.
NOTED = "relations"
# Supporting planes have persistent numbers, walls have none.
PLANE, WALL = "plane#", "wall"

# Label, kind, and target: a label, `PLANE` with the plane's persistent number, or `WALL`.
Held = tuple[int, RelationKind, str]


def relations_now(tracker: PosedTracker, walls: Sequence[Wall]) -> dict[Held, float]:
    """Return the relations of all objects of a scene, each with its score.

    Parameters
    ----------
    tracker : PosedTracker
        Tracker of the scene.
    walls : sequence of Wall
        Walls in the scene's world.
    """
    identities, scores = tracker.plane_identities, dict[Held, float]()
    for label, relations in find_relations(tracker.objects, tracker.planes, tracker.up, walls).items():
        for relation in relations:
            to = str(relation.to)
            if to.startswith("plane:"):
                to = f"{PLANE}{identities[int(to.removeprefix('plane:'))]}"
            elif to.startswith("wall:"):
                to = WALL
            held = (label, relation.kind, to)
            scores[held] = max(scores.get(held, 0.0), relation.score)
    return scores


def write_relations(connection: sqlite3.Connection, recording: int, scores: Mapping[Held, float]) -> None:
    """Note the relations at the end of a recording, within the caller's transaction.

    A relation that was also in the previous note is continued; any other one begins.
    """
    noted = connection.execute("SELECT value FROM scene WHERE key = ?", (NOTED,)).fetchone()
    continued = {
        span.held: span.key
        for span in _spans(connection.execute("SELECT key, value FROM scene WHERE key GLOB ?", (f"{KEY}/*",)))
        if noted is not None and str(span.last) == noted[0]
    }
    for held, score in scores.items():
        label, kind, to = held
        key = continued.get(held, f"{KEY}/{label}/{kind}/{to}/{recording}")
        value = f"{recording} {rounded(score, LENGTH)}"
        connection.execute("INSERT OR REPLACE INTO scene VALUES (?, ?)", (key, value))
    connection.execute("INSERT OR REPLACE INTO scene VALUES (?, ?)", (NOTED, str(recording)))


def read_relations(
    rows: Iterable[Row], labels: Sequence[int], survivor: Mapping[int, int], plane: Mapping[int, int]
) -> list[PastRelation]:
    """Return present and past relations of an object, by kind and time.

    Parameters
    ----------
    rows : iterable of (str, str)
        Key and value.
    labels : sequence of int
        Label of the object, and labels that were merged into it.
    survivor : mapping of int to int
        Present label of each merged label.
    plane : mapping of int to int
        Index of each supporting plane, by its persistent number.

    Raises
    ------
    DamagedError
        A row is invalid.
    """
    order = get_args(RelationKind)
    found = []
    for span in _spans(rows):
        label, kind, to = span.held
        if label in labels:
            found.append(PastRelation(label, kind, _now(to, survivor, plane), span.first, span.last, span.score))
    return sorted(found, key=lambda span: (order.index(span.kind), span.first_recording, str(span.to)))


def _now(to: str, survivor: Mapping[int, int], plane: Mapping[int, int]) -> int | str:
    """Return the present name of a relation's target; a plane that is no longer known is only "plane"."""
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
    """Return the time spans of rows; raise DamagedError if a row is invalid."""
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
