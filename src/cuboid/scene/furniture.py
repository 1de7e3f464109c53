"""The furniture of a scene, as it was committed last."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from cuboid.core.results import MapPoints, TrackedObject
from cuboid.outputs.object_table import ObjectTable
from cuboid.tracking.posed_tracker import PosedTracker


def known_furniture(tracker: PosedTracker, points: MapPoints) -> ObjectTable:
    """Return the furniture that has a label; frames are those of the scene, planes in the order of their identities.

    Parameters
    ----------
    tracker : PosedTracker
        Of the scene.
    points : MapPoints
        Its global point map.
    """
    own = tracker.plane_identities
    place = {identity: k for k, identity in enumerate(sorted(own))}
    return ObjectTable(
        replace(
            piece,
            plane=None if piece.plane is None else place[own[piece.plane]],
            planes=tuple(sorted(place[own[k]] for k in piece.planes)),
        )
        for piece in tracker.find_furniture(points, labelled=True)
    )


def of_recording(furniture: Iterable[TrackedObject], first_frame: int) -> ObjectTable:
    """Return the furniture that was seen from a frame of the scene on, with frames counted from that one.

    The scene counts the frames of all recordings together: in how many of this one a piece was seen is bounded by the
    frames in between.
    """
    found = []
    for piece in furniture:
        begun, ended = max(piece.first_frame - first_frame, 0), piece.last_frame - first_frame
        if ended >= 0:
            seen = min(piece.frames_seen, ended - begun + 1)
            found.append(replace(piece, first_frame=begun, last_frame=ended, frames_seen=seen))
    return ObjectTable(found)
