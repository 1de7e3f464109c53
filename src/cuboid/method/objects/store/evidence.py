"""Changes of the evidence, the box and the points of an object, and of the evidence that two objects are one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.se3 import transform
from cuboid.method.objects.affinity import MAX_LOG_ODDS
from cuboid.method.objects.entry import MapObject, ObjectRecord, State, summed_counts
from cuboid.method.objects.naming import counted_view, merged_evidence, with_scores
from cuboid.method.objects.store.objects import StoredObjects
from cuboid.method.surfaces.frame_segments import FrameSegment


class ObjectEvidence(StoredObjects):
    """Changes of what is known of an object; its label stays."""

    # --- evidence --------------------------------------------------------------------------------------------------

    def add_evidence(self, entry: ObjectRecord, log_odds: float) -> None:
        """Add log-odds that an object is one; the sum stays within `MAX_LOG_ODDS` in both directions."""
        entry.log_odds = min(MAX_LOG_ODDS, max(-MAX_LOG_ODDS, entry.log_odds + log_odds))

    def see(self, entry: MapObject, segment: FrameSegment, log_odds: float) -> None:
        """Add a sighting: a segment of a frame that matches an object, and the log-odds that it adds.

        Outline and pixels above each plane are always the sums over the `sightings`.
        """
        self.add_evidence(entry, log_odds)
        entry.outline = entry.outline + segment.outline
        entry.sightings += 1
        if segment.supports:
            entry.supports = summed_counts(entry.supports, segment.supports)

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
            Scores by class, `MIN_SCORE` or more; absent classes were not detected.
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

    def add_pair_evidence(self, a: MapObject, b: MapObject, *, same: bool, novelty: float) -> None:
        """Add the evidence of a frame that two living objects are one, or that they are two; see `Affinity`."""
        self.affinity.add_evidence(a.number, b.number, same=same, novelty=novelty)

    def add_attachment(self, entry: MapObject, novelty: float) -> None:
        """Add the evidence of a frame that an object is one with its holder, if that one is alive; see `Affinity`."""
        if entry.holder and entry.holder in self and self[entry.holder].state is not State.RETIRED:
            self.affinity.add_attachment(entry.number, entry.holder, novelty)

    def begin_visit(self, max_sightings: int) -> None:
        """Limit the number of earlier sightings of living objects with depth, so that boxes are soon refitted."""
        for entry in self.living():
            entry.sightings = min(entry.sightings, max_sightings)
            entry.fitted = min(entry.fitted, max_sightings)

    # --- box and points --------------------------------------------------------------------------------------------

    def place(self, entry: MapObject, box: Box) -> None:
        """Set the box of an object; the table of boxes has the same one as long as the object is alive."""
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
        """
        self.postpone_fit(entry)
        entry.points, entry.colors, entry.heat, entry.keyframe = points, colors, heat, keyframe
        entry.plane, entry.supports = plane, supports
        self.place(entry, box)

    def postpone_fit(self, entry: MapObject) -> None:
        """Count all sightings as fitted: the next fit waits for further ones."""
        entry.fitted = entry.sightings

    def attach(self, entry: MapObject, holder: int, *, supports_plane: bool) -> None:
        """Set what a fit says of the support of an object.

        Parameters
        ----------
        entry : MapObject
        holder : int
            Number of the object to which it is attached; 0 if a plane or another object supports it from below.
        supports_plane : bool
            Whether it supports its plane, as furniture does.
        """
        entry.holder, entry.supports_plane = holder, supports_plane

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


def turned_views(views: Float64Array, R: Float64Array) -> Float64Array:
    """Return counted directions of view (V, 4), rotated by R (3, 3)."""
    return np.hstack([views[:, :3] @ R.T, views[:, 3:]])
