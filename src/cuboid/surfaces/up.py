"""Which way is up: a vote of the flat areas seen so far."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from cuboid.frame import Float64Array
from cuboid.state import Record
from cuboid.surfaces.cells import MIN_CELLS, Cells
from cuboid.tolerances import ARM_LENGTH_M, DRIFT_RAD, LITTLE, MIN_FRAMES, MIN_READINGS, MOST, SOME

# A flat face of a thing is smaller than this, square metres; one of a room, or of furniture, is larger.
FACE_M2 = 0.2
# Normals within this of each other are one direction; a surface is level whose normal is within it of up.
SAME_COS = float(np.cos(np.radians(12.0)))
# Directions nearer to one of more area than to what stands upright on it are its noise.
NOISE_COS = math.sqrt(MOST)
# Hands and robots turn cameras about the vertical: where two of the camera's axes lose a little of their length on
# average, and the third one far less, that one is as likely up as a level surface that is half seen as such.
FIXED_LIKELY = MOST
# A surface that only an odd camera would take for level is a wall sooner than a table, unless it is within arm's reach,
# or the camera, fixed to something, has not moved beyond drift in so many votes.
STILL_VOTES = MIN_READINGS
# Another direction becomes up when its likelihood is larger by this ratio.
MIN_LIKELIHOOD_RATIO = 2.0
# How likely a flat area is level that a camera held as this one is would not take for level.
ODD = LITTLE
# How a camera may be held, turned about its sight: of each the axes of the upright camera in it, (3, 3, 3). One that
# hangs upside down sees a table as an upright one that looks down sees the wall behind it: this is the likelier one.
TURNS = np.array([[[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]] for c, s in ((1, 0), (0, 1), (0, -1))], float)
# What is known of planes, and of up once it is known, is updated every so many frames.
REFRESH_FRAMES = 8


def _level_likelihood(normals_camera: Float64Array) -> Float64Array:
    """Return how likely surfaces (N, 3) are level by the image-up parts of their normals, `ODD`..1, (N, 3) by turn.

    Seen by a camera that is held upright, a table's normal points up in the image, a wall's sideways or, when the
    camera looks down, downwards. A camera that looks straight down sees level surfaces as `ODD` ones: these are up
    where nothing else is.
    """
    up = -normals_camera @ TURNS[:, :, 1].T
    return np.asarray(np.clip((up - LITTLE) / (MOST - LITTLE), ODD, 1.0))


@dataclass(slots=True, eq=False)
class UpVote(Record):
    """Collects directions in which flat areas face, weighted by area and by how upright they look.

    Attributes
    ----------
    seen : (N, 8) float64
        A row a direction: unit vector (3), area, area times distance, and by turn of the area how much looks level.
    facing : (3,) float64
        Sum of the normals in the camera frame.
    first_place : (3,) float64 or None
        Where the first camera was.
    moved_m : float
        The farthest that cameras were from there.
    axes : (3, 3) float64
        Sum of the rotations of the cameras.
    measured : (3,) float64
        Sum of the directions that were measured as up.
    up : (3,) float64 or None
        In the world.
    frames : int
        Frames so far.
    votes : int
        Those of them that voted.
    changed : bool
        Whether the last vote has changed `up`.
    """

    seen: Float64Array = field(default_factory=lambda: np.zeros((0, 5 + len(TURNS))))
    facing: Float64Array = field(default_factory=lambda: np.zeros(3))
    first_place: Float64Array | None = None
    moved_m: float = 0.0
    axes: Float64Array = field(default_factory=lambda: np.zeros((3, 3)))
    measured: Float64Array = field(default_factory=lambda: np.zeros(3))
    up: Float64Array | None = None
    frames: int = 0
    votes: int = 0
    changed: bool = False

    @property
    def image_up(self) -> Float64Array:
        """The up of the images so far, (3,) in the world: what is left where nothing else tells."""
        down = self.axes @ TURNS[self._turn(), :, 1]
        norm = float(np.linalg.norm(down))
        return np.asarray(-down / norm if norm > 0 else np.array([0.0, 0.0, 1.0]))

    def _turn(self) -> int:
        """Return in which quarter turn the camera is held: all that it sees faces up in the image, on average.

        Tables and floors are seen from above, walls from either side. Unless another turn is plain, it is none.
        """
        up = -self.facing @ TURNS[:, :, 1].T / max(1e-9, float(self.seen[:, 3].sum()))
        best = int(np.argmax(up))
        plain = self.votes >= MIN_FRAMES and up[best] >= max(SOME, MIN_LIKELIHOOD_RATIO * up[0])
        return best if plain else 0

    def is_due(self) -> bool:
        """Count a frame, and tell whether its vote is asked for."""
        self.frames += 1
        return self.up is None or self.frames % REFRESH_FRAMES == 0

    def update(
        self, cells: Cells, T_world_camera: Float64Array, up_camera: Float64Array | None = None
    ) -> Float64Array | None:
        """Take in a frame's cells; return up (3,) in the world, or None while unknown.

        `changed` tells whether up is not what it was before.

        Parameters
        ----------
        cells : Cells
        T_world_camera : (4, 4) float64
        up_camera : (3,) float64 or None
            Unit vector away from the earth's pull in the camera, where it was measured: no surface says more.
        """
        self.changed = False
        self.axes += T_world_camera[:3, :3]
        self.votes += 1
        self.first_place = T_world_camera[:3, 3].copy() if self.first_place is None else self.first_place
        self.moved_m = max(self.moved_m, float(np.linalg.norm(T_world_camera[:3, 3] - self.first_place)))
        self._collect(cells, T_world_camera)
        if up_camera is not None:
            self.measured += T_world_camera[:3, :3] @ up_camera
        directions, likely, known = self._likely()
        if len(likely) == 0:
            return self.up
        best = int(np.argmax(likely))
        if self.up is None:
            if known[best]:
                self.up = directions[best].copy()
            return self.up
        current = directions @ self.up > SAME_COS
        held = float(likely[current].max()) if current.any() else 0.0
        if not current[best] and known[best] and likely[best] > MIN_LIKELIHOOD_RATIO * held:
            self.up, self.changed = directions[best].copy(), True
        return self.up

    def _likely(self) -> tuple[Float64Array, Float64Array, npt.NDArray[np.bool_]]:
        """Return the directions (N, 3) that may be up, how likely each is, and whether enough is known of it."""
        if (norm := float(np.linalg.norm(self.measured))) > 0.0:
            return self._level(self.measured / norm)
        seen = self.seen
        directions, area_m2 = seen[:, :3], seen[:, 3]
        mode = ~((directions @ directions.T > NOISE_COS) & (area_m2[None] > area_m2[:, None])).any(1)
        turn = self._turn()
        directions, area_m2, upright_m2 = directions[mode], area_m2[mode], seen[mode, 5 + turn]
        likely = upright_m2 / area_m2 * -np.expm1(-area_m2 / FACE_M2)
        distance_m = seen[mode, 4] / area_m2
        still = (self.moved_m < DRIFT_RAD * distance_m) & (self.votes >= STILL_VOTES)
        odd = upright_m2 < 2.0 * ODD * area_m2
        known = (area_m2 >= FACE_M2) & (~odd | (distance_m < ARM_LENGTH_M) | still)
        axes = self.axes @ TURNS[turn]
        lost = 1.0 - np.linalg.norm(axes, axis=0) / self.votes
        axis = int(np.argmin(lost))
        turned = float(np.delete(lost, axis).min())
        if axis > 0 and turned >= LITTLE and lost[axis] <= SOME * turned:
            # The image's up, or, where the camera turns about its own axis, back along its sight.
            fixed = -axes[:, axis] / np.linalg.norm(axes[:, axis])
            if len(directions) == 0 or not (directions @ fixed > SAME_COS).any():
                return np.vstack([directions, fixed]), np.append(likely, FIXED_LIKELY), np.append(known, True)
            likely = np.where(directions @ fixed > SAME_COS, np.maximum(likely, FIXED_LIKELY), likely)
        return directions, likely, known

    def _level(self, measured: Float64Array) -> tuple[Float64Array, Float64Array, npt.NDArray[np.bool_]]:
        """Return as `_likely` does what was measured as up; a level surface of some area says it more exactly."""
        near = self.seen[(self.seen[:, :3] @ measured > SAME_COS) & (self.seen[:, 3] >= FACE_M2)]
        best = near[np.argmax(near[:, 3]), :3] if len(near) else measured
        return best[None], np.ones(1), np.ones(1, dtype=bool)

    def _collect(self, cells: Cells, T_world_camera: Float64Array) -> None:
        left = np.ones(len(cells.places), dtype=bool)
        upright = _level_likelihood(cells.normal @ T_world_camera[:3, :3])
        while len(members := np.flatnonzero(left)) >= MIN_CELLS:
            normals, area = cells.normal[members], cells.area_m2[members]
            gain = (normals @ normals.T > SAME_COS) @ area
            if gain.max() < LITTLE * FACE_M2:
                return
            near = normals @ normals[int(np.argmax(gain))] > SAME_COS
            left[members[near]] = False
            # No frame counts for more than a square metre: a near wall does not outvote a table seen for long.
            w = area[near] / max(1.0, float(area[near].sum()))
            far = np.linalg.norm(cells.center[members[near]] - T_world_camera[:3, 3], axis=1)
            mean = w @ normals[near]
            self.facing += mean @ T_world_camera[:3, :3]
            self._add(np.array([*mean / np.linalg.norm(mean), w.sum(), w @ far, *w @ upright[members[near]]]))

    def _add(self, row: Float64Array) -> None:
        if len(self.seen):
            similarity = self.seen[:, :3] @ row[:3]
            k = int(np.argmax(similarity))
            if similarity[k] > SAME_COS:
                mean = self.seen[k, :3] * self.seen[k, 3] + row[:3] * row[3]
                self.seen[k] += row
                self.seen[k, :3] = mean / np.linalg.norm(mean)
                return
        self.seen = np.vstack([self.seen, row])
