"""Which way is up: a vote of the flat areas seen so far."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from cuboid.frame import Float64Array
from cuboid.surfaces.cells import LEAST_CELLS, Cells
from cuboid.tolerances import ARM_LENGTH_M, DRIFT_RAD, FACE_M2, LEAST_READINGS, LITTLE, MOST, SOME

# Normals within this of each other are one direction; a surface is level whose normal is within it of up.
SAME_COS = float(np.cos(np.radians(12.0)))
# Directions nearer to one of more area than to what stands upright on it are its noise.
NOISE_COS = math.sqrt(MOST)
# Hands and robots turn cameras about the vertical: where two of the camera's axes lose a little of their length on
# average, and the third one far less, that one is as likely up as a level surface that is half seen as such.
FIXED_LIKELY = MOST
# A surface that only an odd camera would take for level is a wall sooner than a table, unless it is within arm's reach,
# or the camera, fixed to something, has not moved beyond drift in so many votes.
STILL_VOTES = LEAST_READINGS
# Another direction becomes up when it is so many times as likely.
OVERTAKE = 2.0
# How likely a flat area is level that a camera held upright would not take for level: most cameras are held upright.
ODD = LITTLE
# What is known of planes, and of up once it is known, is found anew every so many frames.
REFRESH_FRAMES = 8


def _upright(normals_camera_y: Float64Array) -> Float64Array:
    """Return how likely a surface is level by the image-up part of its normal, `ODD`..1.

    Seen by a camera that is held upright, a table's normal points up in the image, a wall's sideways or, when the
    camera looks down, downwards. A camera that looks straight down, is rolled by a quarter turn or lies on its back
    sees level surfaces as `ODD` ones: these are up where nothing else is.
    """
    up = -normals_camera_y
    return np.clip((up - LITTLE) / (MOST - LITTLE), ODD, 1.0)


class UpVote:
    """Collects directions in which flat areas face, weighted by area and by how upright they look."""

    def __init__(self) -> None:
        self._directions: Float64Array = np.zeros((0, 3))
        self._area_m2: Float64Array = np.zeros(0)
        self._upright_m2: Float64Array = np.zeros(0)
        self._volume_m3: Float64Array = np.zeros(0)
        self._first: Float64Array | None = None
        self._moved_m = 0.0
        self._axes: Float64Array = np.zeros((3, 3))
        self._up: Float64Array | None = None
        self._frames = self._votes = 0
        self.changed = False

    @property
    def image_up(self) -> Float64Array:
        """The up of the images so far, (3,) in the world: what is left where nothing else tells."""
        norm = float(np.linalg.norm(self._axes[:, 1]))
        return np.asarray(-self._axes[:, 1] / norm if norm > 0 else np.array([0.0, 0.0, 1.0]))

    def is_due(self) -> bool:
        """Count a frame, and tell whether its vote is asked for."""
        self._frames += 1
        return self._up is None or self._frames % REFRESH_FRAMES == 0

    def update(self, cells: Cells, T_world_camera: Float64Array) -> Float64Array | None:
        """Take in a frame's cells; return up (3,) in the world, or None while unknown.

        `changed` tells whether up is not what it was before.
        """
        self.changed = False
        self._axes += T_world_camera[:3, :3]
        self._votes += 1
        self._first = T_world_camera[:3, 3].copy() if self._first is None else self._first
        self._moved_m = max(self._moved_m, float(np.linalg.norm(T_world_camera[:3, 3] - self._first)))
        self._collect(cells, T_world_camera)
        directions, likely, known = self._likely()
        if len(likely) == 0:
            return self._up
        best = int(np.argmax(likely))
        if self._up is None:
            if known[best]:
                self._up = directions[best].copy()
            return self._up
        current = directions @ self._up > SAME_COS
        held = float(likely[current].max()) if current.any() else 0.0
        if not current[best] and known[best] and likely[best] > OVERTAKE * held:
            self._up, self.changed = directions[best].copy(), True
        return self._up

    def _likely(self) -> tuple[Float64Array, Float64Array, npt.NDArray[np.bool_]]:
        """Return the directions (N, 3) that may be up, how likely each is, and whether enough is known of it."""
        alike = self._directions @ self._directions.T > NOISE_COS
        mode = ~(alike & (self._area_m2[None] > self._area_m2[:, None])).any(1)
        directions, area_m2 = self._directions[mode], self._area_m2[mode]
        likely = self._upright_m2[mode] / area_m2 * -np.expm1(-area_m2 / FACE_M2)
        distance_m = self._volume_m3[mode] / area_m2
        still = (self._moved_m < DRIFT_RAD * distance_m) & (self._votes >= STILL_VOTES)
        odd = self._upright_m2[mode] < 2.0 * ODD * area_m2
        known = (area_m2 >= FACE_M2) & (~odd | (distance_m < ARM_LENGTH_M) | still)
        lost = 1.0 - np.linalg.norm(self._axes, axis=0) / self._votes
        axis = int(np.argmin(lost))
        turned = float(np.delete(lost, axis).min())
        if axis > 0 and turned >= LITTLE and lost[axis] <= SOME * turned:
            # The image's up, or, where the camera turns about its own axis, back along its sight.
            fixed = -self._axes[:, axis] / np.linalg.norm(self._axes[:, axis])
            if len(directions) == 0 or not (directions @ fixed > SAME_COS).any():
                return np.vstack([directions, fixed]), np.append(likely, FIXED_LIKELY), np.append(known, True)
            likely = np.where(directions @ fixed > SAME_COS, np.maximum(likely, FIXED_LIKELY), likely)
        return directions, likely, known

    def _collect(self, cells: Cells, T_world_camera: Float64Array) -> None:
        left = np.ones(len(cells.places), dtype=bool)
        upright = _upright(cells.normal @ T_world_camera[:3, 1])
        while len(members := np.flatnonzero(left)) >= LEAST_CELLS:
            normals, area = cells.normal[members], cells.area_m2[members]
            gain = (normals @ normals.T > SAME_COS) @ area
            if gain.max() < LITTLE * FACE_M2:
                return
            near = normals @ normals[int(np.argmax(gain))] > SAME_COS
            w = area[near]
            left[members[near]] = False
            mean = w @ normals[near]
            # No frame counts for more than a square metre: a near wall does not outvote a table seen for long.
            total = min(1.0, float(w.sum()))
            far = np.linalg.norm(cells.center[members[near]] - T_world_camera[:3, 3], axis=1)
            share = total / float(w.sum())
            self._add(
                mean / np.linalg.norm(mean), total, share * float(w @ upright[members[near]]), share * float(w @ far)
            )

    def _add(self, direction: Float64Array, area_m2: float, upright_m2: float, volume_m3: float) -> None:
        if len(self._directions):
            likeness = self._directions @ direction
            k = int(np.argmax(likeness))
            if likeness[k] > SAME_COS:
                mean = self._directions[k] * self._area_m2[k] + direction * area_m2
                self._directions[k] = mean / np.linalg.norm(mean)
                self._area_m2[k] += area_m2
                self._upright_m2[k] += upright_m2
                self._volume_m3[k] += volume_m3
                return
        self._directions = np.vstack([self._directions, direction])
        self._area_m2, self._upright_m2 = np.append(self._area_m2, area_m2), np.append(self._upright_m2, upright_m2)
        self._volume_m3 = np.append(self._volume_m3, volume_m3)
