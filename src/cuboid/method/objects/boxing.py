"""The box of an object in the map: the seen part, and parts that no frame has seen."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.tolerances import SIGMAS
from cuboid.ground.geometry.box import Box
from cuboid.method.boxes.denoising import THICK_VOXELS, denoised, is_thick
from cuboid.method.boxes.edges import FROM_ABOVE, TOP_SEEN, to_edges, to_top
from cuboid.method.boxes.faces import to_faces
from cuboid.method.boxes.fit import fit_box
from cuboid.method.boxes.hidden import as_deep_as_wide, is_clear_of, is_unseen_beyond, with_hidden
from cuboid.method.boxes.revolved import revolved
from cuboid.method.heatmap.stored_points import Rows
from cuboid.method.heatmap.voxel_map import VoxelMap

# Fraction of an object's weight that lies outside its surface at each side: the tails of the sensor's noise.
STRAY_FRACTION = 0.008
# Noise of the map's points, as a fraction of the noise of their usual readings.
MAP_NOISE = 0.8
# Approximate largest number of voxels in a fit; more voxels of a large object do not change its box.
BOX_VOXELS = 1500
# Fraction of the usual voxel of a surface that the surface fills: voxels lie across it at random.
FILLED_VOXEL_FRACTION = 0.5

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
        """Return the box of the seen part of an object, extended by its hidden far side, and the noise of its points.

        The noise is that of the fitted points, metres.

        The weight of a voxel grows with the number and the precision of its readings, up to the median of each. Beyond
        the median, further readings add no weight: otherwise the side that the camera saw longest would dominate.

        Parameters
        ----------
        rows : (N,) int64
            Rows of its voxels, at least one.
        places : (N, 3) float32
            Their positions in the world, metres.
        plane : ((3,) float64, float) or None
            Normal and offset of its supporting plane, in the world; None if unknown.
        up : (3,) float64
            Up direction, used without a known plane.
        others : sequence of Box
            Boxes of its neighbours.
        eye : (3,) float64, optional
            Position of the camera, world, metres.
        """
        sampled = slice(None, None, 1 + len(rows) // BOX_VOXELS)
        trust, readings, noise_m = self._trust(rows[sampled])
        points = places[sampled].astype(np.float64)
        voxel_m = self._voxels.voxel_m
        if eye is None or not is_thick(noise_m, voxel_m):
            return self._fit(points, trust, readings, noise_m, plane, up, others, eye), noise_m
        points, noise_m = denoised(points, trust, eye, noise_m, voxel_m)
        box = self._fit(points, trust, readings, noise_m, plane, up, others, eye)
        # Points of adjacent voxels are at most two voxels apart.
        return as_deep_as_wide(box, eye, others, 2.0 * voxel_m), noise_m

    def _fit(
        self,
        points: Float64Array,
        trust: Float64Array,
        readings: Float64Array,
        noise_m: float,
        plane: Plane | None,
        up: Float64Array,
        others: Sequence[Box],
        eye: Float64Array | None,
    ) -> Box:
        if plane is None:
            return fit_box(points, up, None, STRAY_FRACTION, trust)
        box = self._standing(points, trust, plane)
        round_box = revolved(box, points, trust, plane, noise_m, self._voxels.voxel_m, STRAY_FRACTION)
        if (
            round_box is not None
            and is_clear_of(round_box, others)
            and is_unseen_beyond(round_box, box, *plane, self._voxels)
        ):
            round_box = to_faces(round_box, points, trust, noise_m, top_alone=True)
            return self._to_tops(round_box, points, readings, noise_m, eye)
        box = to_faces(box, points, trust, noise_m, top_alone=False)
        box = self._to_tops(box, points, readings, noise_m, eye)
        return with_hidden(box, points, *plane, others, self._voxels)

    def _standing(self, points: Float64Array, trust: Float64Array, plane: Plane) -> Box:
        """Return the box of points on a plane; that of a whole disc only if the rest of the disc can be hidden."""
        box = fit_box(points, *plane, STRAY_FRACTION, trust)
        # The box of a whole disc has equal sides.
        if box.size[0] - box.size[1] > self._voxels.voxel_m:
            return box
        part = fit_box(points, *plane, STRAY_FRACTION, trust, discs=False)
        return box if is_unseen_beyond(box, part, *plane, self._voxels) else part

    def _to_tops(
        self, box: Box, points: Float64Array, readings: Float64Array, noise_m: float, eye: Float64Array | None
    ) -> Box:
        """Return a box that ends at the seen top, and at its edges if the camera sees it from straight above."""
        if eye is None:
            return box
        ray = eye - box.center
        facing = float(ray @ box.up) / max(math.sqrt(ray @ ray), 1e-9)
        if facing < TOP_SEEN:
            return box
        voxel_m = self._voxels.voxel_m
        found = to_top(box, points, readings, voxel_m, noise_m)
        if facing >= FROM_ABOVE:
            return to_edges(found, points, readings, voxel_m)
        # Seen obliquely, the inside of a mug may look like a flat top, but a lower one than noise explains.
        return found if box.size[2] - found.size[2] <= SIGMAS * THICK_VOXELS * voxel_m else box

    def _trust(self, rows: Rows) -> tuple[Float64Array, Float64Array, float]:
        """Return of voxels the weights (N,), the numbers of readings (N,), and the noise of the positions, metres."""
        hits = self._voxels.stored.hits[rows].astype(np.float64)
        precision = self._voxels.stored.weight(rows) / hits
        usual = _middle(precision)
        trust = np.minimum(hits, _middle(hits)) * np.minimum(precision, usual)
        return trust, precision * hits, MAP_NOISE * self._voxels.noise_per_m / float(np.sqrt(usual))


def usual_distance_m(noise_m: float, noise_per_m: float, voxel_px_m: float) -> float:
    """Return the distance of the camera, metres, from the noise of an object's points; see `Boxing.fit`.

    The noise is that of the mean of a voxel's readings in one frame; their number follows from the distance.

    Parameters
    ----------
    noise_m : float
    noise_per_m : float
        Noise of one reading divided by its depth squared, 1/metre.
    voxel_px_m : float
        Edge of a voxel times the focal length in working pixels: the distance at which a voxel is as wide as a pixel.
    """
    of_one_m = math.sqrt(noise_m / (MAP_NOISE * noise_per_m))
    return max(of_one_m, float((FILLED_VOXEL_FRACTION * voxel_px_m**2 * of_one_m**4) ** (1.0 / 6.0)))


def _middle(values: Float64Array) -> float:
    """Return the upper median: NumPy's median takes several times as long for so few values."""
    k = len(values) // 2
    return float(np.partition(values, k)[k])
