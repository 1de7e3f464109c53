"""Planes that were not seen but made."""

from __future__ import annotations

import numpy as np

from cuboid.method.surfaces.plane import Plane


def level(index: int, z: float, *rectangles: tuple[float, float, float, float]) -> Plane:
    """A level plane of rectangles: x0, y0, x1, y1 in metres."""
    points = np.concatenate(
        [
            np.stack(np.meshgrid(np.arange(x0, x1, 0.05), np.arange(y0, y1, 0.05)), -1).reshape(-1, 2)
            for x0, y0, x1, y1 in rectangles
        ]
    )
    points = np.column_stack([points + 0.025, np.full(len(points), z)])
    plane = Plane(index, index, in_use=True)
    plane.add(points, np.ones(len(points)))
    plane.fit()
    plane.plan.begin(points, np.full(len(points), 0.0001))
    return plane
