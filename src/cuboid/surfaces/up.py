"""Which way is up: a vote of the flat areas seen so far."""

from __future__ import annotations

import numpy as np

from cuboid.frame import Float64Array
from cuboid.surfaces.cells import Cells

# Normals within this of each other are one direction.
SAME_COS = float(np.cos(np.radians(10.0)))
# Directions followed at a time.
MOST_DIRECTIONS = 8
# A direction counts in a frame that shows so much flat area of it, square metres: less is the side of a thing.
LEAST_AREA_M2 = 0.02
# Area, over all frames, with which a direction is as good as sure to be of the room, square metres.
ENOUGH_M2 = 0.2
# Another direction becomes up when it is so many times as likely.
OVERTAKE = 2.0
# How likely a flat area is level that a camera held upright would not take for level: most cameras are held upright.
ODD = 0.05
# The vote is taken every so many frames once up is known.
EVERY = 5


def _upright(normals_camera_y: Float64Array) -> Float64Array:
    """Return how likely a surface is level by the image-up part of its normal, `ODD`..1.

    Seen by a camera that is held upright, a table's normal points up in the image, a wall's sideways or, when the
    camera looks down, downwards. A camera that looks straight down, is rolled by a quarter turn or lies on its back
    sees level surfaces as `ODD` ones: these are up where nothing else is.
    """
    up = -normals_camera_y
    return np.clip((up - 0.15) / 0.35, ODD, 1.0)


class UpVote:
    """Collects directions in which flat areas face, weighted by area and by how upright they look."""

    def __init__(self) -> None:
        self._directions: Float64Array = np.zeros((0, 3))
        self._area_m2: Float64Array = np.zeros(0)
        self._upright_m2: Float64Array = np.zeros(0)
        self._up: Float64Array | None = None
        self._frames = 0
        self.changed = False

    def update(self, cells: Cells, T_world_camera: Float64Array) -> Float64Array | None:
        """Take in a frame's cells; return up (3,) in the world, or None while unknown.

        `changed` tells whether up is not what it was before.
        """
        self.changed = False
        self._frames += 1
        if self._up is not None and self._frames % EVERY:
            return self._up
        self._collect(cells, T_world_camera)
        if len(self._area_m2) == 0:
            return self._up
        likely = self._upright_m2 / self._area_m2 * -np.expm1(-self._area_m2 / ENOUGH_M2)
        best = int(np.argmax(likely))
        if self._up is None:
            if self._area_m2[best] >= ENOUGH_M2:
                self._up = self._directions[best].copy()
            return self._up
        current = self._directions @ self._up > SAME_COS
        held = float(likely[current].max()) if current.any() else 0.0
        if not current[best] and likely[best] > OVERTAKE * held:
            self._up, self.changed = self._directions[best].copy(), True
        return self._up

    def _collect(self, cells: Cells, T_world_camera: Float64Array) -> None:
        left = np.ones(len(cells.places), dtype=bool)
        upright = _upright(cells.normal @ T_world_camera[:3, 1])
        for _ in range(MOST_DIRECTIONS):
            members = np.flatnonzero(left)
            if len(members) < 6:
                return
            normals, area = cells.normal[members], cells.area_m2[members]
            gain = (normals @ normals.T > SAME_COS) @ area
            near = normals @ normals[int(np.argmax(gain))] > SAME_COS
            w = area[near]
            left[members[near]] = False
            if w.sum() < LEAST_AREA_M2:
                continue
            mean = w @ normals[near]
            # No frame counts for more than a square metre: a near wall does not outvote a table seen for long.
            total = min(1.0, float(w.sum()))
            self._add(mean / np.linalg.norm(mean), total, total * float(w @ upright[members[near]]) / float(w.sum()))

    def _add(self, direction: Float64Array, area_m2: float, upright_m2: float) -> None:
        if len(self._directions):
            likeness = self._directions @ direction
            k = int(np.argmax(likeness))
            if likeness[k] > SAME_COS:
                mean = self._directions[k] * self._area_m2[k] + direction * area_m2
                self._directions[k] = mean / np.linalg.norm(mean)
                self._area_m2[k] += area_m2
                self._upright_m2[k] += upright_m2
                return
        self._directions = np.vstack([self._directions, direction])
        self._area_m2, self._upright_m2 = np.append(self._area_m2, area_m2), np.append(self._upright_m2, upright_m2)
        if len(self._area_m2) > MOST_DIRECTIONS:
            keep = np.sort(np.argsort(-self._upright_m2, kind="stable")[:MOST_DIRECTIONS])
            self._directions = self._directions[keep]
            self._area_m2, self._upright_m2 = self._area_m2[keep], self._upright_m2[keep]
