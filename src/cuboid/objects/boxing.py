"""The box of an object of the map: of what was seen of it, and of what no frame has seen."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cuboid.boxes.faces import to_faces
from cuboid.boxes.fit import fit_box
from cuboid.boxes.hidden import clear_of, foot_is_hidden, with_foot, with_hidden
from cuboid.boxes.revolved import revolved
from cuboid.frame import Float64Array
from cuboid.geometry.box import Box
from cuboid.heatmap.voxel_map import Rows, VoxelMap
from cuboid.objects.entry import MapObject
from cuboid.objects.ownership import Piece
from cuboid.objects.validity import rests
from cuboid.surfaces.plane import Plane
from cuboid.surfaces.planes import PlaneTracker

# Share of an object's trust that lies outside its surface at each side: the tails of the sensor's noise.
STRAY_SHARE = 0.008
# The noise of the map's points, as a share of that of the usual reading of them.
MAP_NOISE = 0.8
# Voxels that a box is fitted to, at most about; more of a large object do not change it.
BOX_VOXELS = 1500


class Boxing:
    """Fits boxes to voxels of the map.

    Parameters
    ----------
    voxels : VoxelMap
    planes : PlaneTracker
    """

    def __init__(self, voxels: VoxelMap, planes: PlaneTracker) -> None:
        self._voxels = voxels
        self._planes = planes

    def seen(self, piece: Piece) -> Box:
        """Fit a box to a piece; a voxel is believed by how often and from how near it was seen, up to the median.

        Beyond the median more sightings prove no more: else the side that the camera dwelt on would be all.
        """
        rows = _thinned(piece.rows)
        trust, _ = self._trust(rows)
        points = self._voxels.xyz(rows)
        plane = self.plane(piece.plane)
        if plane is not None:
            return fit_box(points, *plane, STRAY_SHARE, trust)
        up = self._planes.up
        return fit_box(points, np.array([0.0, 0.0, 1.0]) if up is None else up, None, STRAY_SHARE, trust)

    def whole(self, piece: Piece, box: Box, others: Iterable[MapObject]) -> Box:
        """Return the box of what was seen of an object with its far side and foot, as far as these may be there."""
        plane = self.plane(piece.plane)
        if plane is None:
            return box
        rows = _thinned(piece.rows)
        points = self._voxels.xyz(rows).astype(np.float64)
        near = _near(box, others)
        trust, noise_m = self._trust(rows)
        round_box = revolved(box, points, trust, *plane, noise_m, STRAY_SHARE)
        if round_box is not None and clear_of(round_box, near):
            return with_foot(to_faces(round_box, points, trust, noise_m, top_alone=True), *plane, near, self._voxels)
        box = to_faces(box, points, trust, noise_m, top_alone=False)
        return with_hidden(box, points, *plane, near, self._voxels)

    def _trust(self, rows: Rows) -> tuple[Float64Array, float]:
        """Return how far voxels (N,) are to be believed, and the usual noise of their places, metres."""
        hits = self._voxels.hits[rows].astype(np.float64)
        precision = self._voxels.weight(rows) / hits
        usual = _middle(precision)
        trust = np.minimum(hits, _middle(hits)) * np.minimum(precision, usual)
        return trust, MAP_NOISE * self._voxels.noise_per_m / float(np.sqrt(usual))

    def rests(self, piece: Piece, box: Box) -> bool:
        """Tell whether a piece's box rests on its plane, or on nothing known."""
        return rests(box, self.plane(piece.plane))

    def stands(self, entry: MapObject, others: Iterable[MapObject]) -> bool:
        """Tell whether an object stands on its plane, or may: where its foot would be nothing was seen."""
        plane = self.plane(entry.plane)
        if plane is None or rests(entry.box, plane):
            return True
        return foot_is_hidden(entry.box, *plane, _near(entry.box, others), self._voxels)

    def plane(self, plane: Plane | None) -> tuple[Float64Array, float] | None:
        """Return normal and offset of a plane in the world."""
        return None if plane is None else self._planes.in_world(plane)


def _middle(values: Float64Array) -> float:
    """Return the upper median: NumPy's own takes several times as long on so few."""
    k = len(values) // 2
    return float(np.partition(values, k)[k])


def _thinned(rows: Rows) -> Rows:
    return rows[:: 1 + len(rows) // BOX_VOXELS]


def _near(box: Box, others: Iterable[MapObject]) -> list[Box]:
    reach = 2.0 * float(np.linalg.norm(box.size))
    return [o.box for o in others if float(np.linalg.norm(o.box.center - box.center)) <= reach]
