"""Which way is up: a vote of the flat areas seen so far."""

from __future__ import annotations

import numpy as np

from cuboid.frame import Float64Array
from cuboid.surfaces.cells import Cells

# Normals within this of each other are one direction.
SAME_COS = float(np.cos(np.radians(10.0)))
# Directions followed at a time.
MOST_DIRECTIONS = 8
# Evidence, in square metres times frames, that a direction needs before it is up.
ENOUGH_M2 = 0.2
# Another direction becomes up when it has so many times the evidence.
OVERTAKE = 3.0
# The vote is taken every so many frames once up is known.
EVERY = 5


def _upright_prior(normals_camera_y: Float64Array) -> Float64Array:
    """Weight of a surface by the image-up part of its normal.

    Seen by a camera that is held upright, a table's normal points up in the image, a wall's sideways or, when the
    camera looks down, downwards. A camera that looks straight down sees table and image-up at right angles, so that
    such surfaces keep a small weight: enough when nothing else is seen.
    """
    up = -normals_camera_y
    return np.clip((up - 0.15) / 0.35, 0.01, 1.0)


class UpVote:
    """Collects directions in which flat areas face, weighted by area and by how upright they look."""

    def __init__(self) -> None:
        self._directions: Float64Array = np.zeros((0, 3))
        self._evidence: Float64Array = np.zeros(0)
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
        if len(self._evidence) == 0:
            return self._up
        best = int(np.argmax(self._evidence))
        if self._up is None:
            if self._evidence[best] >= ENOUGH_M2:
                self._up = self._directions[best].copy()
            return self._up
        current = self._directions @ self._up > SAME_COS
        held = float(self._evidence[current].max()) if current.any() else 0.0
        if not current[best] and self._evidence[best] > OVERTAKE * max(held, ENOUGH_M2):
            self._up, self.changed = self._directions[best].copy(), True
        return self._up

    def _collect(self, cells: Cells, T_world_camera: Float64Array) -> None:
        left = np.ones(len(cells.places), dtype=bool)
        weight = cells.area_m2 * _upright_prior(cells.normal @ T_world_camera[:3, 1])
        for _ in range(3):
            members = np.flatnonzero(left)
            if len(members) < 6:
                return
            normals = cells.normal[members]
            gain = (normals @ normals.T > SAME_COS) @ weight[members]
            near = normals @ normals[int(np.argmax(gain))] > SAME_COS
            w = weight[members[near]]
            mean = w @ normals[near]
            left[members[near]] = False
            # No frame counts for more than a square metre: a near wall does not outvote a table seen for long.
            self._add(mean / np.linalg.norm(mean), min(1.0, float(w.sum())))

    def _add(self, direction: Float64Array, evidence: float) -> None:
        if len(self._directions):
            likeness = self._directions @ direction
            k = int(np.argmax(likeness))
            if likeness[k] > SAME_COS:
                total = self._evidence[k] + evidence
                mean = self._directions[k] * self._evidence[k] + direction * evidence
                self._directions[k] = mean / np.linalg.norm(mean)
                self._evidence[k] = total
                return
        self._directions = np.vstack([self._directions, direction])
        self._evidence = np.append(self._evidence, evidence)
        if len(self._evidence) > MOST_DIRECTIONS:
            keep = np.sort(np.argsort(-self._evidence, kind="stable")[:MOST_DIRECTIONS])
            self._directions, self._evidence = self._directions[keep], self._evidence[keep]
