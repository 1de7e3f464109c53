"""The up direction: the normal of the flat areas on which objects stand, whatever the orientation of the camera."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.state import Record
from cuboid.method.surfaces.standing import ENOUGH_FRACTION, SAME_COS, FlatAreas

# A direction nearer than 45 degrees to another one is a noisy version of it: real ones are at right angles (cosine).
NOISE_COS = math.sqrt(0.5)
# Up stays known while its evidence is at least this fraction of the evidence that makes it known.
HELD_FRACTION = 0.5
# Without evidence of standing objects, up is a direction within 60 degrees of the images' up that flat areas of this
# many square metres in all support: faces of objects are smaller.
LEVEL_IN_IMAGES_COS, MIN_LEVEL_M2 = 0.5, 0.2
# Another direction becomes up if its likelihood is larger by this ratio.
MIN_LIKELIHOOD_RATIO = 2.0
# A frame votes when the frames since the last vote have the first weight together, that of one frame from a new
# viewpoint; once up is sure, the second one: a search for flat areas takes as long as all other steps of the planes.
VOTE_WEIGHT, SURE_WEIGHT = 1.0, 8.0
# Up can be sure after votes of this weight: fewer may show one object alone.
MIN_VOTES = 8.0


@dataclass(slots=True, eq=False)
class UpVote(Record):
    """Collects the normals of flat areas, with the evidence that objects stand on them.

    A vote has the weight of all frames since the last one: a side does not become up because more frames show it.

    Attributes
    ----------
    seen : (N, 5) float64
        A row per direction: unit vector (3), sums over the votes of weight times area, and of weight times evidence.
    axes : (3, 3) float64
        Sum over the votes of the rotations of the cameras times their weights.
    measured : (3,) float64
        Sum over the votes of the measured up directions times their weights.
    up : (3,) float64 or None
        Up in the world; None while unknown.
    waiting : float
        Weight of the frames since the last vote.
    votes : float
        Weight of the frames that voted.
    changed : bool
        Whether the last vote has changed `up`.
    """

    seen: Float64Array = field(default_factory=lambda: np.zeros((0, 5)))
    axes: Float64Array = field(default_factory=lambda: np.zeros((3, 3)))
    measured: Float64Array = field(default_factory=lambda: np.zeros(3))
    up: Float64Array | None = None
    waiting: float = 0.0
    votes: float = 0.0
    changed: bool = False

    @property
    def image_up(self) -> Float64Array:
        """Mean up direction of the images so far, (3,) in the world: the fallback without other evidence."""
        norm = float(np.linalg.norm(self.axes[:, 1]))
        return np.asarray(-self.axes[:, 1] / norm if norm > 0 else np.array([0.0, 0.0, 1.0]))

    def is_due(self, weight: float) -> bool:
        """Add the weight of a frame and return whether it should vote."""
        self.waiting += weight
        return self.waiting >= VOTE_WEIGHT and (self.waiting >= SURE_WEIGHT or not self._is_sure())

    def update(
        self, areas: FlatAreas, T_world_camera: Float64Array, up_camera: Float64Array | None = None
    ) -> Float64Array | None:
        """Add a frame's flat areas; return up (3,) in the world, or None while unknown.

        The frame stands for all frames that wait. `changed` is True if up differs from before.

        Parameters
        ----------
        areas : FlatAreas
        T_world_camera : (4, 4) float64
        up_camera : (3,) float64 or None
            Unit vector up (opposite to gravity) in the camera, if measured: it takes precedence over surfaces.
        """
        self.changed = False
        weight, self.waiting = self.waiting or VOTE_WEIGHT, 0.0
        self.axes += weight * T_world_camera[:3, :3]
        self.votes += weight
        if up_camera is not None:
            self.measured += weight * (T_world_camera[:3, :3] @ up_camera)
        normals = areas.normal @ T_world_camera[:3, :3].T
        for normal, area_m2, evidence in zip(normals, areas.area_m2, areas.evidence, strict=True):
            # A near wall is no better evidence than a table: an area counts for at most one square metre.
            self._add(np.array([*normal, weight * min(1.0, area_m2), weight * evidence]))
        best = self._best()
        if self.up is not None and (best is None or best @ self.up <= SAME_COS):
            self.changed = True
        if best is None or self.up is None or self.changed:
            self.up = None if best is None else best.copy()
        return self.up

    def _is_sure(self) -> bool:
        """Return whether up is so well known that a few frames will not change it."""
        if self.up is None or self.measured.any():
            return self.up is not None
        likely, near_up = self._likelihood(), self.seen[:, :3] @ self.up > NOISE_COS
        clear = likely[near_up].max(initial=0.0) >= MIN_LIKELIHOOD_RATIO * likely[~near_up].max(initial=0.0)
        return bool(self.votes >= MIN_VOTES and clear and self._mean_evidence(near_up) >= ENOUGH_FRACTION)

    def _mean_evidence(self, directions: npt.NDArray[np.bool_]) -> float:
        """Return the largest evidence among some directions (N,), as a weighted mean over all votes."""
        return float(self.seen[directions, 4].max(initial=0.0)) / max(1, self.votes)

    def _best(self) -> Float64Array | None:
        """Return the direction (3,) that is up according to all evidence so far; None while it is unknown.

        A direction becomes up if at least the fraction `ENOUGH_FRACTION` of the readings off flat areas, as a mean over
        all votes, shows objects that stand in it; up becomes unknown below half of that. Level areas in the images
        count as just enough evidence for the images' up: the side of a shelf rises from its back as an object rises
        from a table.
        """
        if (norm := float(np.linalg.norm(self.measured))) > 0.0:
            return self._level(self.measured / norm)
        likely = self._likelihood()
        near_up = np.zeros(len(likely), bool) if self.up is None else self.seen[:, :3] @ self.up > NOISE_COS
        confirmed = self.up is not None and self._mean_evidence(near_up) >= HELD_FRACTION * ENOUGH_FRACTION
        level = self._level_in_images()
        if confirmed:
            held = likely[near_up].max(initial=0.0)
        else:
            held = 0.0 if level is None else ENOUGH_FRACTION * self.votes * float(self._constancy(level))
        enough = self.seen[:, 4] >= ENOUGH_FRACTION * self.votes
        best = int(np.argmax(likely * enough)) if enough.any() else -1
        if best >= 0 and not near_up[best] and likely[best] > MIN_LIKELIHOOD_RATIO * held:
            return np.asarray(self.seen[best, :3])
        return self.up if confirmed else level

    def _level_in_images(self) -> Float64Array | None:
        """Return the direction (3,) with most flat area that faces up in the images; None if there is none.

        It is used while no object is seen to stand on anything. Faces of objects have less than a fifth of a square
        metre.
        """
        area = self.seen[:, 3] * (
            (self.seen[:, :3] @ self.image_up > LEVEL_IN_IMAGES_COS) & (self.seen[:, 3] >= MIN_LEVEL_M2)
        )
        return np.asarray(self.seen[int(np.argmax(area)), :3]) if area.any() else None

    def _likelihood(self) -> Float64Array:
        """Return the likelihood of each direction (N,) to be up, from objects on its areas and camera rotation.

        A person or a robot turns a camera about the vertical more than about any other axis: up is the direction that
        changes least in the camera. A camera that does not turn gives no such evidence.
        """
        return np.asarray(self.seen[:, 4] * self._constancy(self.seen[:, :3]))

    def _constancy(self, directions: Float64Array) -> Float64Array:
        """Return how constant each direction (..., 3) stays in the camera while it turns, 0..1; up stays constant."""
        return np.asarray((np.linalg.norm(directions @ self.axes, axis=-1) / max(1, self.votes)) ** 4)

    def _level(self, measured: Float64Array) -> Float64Array:
        """Return the measured up (3,), or the more exact normal of a level surface of one square metre."""
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
