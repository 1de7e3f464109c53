"""When an object's box is refitted, and the consequences of the fit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.limits import SAMPLE_POINTS
from cuboid.ground.core.tolerances import DRIFT_M, MIN_READINGS
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.overlap import iou_matrix
from cuboid.method.boxes.fit import fit_box
from cuboid.method.boxes.hidden import with_hidden_foot
from cuboid.method.boxes.measured_sides import along_axes, still_valid, with_sides, with_view
from cuboid.method.boxes.profile import rounded_profile
from cuboid.method.boxes.rims import is_hollow, rim_drop_m, side_drops, steps_m
from cuboid.method.boxes.top_edges import Picture, top_sides
from cuboid.method.heatmap.stored_points import Rows
from cuboid.method.heatmap.voxel_map import VoxelMap
from cuboid.method.objects.affinity import SAME_LOG_ODDS
from cuboid.method.objects.boxing import Boxing
from cuboid.method.objects.continuation import continues
from cuboid.method.objects.entry import MapObject
from cuboid.method.objects.objectness import area_fraction
from cuboid.method.objects.outline import ends_above
from cuboid.method.objects.store import ObjectStore
from cuboid.method.objects.support import (
    above_support_rim,
    encloses,
    find_attachment,
    find_coaxial,
    find_other_wall,
    seen_part,
)
from cuboid.method.objects.validity import too_large
from cuboid.method.surfaces.plane import Plane
from cuboid.method.surfaces.planes import PlaneTracker

# A box is refitted when the number of sightings has grown by the first fraction. Sightings from the same viewpoint
# repeat their noise: for a labelled object the number must then have grown by the third one, and for a candidate before
# a fixed camera, which gets its label soon after its first boxes, by the second one.
GROWN, GROWN_FIXED, GROWN_SAME = 0.15, 0.5, 1.0
# Largest number of labelled objects, and of candidates, that are refitted in a frame with little or with full weight;
# others follow in later frames.
MIN_FITS, MAX_FITS = 4, 12
# An object of which this number of sides continue is a part of structure and gets no seat.
STRUCTURE_SIDES = 2

# Two objects are in one place if their boxes have this IoU: the box of a thing with stale points of its neighbour is
# far larger than that of the neighbour.
COINCIDENT_IOU = 0.5

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

    def fit_grown(
        self,
        numbers: Sequence[int],
        eye: Float64Array,
        *,
        new_viewpoint: bool = True,
        fixed: bool = False,
        weight: float = 1.0,
    ) -> None:
        """Refit objects that were sighted more often since the last fit; the camera is at `eye` (3,).

        From the same viewpoint (`new_viewpoint` is False), labelled objects need more sightings, and candidates as well
        if the camera is `fixed`. A frame with more `weight` (0..1) as evidence refits more objects.
        """
        labelled, candidate = (GROWN, GROWN) if new_viewpoint else (GROWN_SAME, GROWN_FIXED if fixed else GROWN)
        objects = self._store.all_of(numbers)
        any_fitted = any(o.fitted > 0.0 for o in objects)
        waiting = [
            o
            for o in objects
            if o.sightings >= (1 + (labelled if o.confirmed else candidate)) * o.fitted and o.sightings > 0
        ]
        fits = max(MIN_FITS, round(weight * MAX_FITS))
        waiting.sort(key=lambda o: ((o.fitted + weight) / (o.sightings + weight), o.number))
        confirmed = [o for o in waiting if o.confirmed][:fits]
        candidates = [o for o in waiting if not o.confirmed and o.compared > 0.0]
        # Half of the fits for those with most new sightings: noise starts so many that others would wait forever.
        first, others = candidates[: fits // 2], candidates[fits // 2 :]
        others.sort(key=lambda o: (o.fitted - o.sightings, o.number))
        candidates = first + others[: fits - fits // 2]
        # A single view may be noise; where nothing is known yet, no other view may follow.
        new = sorted([o for o in waiting if o.compared == 0.0], key=lambda o: (-o.largest_px, o.number))
        for entry in confirmed + candidates + (new[: round(weight * MAX_FITS)] if any_fitted else new):
            self.fit(entry, eye)

    def measure(self, entries: Sequence[MapObject], picture: Picture) -> None:
        """Find the sides of objects in a frame that shows them, by the edges of their tops."""
        for entry in entries:
            voxel_m = self._voxels.voxel_m
            drops = side_drops(entry.box, entry.points, voxel_m)
            rim_m, hollow = rim_drop_m(drops), is_hollow(drops, voxel_m)
            profile = rounded_profile(entry.box, entry.points, rim_m, voxel_m, hollow=hollow)
            view_m = top_sides(entry.box, picture, rim_m, steps_m(drops, voxel_m), hollow=hollow, profile=profile)
            sides_m = with_view(entry.sides_m, view_m)
            self._store.count_measured(entry)
            if sides_m is not entry.sides_m:
                box = with_sides(entry.box, sides_m, voxel_m)
                self._store.set_box(entry, box, along_axes(sides_m, entry.box, box))

    def fit(self, entry: MapObject, eye: Float64Array | None = None) -> None:
        """Fit the box of an object; retire it if it has too few voxels, or if it has grown too large.

        If the camera position `eye` (3,), world, metres, is given, the points are denoised along the camera's rays.
        """
        rows = self._voxels.solid_rows_of(entry.number, self._config.hot, 2 if entry.compared > 0.0 else 1)
        if len(rows) < MIN_READINGS:
            self._store.postpone_fit(entry)
            if entry.confirmed:
                self._store.retire(entry)
            return
        rows, plane, rests, supports = self._find_support(entry, rows)
        stored = self._voxels.stored
        points = stored.xyz(rows)
        beside = [o for o in self._store.neighbours(entry) if o.confirmed]
        others = [o.box for o in beside]
        seen_box, noise_m = self._boxing.fit(rows, points, rests, self._planes.likely_up, others, eye)
        parts = [] if rests is None else [seen_part(o, rests[0]) for o in beside]
        max_height_m = self._config.max_size_m
        box = seen_box if rests is None else with_hidden_foot(seen_box, *rests, parts, self._voxels, max_height_m)
        if plane is not None and rests is not None and box.foot_m(*rests) > DRIFT_M:
            # A floating object may stand on a plane that was not known yet: estimate its support again from later
            # sightings.
            supports = {plane.identity: 1}
        sides_m = still_valid(entry.sides_m, entry.box, box, self._voxels.voxel_m)
        fitted, box = box, with_sides(box, sides_m, self._voxels.voxel_m)
        self._store.fit(
            entry,
            box,
            points=points,
            colors=stored.rgb(rows),
            heat=float(stored.heat(rows).mean()),
            keyframe=stored.keyframe_of(rows),
            plane=None if plane is None else plane.identity,
            supports=supports,
            filled=area_fraction(
                (points - seen_box.center) @ seen_box.rotation, seen_box.size, 2.0 * self._voxels.voxel_m
            ),
            noise_m=noise_m,
            sides_m=along_axes(sides_m, fitted, box),
        )
        neighbours = self._store.neighbours(entry)
        self._add_coincidences(entry, neighbours)
        holder = 0
        if rests is not None:
            holder = (
                find_attachment(entry, *rests, neighbours, self._voxels)
                or find_coaxial(entry, rests[0], neighbours, self._voxels.voxel_m)
                or find_other_wall(entry, *rests, neighbours, self._voxels.voxel_m)
            )
        labelled = [o for o in neighbours if o.confirmed]
        separate = [o for o in labelled if not self._is_rather_part(entry, o)]
        supports_plane = self._supports_plane(entry) or encloses(entry, separate, self._voxels.voxel_m)
        continuing = self._continuing_sides(entry, labelled)
        if plane is not None and continuing < STRUCTURE_SIDES and not supports_plane and not holder:
            self._store.set_box(entry, self._with_seat(entry, seen_box, plane, neighbours))
        # Regardless of its outline: an object that supports a plane, or encloses others, at two successive fits is
        # furniture.
        furniture = entry.confirmed and entry.supports_plane and supports_plane
        self._store.attach(entry, holder, supports_plane=supports_plane, continuing=continuing)
        if furniture or too_large(box, self._config):
            self._store.retire(entry)

    def _add_coincidences(self, entry: MapObject, neighbours: Sequence[MapObject]) -> None:
        """Add the evidence of a fit that an object is one with labelled ones in its place: solids share no space.

        It does not depend on how the frame shows them: two pieces of a bowl may be seen side by side, and the box of
        each is that of the bowl.
        """
        others = [o for o in neighbours if o.confirmed and len(o.points) and not o.moved]
        if not others or entry.moved:
            return
        iou = iou_matrix(self._store.boxes_of([entry]), self._store.boxes_of(others))[0]
        for k in np.flatnonzero(iou >= COINCIDENT_IOU).tolist():
            self._store.add_pair_evidence(entry, others[k], SAME_LOG_ODDS, novelty=1.0)

    def _is_rather_part(self, entry: MapObject, other: MapObject) -> bool:
        """Return whether two objects are rather one than two: a plant covers its pot, and is no furniture."""
        log_odds = self._store.affinity.of(entry.number, other.number)
        return log_odds is not None and log_odds > 0.0

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

    def _continuing_sides(self, entry: MapObject, labelled: Sequence[MapObject]) -> int:
        """Return how many sides of an object, its top included, continue into a surface outside all objects."""
        owned = np.zeros(self._store.numbers, np.uint8)
        owned[[entry.number, *(o.number for o in labelled)]] = 1
        top, sides = continues(entry.box, entry.points, self._voxels, owned)
        return sides + top

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
