"""The furniture of a scene, as it was committed last, and its names."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Mapping
from dataclasses import replace

from cuboid.ground.core.results import MapPoints, TrackedObject
from cuboid.results.files.object_table import ObjectTable
from cuboid.runs.scene.validation import columns_of, read_rows
from cuboid.runs.tracking.posed_tracker import PosedTracker


def write_name(connection: sqlite3.Connection, label: int, name: str) -> None:
    """Write the name of a piece of furniture, or remove it with an empty name, within the caller's transaction."""
    connection.execute("DELETE FROM furniture WHERE label = ?", (label,))
    if name:
        connection.execute("INSERT INTO furniture VALUES (?, ?)", (label, name))


def read_names(connection: sqlite3.Connection) -> dict[int, str]:
    """Return the names of furniture, by label; raise DamagedError if a row is invalid."""
    return dict(read_rows(connection, columns_of("furniture"), "furniture"))


def named_furniture(furniture: Iterable[TrackedObject], names: Mapping[int, str]) -> ObjectTable:
    """Return furniture with the name of its label, or else of a label that was merged into it."""
    found = []
    for piece in furniture:
        name = next((names[label] for label in (piece.label, *piece.merged_labels) if label in names), None)
        found.append(piece if name is None else piece.with_given_name(name))
    return ObjectTable(found)


def known_furniture(tracker: PosedTracker, points: MapPoints, names: Mapping[int, str]) -> ObjectTable:
    """Return the furniture that has a label; frames are those of the scene, planes in the order of their identities.

    Parameters
    ----------
    tracker : PosedTracker
        Tracker of the scene.
    points : MapPoints
        Its global point map.
    names : mapping of int to str
        Names from `read_names`.
    """
    identities = tracker.plane_identities
    index_of = {identity: k for k, identity in enumerate(sorted(identities))}
    found = (
        replace(
            piece,
            plane=None if piece.plane is None else index_of[identities[piece.plane]],
            planes=tuple(sorted(index_of[identities[k]] for k in piece.planes)),
        )
        for piece in tracker.find_furniture(points, labelled=True)
    )
    return named_furniture(found, names)


def of_recording(furniture: Iterable[TrackedObject], first_frame: int) -> ObjectTable:
    """Return the furniture that was seen from a frame of the scene on, with frames counted from that one.

    The scene counts the frames of all recordings together. The number of frames of this recording that saw a piece is
    not known; it is at most the number of frames between the first and the last of them.
    """
    found = []
    for piece in furniture:
        begun, ended = max(piece.first_frame - first_frame, 0), piece.last_frame - first_frame
        if ended >= 0:
            seen = min(piece.frames_seen, ended - begun + 1)
            found.append(replace(piece, first_frame=begun, last_frame=ended, frames_seen=seen))
    return ObjectTable(found)
