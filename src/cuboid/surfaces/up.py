"""Which way is up: the direction of the flat areas that things stand on, whichever way the camera is held."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from cuboid.frame import Float64Array
from cuboid.surfaces.standing import ENOUGH, SAME_COS, FlatAreas
from cuboid.tolerances import MIN_READINGS, MOST, SOME

# A direction nearer than this to another is its noise: the next real one is at right angles.
NOISE_COS = math.sqrt(MOST)
# Another direction becomes up when its likelihood is larger by this ratio.
MIN_LIKELIHOOD_RATIO = 2.0
# What is known of planes, and of up once it is known, is updated every so many frames.
REFRESH_FRAMES = 8


class UpVote:
    """Collects directions in which flat areas face, with the evidence that things stand on them."""

    def __init__(self) -> None:
        # A row a direction: unit vector (3), area, evidence.
        self._seen: Float64Array = np.zeros((0, 5))
        self._axes: Float64Array = np.zeros((3, 3))
        self._measured: Float64Array = np.zeros(3)
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
        self._begin_anew()
        return not self._is_sure() or self._frames % REFRESH_FRAMES == 0

    def update(
        self, areas: FlatAreas, T_world_camera: Float64Array, up_camera: Float64Array | None = None
    ) -> Float64Array | None:
        """Take in a frame's flat areas; return up (3,) in the world, or None while unknown.

        `changed` tells whether up is not what it was before.

        Parameters
        ----------
        areas : FlatAreas
        T_world_camera : (4, 4) float64
        up_camera : (3,) float64 or None
            Unit vector away from the earth's pull in the camera, where it was measured: no surface says more.
        """
        self.changed = False
        self._begin_anew()
        self._axes += T_world_camera[:3, :3]
        self._votes += 1
        if up_camera is not None:
            self._measured += T_world_camera[:3, :3] @ up_camera
        normals = areas.normal @ T_world_camera[:3, :3].T
        for normal, area_m2, evidence in zip(normals, areas.area_m2, areas.evidence, strict=True):
            # No area counts for more than a square metre a frame: a near wall is no surer than a table.
            self._add(np.array([*normal, min(1.0, area_m2), evidence]))
        best = self._best()
        if self._up is not None and (best is None or best @ self._up <= SAME_COS):
            self.changed = True
        if best is None or self._up is None or self.changed:
            self._up = None if best is None else best.copy()
        return self._up

    def _begin_anew(self) -> None:
        """Begin with what an earlier version held to be up, where that wrote the votes: it knew no evidence."""
        if self._seen.shape[1] != 5:
            self._seen = np.zeros((0, 5)) if self._up is None else np.array([[*self._up, 1.0, 1.0]])
            self._axes, self._votes = np.zeros((3, 3)), 0

    def _is_sure(self) -> bool:
        """Tell whether up is known, and by so much that a few frames will not change it."""
        if self._up is None or self._measured.any():
            return self._up is not None
        likely, own = self._likelihood(), self._seen[:, :3] @ self._up > NOISE_COS
        clear = likely[own].max(initial=0.0) >= MIN_LIKELIHOOD_RATIO * likely[~own].max(initial=0.0)
        return bool(self._votes >= MIN_READINGS and clear and self._share(own) >= ENOUGH)

    def _share(self, directions: npt.NDArray[np.bool_]) -> float:
        """Return the most evidence of some directions (N,), in the mean of all frames."""
        return float(self._seen[directions, 4].max(initial=0.0)) / max(1, self._votes)

    def _best(self) -> Float64Array | None:
        """Return the direction (3,) that up should be now; None while it is not known.

        In that direction some of what lies on no flat area stands, in the mean of all frames; once it is half of that,
        up is not known any more.
        """
        if (norm := float(np.linalg.norm(self._measured))) > 0.0:
            return self._level(self._measured / norm)
        likely = self._likelihood()
        own = np.zeros(len(likely), bool) if self._up is None else self._seen[:, :3] @ self._up > NOISE_COS
        known = self._up is not None and self._share(own) >= MOST * ENOUGH
        held = likely[own].max(initial=0.0) if known else 0.0
        enough = self._seen[:, 4] >= ENOUGH * self._votes
        best = int(np.argmax(likely * enough)) if enough.any() else -1
        if best >= 0 and not own[best] and likely[best] > MIN_LIKELIHOOD_RATIO * held:
            return np.asarray(self._seen[best, :3])
        return self._up if known else self._level_in_images()

    def _level_in_images(self) -> Float64Array | None:
        """Return the direction (3,) of most flat area that the images show from above; None where there is none.

        It holds while nothing is seen to stand anywhere. Faces of things are smaller than a fifth of a square metre.
        """
        area = self._seen[:, 3] * ((self._seen[:, :3] @ self.image_up > MOST) & (self._seen[:, 3] >= SOME))
        return np.asarray(self._seen[int(np.argmax(area)), :3]) if area.any() else None

    def _likelihood(self) -> Float64Array:
        """Return how likely each direction (N,) is up: by what stands on its areas, and by how the camera turns.

        Whatever carries a camera turns it about the vertical more than about anything else: of all directions up
        changes least in the camera. A camera that does not turn tells nothing by that.
        """
        constancy = np.linalg.norm(self._seen[:, :3] @ self._axes, axis=1) / max(1, self._votes)
        return np.asarray(self._seen[:, 4] * constancy**4)

    def _level(self, measured: Float64Array) -> Float64Array:
        """Return what was measured as up (3,); a level surface of a square metre in all says it more exactly."""
        near = self._seen[(self._seen[:, :3] @ measured > SAME_COS) & (self._seen[:, 3] >= 1.0)]
        return np.asarray(near[np.argmax(near[:, 3]), :3] if len(near) else measured)

    def _add(self, row: Float64Array) -> None:
        if len(self._seen):
            similarity = self._seen[:, :3] @ row[:3]
            k = int(np.argmax(similarity))
            if similarity[k] > SAME_COS:
                mean = self._seen[k, :3] * self._seen[k, 3] + row[:3] * row[3]
                self._seen[k] += row
                self._seen[k, :3] = mean / np.linalg.norm(mean)
                return
        self._seen = np.vstack([self._seen, row])
