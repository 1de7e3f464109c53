"""Changes of the evidence, the box and the points of an object, and of the evidence that two objects are one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.se3 import transform
from cuboid.method.boxes.measured_sides import along_axes
from cuboid.method.objects.entry import MapObject, ObjectRecord, State, summed_counts, with_direction
from cuboid.method.objects.naming import counted_view, merged_evidence, with_scores
from cuboid.method.objects.store.objects import StoredObjects
from cuboid.method.surfaces.frame_segments import FrameSegment

# A segment says no more than this about its object, log-odds: the fitted score is less sure in places unlike those of
# its fit.
MAX_LOG_ODDS = 4.0


class ObjectEvidence(StoredObjects):
    """Changes of what is known of an object; its label stays."""

    # --- evidence --------------------------------------------------------------------------------------------------

    def see(
        self,
        entry: MapObject,
        segment: FrameSegment,
        similarity: float | None,
        eye: Float64Array,
        *,
        weight: float,
        moving: bool,
    ) -> None:
        """Add a sighting: a segment of a frame that matches an object, or starts it.

        Outline and similarity are sums over the sightings, each with the weight of its frame: a near copy of the last
        frame adds almost nothing.

        Parameters
        ----------
        entry : MapObject
        segment : FrameSegment
        similarity : float or None
            Of the segment and the object, 0..1; None for the segment that starts an object.
        eye : (3,) float64
            Position of the camera in the map.
        weight : float
            Weight of the frame as evidence, 0..1.
        moving : bool
            Whether something moves at the segment: its outline is then no evidence.
        """
        if not moving:
            entry.outline = entry.outline + weight * segment.outline
        entry.sightings += weight
        if similarity is not None:
            entry.compared += weight
            entry.agreement += weight * similarity
        entry.largest_px = max(entry.largest_px, len(segment.pixels))
        entry.directions = with_direction(entry.directions, entry.center - eye)
        if segment.supports:
            entry.supports = summed_counts(entry.supports, segment.supports)

    def add_score(self, entry: MapObject, log_odds: float, weight: float) -> None:
        """Add the fitted score of a segment of an object: the log-odds that it shows one whole thing."""
        entry.whole_log_odds += weight * min(max(log_odds, -MAX_LOG_ODDS), MAX_LOG_ODDS)
        entry.scored += weight

    def record_shown(self, entry: MapObject, *, weight: float, matched: bool) -> None:
        """Add the weight of a frame with pixels of an object, and note whether one of its segments matches it."""
        entry.shown += weight
        entry.missed = 0.0 if matched else entry.missed + weight

    def record_missed(self, entry: MapObject, weight: float) -> None:
        """Add the weight of a frame in which the place of an object is seen, and the object is not."""
        entry.missed += weight

    def judge(self, entry: MapObject, probability: float) -> None:
        """Set the probability that an object is one whole thing."""
        entry.probability = probability

    def doubt(self, entry: MapObject, log_odds: float) -> None:
        """Set the doubt that an object is in its place; see `presence`."""
        entry.doubt = log_odds

    def record_seen(self, entries: Iterable[ObjectRecord], frame: int) -> None:
        """Count a frame that shows objects; `last_frame` is the last frame that was counted."""
        for entry in entries:
            entry.frames_seen += 1
            entry.last_frame = frame

    def add_name_evidence(
        self, entry: ObjectRecord, scores: Mapping[str, float], visible: float, eye: Float64Array
    ) -> float:
        """Add a detector's scores for one object, empty if it detects nothing there, to the evidence for its name.

        Each direction of view is counted, and its n-th sighting has 1/n of the weight. Return the weight, 0..1.

        Parameters
        ----------
        entry : ObjectRecord
        scores : mapping of str to float
            Scores by class, `MIN_CLASS_SCORE` or more; absent classes were not detected.
        visible : float
            Visible fraction of the object.
        eye : (3,) float64
            Position of the camera in the map.
        """
        entry.views, novelty = counted_view(entry.views, eye - entry.center)
        weight = visible * novelty
        entry.name_log_odds = with_scores(entry.name_log_odds, scores, weight)
        return weight

    def merge_names(self, kept: ObjectRecord, other: ObjectRecord) -> None:
        """Add the evidence for the name of another object that is the same one."""
        kept.name_log_odds = merged_evidence(kept.name_log_odds, other.name_log_odds)

    def add_pair_evidence(self, a: MapObject, b: MapObject, log_odds: float, *, novelty: float) -> None:
        """Add the evidence of a frame that two living objects are one, or that they are two; see `Affinity`."""
        self.affinity.add_evidence(a.number, b.number, log_odds, novelty=novelty)

    def begin_visit(self, max_sightings: float) -> None:
        """Limit the weight of earlier sightings of living objects with depth, so that boxes are soon refitted."""
        for entry in self.living():
            limit_sightings(entry, max_sightings)

    # --- box and points --------------------------------------------------------------------------------------------

    def place(self, entry: MapObject, box: Box) -> None:
        """Set the place of an object: its box, moved as a whole, so that its measured sides are those of the same axes.

        The table of boxes has the same box as long as the object is alive.
        """
        entry.box = box
        if entry.state is not State.RETIRED:
            self._boxes.place(entry.number, box)

    def fit(
        self,
        entry: MapObject,
        box: Box,
        *,
        points: Float32Array,
        colors: UInt8Array,
        heat: float,
        keyframe: int,
        plane: int | None,
        supports: dict[int, int],
        filled: float,
        noise_m: float,
        sides_m: Float64Array,
    ) -> None:
        """Set the result of a fit to the voxels that an object owns now.

        Box, points, plane and keyframe always belong to the same fit, the one at `fitted` sightings.

        Parameters
        ----------
        entry : MapObject
        box : Box
        points, colors : (N, 3) float32 and (N, 3) uint8
        heat : float
        keyframe : int
        plane : int or None
            Identity of its supporting plane.
        supports : dict of int to int
            Pixels above each plane; the next fit chooses the plane from these and from later sightings.
        filled : float
            Area of the points over the area of the box.
        noise_m : float
            Standard deviation of the points, metres.
        sides_m : (V, 4) float64
            As for `set_box`.
        """
        self.postpone_fit(entry)
        entry.points, entry.colors, entry.heat, entry.keyframe = points, colors, heat, keyframe
        entry.plane, entry.supports, entry.filled, entry.noise_m = plane, supports, filled, noise_m
        self.set_box(entry, box, sides_m)

    def set_box(self, entry: MapObject, box: Box, sides_m: Float64Array | None = None) -> None:
        """Set another box of an object, and its views along the axes of that box.

        Parameters
        ----------
        entry : MapObject
        box : Box
        sides_m : (V, 4) float64, optional
            Sides by the edges of its top, and their standard deviations, along the axes of the box. By default those
            that it has; none if the axes are others.
        """
        if sides_m is None:
            sides_m = along_axes(entry.sides_m, entry.box, box)
        if len(entry.sides_m) and not len(sides_m):
            entry.measured = 0  # it is measured anew
        entry.sides_m = sides_m
        self.place(entry, box)

    def count_measured(self, entry: MapObject) -> None:
        """Note that the sides of an object were measured, clear or not: the next time is later."""
        entry.measured = entry.sightings

    def postpone_fit(self, entry: MapObject) -> None:
        """Count all sightings as fitted: the next fit waits for further ones."""
        entry.fitted = entry.sightings

    def attach(self, entry: MapObject, holder: int, *, supports_plane: bool, continuing: int = 0) -> None:
        """Set what a fit says of the support of an object, and add its evidence that it is one with its holder.

        Parameters
        ----------
        entry : MapObject
        holder : int
            Number of the object to which it is attached; 0 if a plane or another object supports it from below.
        supports_plane : bool
            Whether it supports its plane, as furniture does.
        continuing : int
            Number of its sides that continue into a surface outside all objects.
        """
        entry.holder, entry.supports_plane, entry.continuing = holder, supports_plane, continuing
        # An object that was seen to move is not a part of the object that it touches now.
        if holder and not entry.moved:
            self.affinity.add_attachment(entry.number, holder)

    def reset_support(self, entry: MapObject) -> None:
        """Forget on what an object stands: the next fit chooses its plane from later sightings alone."""
        entry.plane, entry.supports = None, {}

    def keep_points(self, entry: MapObject, kept: npt.NDArray[np.bool_]) -> None:
        """Keep only some points (N,) of an object, with their colors."""
        entry.points, entry.colors = entry.points[kept], entry.colors[kept]

    # --- motion ----------------------------------------------------------------------------------------------------

    def forget_keyframes(self, entries: Sequence[MapObject]) -> None:
        """Note that a frame has fused points of objects: most may be anchored to another keyframe now."""
        for entry in entries:
            entry.keyframe = -1

    def apply_correction(self, moved: Mapping[int, Float64Array]) -> None:
        """Transform each living object with the keyframe to which most of its points are anchored.

        Parameters
        ----------
        moved : mapping of int to (4, 4) float64
            T_new_old in the world for each keyframe that moved.
        """
        stored = self._voxels.stored
        for entry in self.living():
            if entry.keyframe < 0:
                entry.keyframe = stored.keyframe_of(stored.rows_of(entry.number))
            T = moved.get(entry.keyframe)
            if T is not None:
                R, t = T[:3, :3], T[:3, 3]
                self.place(entry, Box(R @ entry.box.center + t, entry.box.size, R @ entry.box.rotation))
                entry.points = transform(T, entry.points).astype(np.float32)
                entry.views = turned_views(entry.views, R)
                entry.directions = entry.directions @ R.T.astype(np.float32)


def limit_sightings(entry: MapObject, max_sightings: float) -> None:
    """Limit the weight of the sightings of an object; the means of its evidence stay; new ones soon change them."""
    before, after = entry.sightings, min(entry.sightings, max_sightings)
    if after >= before:
        return
    fraction = after / before
    entry.sightings, entry.fitted, entry.measured = after, min(entry.fitted, after), min(entry.measured, after)
    entry.shown *= fraction
    entry.outline = fraction * entry.outline
    entry.compared *= fraction
    entry.agreement *= fraction
    entry.whole_log_odds *= fraction
    entry.scored *= fraction


def turned_views(views: Float64Array, R: Float64Array) -> Float64Array:
    """Return counted directions of view (V, 4), rotated by R (3, 3)."""
    return np.hstack([views[:, :3] @ R.T, views[:, 3:]])
