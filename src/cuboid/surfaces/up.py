"""Which way is up: the direction of the flat areas that things stand on, whichever way the camera is held."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from cuboid.core.frame import Float64Array
from cuboid.core.state import Record
from cuboid.core.tolerances import MIN_READINGS
from cuboid.surfaces.standing import ENOUGH, SAME_COS, FlatAreas

# A direction nearer than this to another is its noise: the next real one is at right angles.
NOISE_COS = math.sqrt(0.5)
# Up stays known while its evidence is at least this fraction of what makes it known.
HELD_FRACTION = 0.5
# While nothing is seen to stand, up is a direction within 60 degrees of the images' up, of flat areas of this many
# square metres in all: faces of objects are smaller.
LEVEL_IN_IMAGES_COS, MIN_LEVEL_M2 = 0.5, 0.2
# Another direction becomes up when its likelihood is larger by this ratio.
MIN_LIKELIHOOD_RATIO = 2.0
# Well-known planes, and a known up, are updated once in this many frames.
REFRESH_FRAMES = 8


@dataclass(slots=True, eq=False)
class UpVote(Record):
    """Collects the directions of flat areas, with the evidence that objects stand on them.

    Attributes
    ----------
    seen : (N, 5) float64
        A row per direction: unit vector (3), area, evidence.
    axes : (3, 3) float64
        Sum of the rotations of the cameras.
    measured : (3,) float64
        Sum of the measured up directions.
    up : (3,) float64 or None
        In the world.
    frames : int
        Frames so far.
    votes : int
        Number of frames that voted.
    changed : bool
        Whether the last vote has changed `up`.
    """

    seen: Float64Array = field(default_factory=lambda: np.zeros((0, 5)))
    axes: Float64Array = field(default_factory=lambda: np.zeros((3, 3)))
    measured: Float64Array = field(default_factory=lambda: np.zeros(3))
    up: Float64Array | None = None
    frames: int = 0
    votes: int = 0
    changed: bool = False

    @property
    def image_up(self) -> Float64Array:
        """The up of the images so far, (3,) in the world: the fallback without other evidence."""
        norm = float(np.linalg.norm(self.axes[:, 1]))
        return np.asarray(-self.axes[:, 1] / norm if norm > 0 else np.array([0.0, 0.0, 1.0]))

    def is_due(self) -> bool:
        """Count a frame, and tell whether its vote is asked for."""
        self.frames += 1
        return not self._is_sure() or self.frames % REFRESH_FRAMES == 0

    def update(
        self, areas: FlatAreas, T_world_camera: Float64Array, up_camera: Float64Array | None = None
    ) -> Float64Array | None:
        """Take in a frame's flat areas; return up (3,) in the world, or None while unknown.

        `changed` is true where up differs from before.

        Parameters
        ----------
        areas : FlatAreas
        T_world_camera : (4, 4) float64
        up_camera : (3,) float64 or None
            Unit vector away from the earth's pull in the camera, where it was measured: no surface says more.
        """
        self.changed = False
        self.axes += T_world_camera[:3, :3]
        self.votes += 1
        if up_camera is not None:
            self.measured += T_world_camera[:3, :3] @ up_camera
        normals = areas.normal @ T_world_camera[:3, :3].T
        for normal, area_m2, evidence in zip(normals, areas.area_m2, areas.evidence, strict=True):
            # No area counts for more than a square metre a frame: a near wall is no surer than a table.
            self._add(np.array([*normal, min(1.0, area_m2), evidence]))
        best = self._best()
        if self.up is not None and (best is None or best @ self.up <= SAME_COS):
            self.changed = True
        if best is None or self.up is None or self.changed:
            self.up = None if best is None else best.copy()
        return self.up

    def _is_sure(self) -> bool:
        """Tell whether up is so well known that a few frames will not change it."""
        if self.up is None or self.measured.any():
            return self.up is not None
        likely, own = self._likelihood(), self.seen[:, :3] @ self.up > NOISE_COS
        clear = likely[own].max(initial=0.0) >= MIN_LIKELIHOOD_RATIO * likely[~own].max(initial=0.0)
        return bool(self.votes >= MIN_READINGS and clear and self._share(own) >= ENOUGH)

    def _share(self, directions: npt.NDArray[np.bool_]) -> float:
        """Return the most evidence of some directions (N,), in the mean of all frames."""
        return float(self.seen[directions, 4].max(initial=0.0)) / max(1, self.votes)

    def _best(self) -> Float64Array | None:
        """Return the direction (3,) that up should be now; None while it is not known.

        In that direction some of what lies on no flat area stands, in the mean of all frames; once it is half of that,
        up is not known any more. Level areas in the images count as just enough evidence for the images' up: a shelf's
        side stands off its back, as a thing stands on a table.
        """
        if (norm := float(np.linalg.norm(self.measured))) > 0.0:
            return self._level(self.measured / norm)
        likely = self._likelihood()
        own = np.zeros(len(likely), bool) if self.up is None else self.seen[:, :3] @ self.up > NOISE_COS
        known = self.up is not None and self._share(own) >= HELD_FRACTION * ENOUGH
        level = self._level_in_images()
        if known:
            held = likely[own].max(initial=0.0)
        else:
            held = 0.0 if level is None else ENOUGH * self.votes * float(self._constancy(level))
        enough = self.seen[:, 4] >= ENOUGH * self.votes
        best = int(np.argmax(likely * enough)) if enough.any() else -1
        if best >= 0 and not own[best] and likely[best] > MIN_LIKELIHOOD_RATIO * held:
            return np.asarray(self.seen[best, :3])
        return self.up if known else level

    def _level_in_images(self) -> Float64Array | None:
        """Return the direction (3,) of most flat area that the images show from above; None where there is none.

        It holds while nothing is seen to stand anywhere. Faces of things are smaller than a fifth of a square metre.
        """
        area = self.seen[:, 3] * (
            (self.seen[:, :3] @ self.image_up > LEVEL_IN_IMAGES_COS) & (self.seen[:, 3] >= MIN_LEVEL_M2)
        )
        return np.asarray(self.seen[int(np.argmax(area)), :3]) if area.any() else None

    def _likelihood(self) -> Float64Array:
        """Return how likely each direction (N,) is up: by what stands on its areas, and by how the camera turns.

        A person or a robot turns a camera about the vertical more than about any other axis: up is the direction that
        changes least in the camera. A camera that does not turn gives no such evidence.
        """
        return np.asarray(self.seen[:, 4] * self._constancy(self.seen[:, :3]))

    def _constancy(self, directions: Float64Array) -> Float64Array:
        """Return how constant each direction (..., 3) stays in the camera while it turns, 0..1; up stays constant."""
        return np.asarray((np.linalg.norm(directions @ self.axes, axis=-1) / max(1, self.votes)) ** 4)

    def _level(self, measured: Float64Array) -> Float64Array:
        """Return what was measured as up (3,); a level surface of a square metre in all says it more exactly."""
        near = self.seen[(self.seen[:, :3] @ measured > SAME_COS) & (self.seen[:, 3] >= 1.0)]
        return np.asarray(near[np.argmax(near[:, 3]), :3] if len(near) else measured)

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
