"""Objects that left during a run and did not come back: the map no longer has them, but the rows of the run do."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence

import numpy as np

from cuboid.ground.core.results import TrackedObject
from cuboid.results.files.rows import EventRow, TrackRow


def gone_labels(events: Iterable[EventRow]) -> set[int]:
    """Return the labels whose last event is that their place is empty."""
    last = {one.label: one.event for one in events}
    return {label for label, event in last.items() if event == "gone"}


def gone_objects(
    events: Iterable[EventRow], tracks: Sequence[TrackRow], present: Collection[int], names: Mapping[int, str]
) -> list[TrackedObject]:
    """Return the objects that are gone, by label, as their last rows have them.

    Parameters
    ----------
    events : iterable of EventRow
        In order.
    tracks : sequence of TrackRow
        By frame.
    present : collection of int
        Labels of the present objects, and labels that were merged into them.
    names : mapping of int to str
        Names of gone objects.
    """
    found = []
    for label in sorted(gone_labels(events).difference(present)):
        rows = [row for row in tracks if row.label == label]
        if rows:
            last, likely = rows[-1], rows[-1].probability or 0.0
            frames = rows[0].frame, last.frame, len({row.frame for row in rows})
            unknown = np.full(3, np.nan)  # the color is in the map alone
            one = TrackedObject(label, last.box, likely, 0.0, *frames, 0, unknown, None, name=names.get(label))
            found.append(one)
    return found
