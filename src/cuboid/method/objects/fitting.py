"""When an object's box is refitted, and the consequences of the fit."""

from __future__ import annotations

from collections.abc import Sequence
from math import log, log1p

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.limits import SAMPLE_POINTS
from cuboid.ground.core.tolerances import DRIFT_M, MIN_READINGS, SIGMAS
from cuboid.ground.geometry.box import Box
from cuboid.method.boxes.fit import fit_box
from cuboid.method.boxes.hidden import with_hidden_foot
from cuboid.method.heatmap.stored_points import Rows
from cuboid.method.heatmap.voxel_map import VoxelMap
from cuboid.method.objects.boxing import Boxing
from cuboid.method.objects.continuation import is_structure
from cuboid.method.objects.entry import MapObject
from cuboid.method.objects.outline import CLEAR, ends_above
from cuboid.method.objects.store import ObjectStore
from cuboid.method.objects.support import above_support_rim, encloses, find_attachment
from cuboid.method.objects.validity import fits_object, too_large
from cuboid.method.surfaces.plane import Plane
from cuboid.method.surfaces.planes import PlaneTracker

# A box is refitted when the number of sightings has grown by this fraction.
GROWN = 0.15
# Largest number of labelled objects, and of candidates, that are refitted in a frame; others follow in later frames.
FITS = 4
# Log-odds that an object loses if a fit shows that it is structure or noise.
STRUCTURE = CLEAR

# Unit normal (3,) and offset of the surface at which a box ends: normal.p + offset = 0.
Rest = tuple[Float64Array, float]


class Fitting:
    """Fits the boxes of objects to their voxels, and retires objects without enough voxels or of excessive size.

    Parameters
    ----------
    config : TrackerConfig
    voxels : VoxelMap
    planes : PlaneTracker
    store : ObjectStore
    boxing : Boxing
    """

    def __init__(
        self, config: TrackerConfig, voxels: VoxelMap, planes: PlaneTracker, store: ObjectStore, boxing: Boxing
    ) -> None:
        self._config = config
        self._voxels = voxels
        self._planes = planes
        self._store = store
        self._boxing = boxing

    def fit_grown(self, numbers: Sequence[int], eye: Float64Array, new_viewpoint: bool = True) -> None:
        """Refit objects that were sighted more often since the last fit; the camera is at `eye` (3,).

        Further sightings of a confirmed object from the same viewpoint (`new_viewpoint` is False) only repeat its
        noise: their number must have doubled.
        """
        waiting = [o for o in self._store.all_of(numbers) if o.sightings >= (1 + GROWN) * o.fitted and o.sightings > 0]
        if not new_viewpoint:
            waiting = [o for o in waiting if not o.confirmed or o.sightings >= 2 * o.fitted]
        waiting.sort(key=lambda o: ((o.fitted + 1) / (o.sightings + 1), o.number))
        confirmed = [o for o in waiting if o.confirmed][:FITS]
        likely = [o for o in waiting if not o.confirmed and o.log_odds > 0][:FITS]
        for entry in confirmed + likely:
            self.fit(entry, eye, _fits_due(entry))

    def fit(self, entry: MapObject, eye: Float64Array | None = None, counted: int = 1) -> None:
        """Fit the box of an object; retire it if it has too few voxels, or if it has grown too large.

        If the camera position `eye` (3,), world, metres, is given, the points are denoised along the camera's rays.
        `counted` is the number of fits for which this one counts: those that new viewpoints at each sighting would have
        caused.
        """
        rows = self._voxels.solid_rows_of(entry.number, self._config.hot, min(2, entry.sightings))
        if len(rows) < MIN_READINGS:
            self._store.postpone_fit(entry)
            if entry.confirmed:
                self._store.retire(entry)
            return
        rows, plane, rests, supports = self._find_support(entry, rows)
        stored = self._voxels.stored
        points = stored.xyz(rows)
        others = [o.box for o in self._store.neighbours(entry) if o.confirmed]
        seen_box, noise_m = self._boxing.fit(rows, points, rests, self._planes.likely_up, others, eye)
        box = seen_box if rests is None else with_hidden_foot(seen_box, *rests, others, self._voxels)
        if plane is not None and rests is not None and box.foot_m(*rests) > DRIFT_M:
            # A floating object may stand on a plane that was not known yet: estimate its support again from later
            # sightings.
            supports = {plane.identity: 1}
        self._store.fit(
            entry,
            box,
            points=points,
            colors=stored.rgb(rows),
            heat=float(stored.heat(rows).mean()),
            keyframe=stored.keyframe_of(rows),
            plane=None if plane is None else plane.identity,
            supports=supports,
        )
        neighbours = self._store.neighbours(entry)
        holder = 0 if rests is None else find_attachment(entry, *rests, neighbours, self._voxels)
        labelled = [o for o in neighbours if o.confirmed]
        supports_plane = self._supports_plane(entry) or encloses(entry, labelled, self._voxels.voxel_m)
        structure = supports_plane or self._is_structure(entry, box, noise_m, labelled)
        if plane is not None and not structure and not holder:
            self._store.place(entry, self._with_seat(entry, seen_box, plane, neighbours))
        if structure:
            self._store.add_evidence(entry, -STRUCTURE)
            # Candidates are fitted only while they are likely.
            while (counted := counted - 1) > 0 and entry.log_odds > 0:
                self._store.add_evidence(entry, -STRUCTURE)
        # Regardless of its outline: an object that supports a plane, or encloses others, at two successive fits is
        # furniture.
        furniture = entry.confirmed and entry.supports_plane and supports_plane
        self._store.attach(entry, holder, supports_plane=supports_plane)
        if furniture or too_large(box, self._config):
            self._store.retire(entry)

    def _find_support(self, entry: MapObject, rows: Rows) -> tuple[Rows, Plane | None, Rest | None, dict[int, int]]:
        """Find the supporting plane of an object.

        Return its rows above the support, the plane, normal and offset of the surface at which the box ends, and the
        pixels above each plane that the next fit uses.
        """
        points = self._voxels.stored.xyz(rows)
        identity = max(entry.supports.items(), key=lambda s: (s[1], -s[0]), default=(None, 0))[0]
        plane = self._planes.find(identity)
        if plane is not None:
            plane = self._planes.supporting_plane(points[:: 1 + len(points) // SAMPLE_POINTS], plane)
        if plane is None:
            return rows, None, None, entry.supports
        normal, offset = self._planes.in_world(plane)
        above = self._above(points, normal, offset)
        rows, points = rows[above], points[above]
        above_rim = above_support_rim(points, normal, offset, self._voxels.voxel_m)
        if above_rim.all():
            return rows, plane, (normal, offset), entry.supports
        # The real support is not known yet: the box ends at the foot of the object.
        foot_m = float((points[above_rim] @ normal).min()) - 2.0 * self._voxels.voxel_m
        return rows[above_rim], None, (normal, -foot_m), {plane.identity: 1}

    def _is_structure(self, entry: MapObject, box: Box, noise_m: float, labelled: Sequence[MapObject]) -> bool:
        """Return whether an object beside labelled ones is noise of a surface, or a part of a larger surface."""
        if not fits_object(box, self._config) or box.size.min() < SIGMAS * noise_m:
            return True
        owned = np.zeros(self._store.numbers, np.uint8)
        owned[[entry.number, *(o.number for o in labelled)]] = 1
        return is_structure(box, entry.points, self._voxels, owned)

    def _supports_plane(self, entry: MapObject) -> bool:
        """Return whether an object reaches up to a plane that lies on it.

        An object with a free top may be as high as the board beneath which it stands; the side of a shelf is as high as
        the plane itself, which continues from there.
        """
        if self._planes.is_extended_by_plane(entry.box):
            return True
        return self._planes.has_plane_on_top(entry.box) and not ends_above(entry.outline)

    def _with_seat(self, entry: MapObject, seen_box: Box, plane: Plane, neighbours: Sequence[MapObject]) -> Box:
        """Return the box of a floating object extended by its seat and down to its plane, as for the legs of a chair.

        `seen_box` is the box without a hidden foot; it decides whether the object floats. An object that is higher
        above its plane than its longest side hangs, and an object on top of another one has no legs.
        """
        box, (normal, offset) = entry.box, self._planes.in_world(plane)
        if not DRIFT_M < seen_box.foot_m(normal, offset) <= seen_box.size.max():
            return box
        foot = seen_box.center - seen_box.size[2] / 2.0 * normal
        seat = self._planes.seat_of(entry.points[:: 1 + len(entry.points) // SAMPLE_POINTS], plane)
        if not len(seat) or any(o.confirmed and o.box.contains(foot[None], DRIFT_M)[0] for o in neighbours):
            return box
        feet = seat - np.outer(seat @ normal + offset, normal)
        extended = fit_box(np.concatenate([seen_box.corners(), seat, feet]), normal, offset, 0.0)
        return box if too_large(extended, self._config) else extended

    def _above(self, points: Float32Array, normal: Float64Array, offset: float) -> npt.NDArray[np.bool_]:
        """Return which points lie above the supporting plane; lower points belong to the plane or its rim.

        If too few points lie above it, all points are kept.
        """
        above = np.asarray(points @ normal + offset > self._config.min_height_m)
        return above if np.count_nonzero(above) >= MIN_READINGS else np.ones(len(points), bool)


def _fits_due(entry: MapObject) -> int:
    """Return how often the number of sightings has grown by `GROWN` since the last fit, at least one sighting each."""
    if not entry.fitted and len(entry.points):
        return 1
    last = max(1, entry.fitted)
    grown = min(entry.sightings - last, int(log(entry.sightings / last) / log1p(GROWN)))
    return max(1, grown + (not entry.fitted))
