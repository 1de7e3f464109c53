"""The box of an object of the map: of what was seen of it, and of what no frame has seen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cuboid.boxes.denoising import denoised, is_thick
from cuboid.boxes.faces import to_faces
from cuboid.boxes.fit import fit_box
from cuboid.boxes.hidden import as_deep_as_wide, is_clear_of, with_hidden
from cuboid.boxes.revolved import revolved
from cuboid.core.frame import Float32Array, Float64Array
from cuboid.geometry.box import Box
from cuboid.heatmap.stored_points import Rows
from cuboid.heatmap.voxel_map import VoxelMap

# Fraction of an object's trust that lies outside its surface at each side: the tails of the sensor's noise.
STRAY_FRACTION = 0.008
# The noise of the map's points, as a fraction of that of the usual reading of them.
MAP_NOISE = 0.8
# Voxels that a box is fitted to, at most about; more of a large object do not change it.
BOX_VOXELS = 1500

Plane = tuple[Float64Array, float]


class Boxing:
    """Fits boxes to voxels of the map.

    Parameters
    ----------
    voxels : VoxelMap
    """

    def __init__(self, voxels: VoxelMap) -> None:
        self._voxels = voxels

    def fit(
        self,
        rows: Rows,
        places: Float32Array,
        plane: Plane | None,
        up: Float64Array,
        others: Sequence[Box],
        eye: Float64Array | None = None,
    ) -> tuple[Box, float]:
        """Return the box of what was seen of an object, with its far side as far as that may be there.

        And the usual noise of the points that it was fitted to, metres.

        A voxel is believed by how often and from how near it was seen, up to the median. Beyond the median more
        sightings prove no more: else the side that the camera dwelt on would be all.

        Parameters
        ----------
        rows : (N,) int64
            Its voxels, at least one.
        places : (N, 3) float32
            Where they are in the world, metres.
        plane : ((3,) float64, float) or None
            Normal and offset, in the world, of what it stands on.
        up : (3,) float64
            Where it stands on nothing known.
        others : sequence of Box
            Those of its neighbours.
        eye : (3,) float64, optional
            Where the camera is that sees it, world, metres.
        """
        some = slice(None, None, 1 + len(rows) // BOX_VOXELS)
        trust, noise_m = self._trust(rows[some])
        points = places[some].astype(np.float64)
        voxel_m = self._voxels.voxel_m
        if eye is None or not is_thick(noise_m, voxel_m):
            return self._fit(points, trust, noise_m, plane, up, others), noise_m
        points, noise_m = denoised(points, trust, eye, noise_m, voxel_m)
        box = self._fit(points, trust, noise_m, plane, up, others)
        # Points of voxels side by side are no farther apart than two voxels.
        return as_deep_as_wide(box, eye, others, 2.0 * voxel_m), noise_m

    def _fit(
        self,
        points: Float64Array,
        trust: Float64Array,
        noise_m: float,
        plane: Plane | None,
        up: Float64Array,
        others: Sequence[Box],
    ) -> Box:
        if plane is None:
            return fit_box(points, up, None, STRAY_FRACTION, trust)
        box = fit_box(points, *plane, STRAY_FRACTION, trust)
        round_box = revolved(box, points, trust, *plane, noise_m, self._voxels.voxel_m, STRAY_FRACTION)
        if round_box is not None and is_clear_of(round_box, others):
            return to_faces(round_box, points, trust, noise_m, top_alone=True)
        box = to_faces(box, points, trust, noise_m, top_alone=False)
        return with_hidden(box, points, *plane, others, self._voxels)

    def _trust(self, rows: Rows) -> tuple[Float64Array, float]:
        """Return how far voxels (N,) are to be believed, and the usual noise of their places, metres."""
        hits = self._voxels.stored.hits[rows].astype(np.float64)
        precision = self._voxels.stored.weight(rows) / hits
        usual = _middle(precision)
        trust = np.minimum(hits, _middle(hits)) * np.minimum(precision, usual)
        return trust, MAP_NOISE * self._voxels.noise_per_m / float(np.sqrt(usual))


def _middle(values: Float64Array) -> float:
    """Return the upper median: NumPy's own takes several times as long on so few."""
    k = len(values) // 2
    return float(np.partition(values, k)[k])
