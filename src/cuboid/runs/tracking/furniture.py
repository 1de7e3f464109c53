"""Furniture as entries of the results: its labels last as long as the planes that it bears."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from cuboid.ground.core.results import SUPPORT, MapPoints, TrackedObject
from cuboid.method.relations.furniture import Furniture
from cuboid.method.surfaces.plane import Plane

# Labels of the furniture that bears a plane, by identity of the plane: its label, then younger ones merged into it.
Labels = dict[int, tuple[int, ...]]


def labels_of(
    pieces: Sequence[Sequence[int]], labels_of_plane: Mapping[int, tuple[int, ...]], new_label: Callable[[], int] | None
) -> list[tuple[int, ...]]:
    """Return the labels of pieces of furniture, oldest first: those that their planes had, else a new one.

    Parameters
    ----------
    pieces : sequence of sequence of int
        Identities of the planes that each piece bears.
    labels_of_plane : mapping of int to tuple of int
        Labels by identity of the plane. Of pieces whose planes had the same label, the first one keeps it.
    new_label : callable or None
        Returns a new label; None: a piece whose planes had no label gets none.
    """
    taken: set[int] = set()
    labels_of_pieces = []
    for identities in pieces:
        labels = sorted({label for k in identities for label in labels_of_plane.get(k, ())} - taken)
        if not labels and new_label is not None:
            labels = [new_label()]
        taken.update(labels)
        labels_of_pieces.append(tuple(labels))
    return labels_of_pieces


def furniture_entry(
    piece: Furniture, labels: tuple[int, ...], planes: Sequence[Plane], points: MapPoints
) -> TrackedObject:
    """Return a piece of furniture as an entry of the results.

    Parameters
    ----------
    piece : Furniture
    labels : tuple of int
        Its label, then those that were merged into it.
    planes : sequence of Plane
        The planes that it bears; the frames that saw them count as those that saw it.
    points : MapPoints
        The point map in which it was found.
    """
    return TrackedObject(
        label=labels[0],
        box=piece.box,
        score=0.0,  # the confidence that it is an object
        heat=float(points.heat[piece.points].mean(dtype=np.float64)),
        first_frame=min(plane.first_frame for plane in planes),
        last_frame=max(plane.last_frame for plane in planes),
        frames_seen=max(plane.frames for plane in planes),
        points=len(piece.points),
        mean_color=points.rgb[piece.points].mean(axis=0, dtype=np.float64),
        plane=piece.plane,
        merged_labels=labels[1:],
        kind=SUPPORT,
        planes=piece.planes,
    )
