"""Indicators of failure in a recording's results, without ground truth, so that the worst can be inspected first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.results import TrackedObject
from cuboid.ground.geometry.overlap import intersection_matrix, overlap_min_matrix, pack

# Correct boxes of two objects rarely share this fraction of the smaller box; leaning neighbours overlap by less.
OVERLAPPING = 1.0 / 3.0

# Maximum distance between an object and a surface that it touches, metres: two voxels plus the noise of a plane.
TOUCHING_M = 0.03

# Objects seen in fewer frames were barely confirmed: a label takes about three frames.
BRIEF_FRAMES = 5


def indicators(objects: Sequence[TrackedObject]) -> dict[str, int]:
    """Return the numbers of objects of a map that look wrong.

    Returns
    -------
    dict of str to int
        ``overlapping``: they overlap another one by `OVERLAPPING` or more of the smaller box. ``floating``: in free
        space, no plane supports them and no other object touches them. ``brief``: seen in fewer than `BRIEF_FRAMES`
        frames.
    """
    boxes = pack([item.box for item in objects])
    shared = overlap_min_matrix(boxes, boxes)
    np.fill_diagonal(shared, 0.0)
    touching = _touching(objects, boxes)
    return {
        "overlapping": int((shared.max(axis=1, initial=0.0) >= OVERLAPPING).sum()),
        "floating": sum(item.plane is None and not near for item, near in zip(objects, touching, strict=True)),
        "brief": sum(item.frames_seen < BRIEF_FRAMES for item in objects),
    }


def _touching(objects: Sequence[TrackedObject], boxes: Float64Array) -> list[bool]:
    """Tell for each object whether another one is within `TOUCHING_M` of it."""
    grown = pack([replace(item.box, size=item.box.size + 2 * TOUCHING_M) for item in objects])
    common = intersection_matrix(grown, boxes)
    np.fill_diagonal(common, 0.0)
    return [bool(row.any()) for row in common]
