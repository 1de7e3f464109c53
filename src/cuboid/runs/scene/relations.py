"""Relations and the recordings in which they held: one row per relation and time span."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Mapping, Sequence
from typing import get_args

from cuboid.ground.core.results import Wall
from cuboid.ground.core.values import RelationKind
from cuboid.method.relations import find_relations
from cuboid.results.files.text import LENGTH, rounded
from cuboid.runs.scene.answers import PastRelation
from cuboid.runs.scene.validation import Row
from cuboid.runs.tracking.posed_tracker import PosedTracker

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
    query = "SELECT label, kind, target, first_recording FROM relations WHERE last_recording = ?"
    continued = {tuple(held): first for *held, first in connection.execute(query, (int(noted[0]) if noted else 0,))}
    rows = [
        (*held, continued.get(held, recording), recording, rounded(score, LENGTH)) for held, score in scores.items()
    ]
    connection.executemany("INSERT OR REPLACE INTO relations VALUES (?, ?, ?, ?, ?, ?)", rows)
    connection.execute("INSERT OR REPLACE INTO scene VALUES (?, ?)", (NOTED, str(recording)))


def past_relations(rows: Iterable[Row], survivor: Mapping[int, int], plane: Mapping[int, int]) -> list[PastRelation]:
    """Return the relations of an object in rows of the table `relations`, by kind and time.

    Parameters
    ----------
    rows : iterable of tuple
    survivor : mapping of int to int
        Present label of each merged label.
    plane : mapping of int to int
        Index of each supporting plane, by its persistent number.
    """
    order = get_args(RelationKind)
    found = [PastRelation(label, kind, _now(to, survivor, plane), *rest) for label, kind, to, *rest in rows]
    return sorted(found, key=lambda one: (order.index(one.kind), one.first_recording, str(one.to)))


def _now(to: str, survivor: Mapping[int, int], plane: Mapping[int, int]) -> int | str:
    """Return the present name of a relation's target; a plane that is no longer known is only "plane"."""
    if to == WALL:
        return WALL
    number = int(to.removeprefix(PLANE))
    if not to.startswith(PLANE):
        return survivor.get(number, number)
    return f"plane:{plane[number]}" if number in plane else "plane"
