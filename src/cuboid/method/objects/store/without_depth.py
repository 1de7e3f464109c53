"""Changes of the evidence and the position of an object without depth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.se3 import transform
from cuboid.method.objects.affinity import MAX_LOG_ODDS
from cuboid.method.objects.entry import MapObject, ObjectWithoutDepth
from cuboid.method.objects.naming import counted_view
from cuboid.method.objects.store.evidence import ObjectEvidence, turned_views

# Factor on the information of earlier hits with each new one: poses drift, and the position with them.
FADING = 0.9


class EvidenceWithoutDepth(ObjectEvidence):
    """Changes of what is known of an object without depth; its label stays."""

    def add_hit(self, entry: ObjectWithoutDepth, read: float, keyframe: int) -> None:
        """Count a detection, with the fraction of its rectangle that has depth readings: `read` is the mean of all."""
        entry.hits, entry.keyframe = entry.hits + 1, keyframe
        entry.read += (read - entry.read) / entry.hits

    def add_look(self, entry: ObjectWithoutDepth, probability: float, weight: float, rivals: Sequence[int]) -> None:
        """Add a view of the place of an object, with the probability of its region there, 0: none.

        `rivals` are the numbers of the labelled objects that own pixels of it.
        """
        entry.looks += weight
        entry.regions += weight * probability
        entry.rivals = tuple(rivals)

    def add_direction(self, entry: ObjectWithoutDepth, toward: Float64Array) -> None:
        """Add the direction (3,) from an object to a camera that sees it."""
        entry.views, _ = counted_view(entry.views, toward)

    def show_box(self, entry: ObjectWithoutDepth, box: Box, probability: float) -> None:
        """Set the box of the readings of an object, if its region is at least as probable as the one so far."""
        if probability >= entry.likeliest:
            entry.seen_box, entry.likeliest = box, probability

    def add_ray(self, entry: ObjectWithoutDepth, information: Float64Array, vector: Float64Array) -> None:
        """Add the position from a detection, as information matrix (3, 3) and vector (3,); earlier ones fade."""
        entry.information = FADING * entry.information + information
        entry.vector = FADING * entry.vector + vector

    def add_size(self, entry: ObjectWithoutDepth, size_m: Float64Array, distance_m: float, weight: float) -> None:
        """Add the size (2,) of a detection from a distance, metres: size, scatter and distance are weighted means."""
        entry.weight += weight
        part = weight / entry.weight
        off_m = size_m - entry.size_m
        entry.size_m = entry.size_m + off_m * weight / entry.weight
        entry.size_scatter_m2 = (1.0 - part) * (entry.size_scatter_m2 + part * off_m**2)
        entry.distance_m += part * (distance_m - entry.distance_m)

    def add_evidence(self, entry: ObjectWithoutDepth, log_odds: float) -> None:
        """Add log-odds that an object exists; the sum stays within `MAX_LOG_ODDS` in both directions."""
        entry.log_odds = min(MAX_LOG_ODDS, max(-MAX_LOG_ODDS, entry.log_odds + log_odds))

    def count_meeting(self, entry: ObjectWithoutDepth, other: MapObject) -> int:
        """Count a frame in which an object has the rectangle of one of the map; return the number of such frames."""
        met = entry.meetings.get(other.number, 0) + 1
        entry.meetings = {**entry.meetings, other.number: met}
        return met

    def apply_correction_without_depth(self, moved: Mapping[int, Float64Array]) -> None:
        """Move objects without depth with the keyframes of their last detections, by (4, 4); see `apply_correction`."""
        for entry in self.without_depth():
            T = moved.get(entry.keyframe)
            if T is not None:
                R, center = T[:3, :3], transform(T, entry.center)
                entry.information = R @ entry.information @ R.T
                entry.vector = entry.information @ center
                entry.views = turned_views(entry.views, R)
                if entry.seen_box is not None:
                    entry.seen_box = entry.seen_box.moved(T)

    def _unite(
        self, kept: ObjectWithoutDepth, gone: ObjectWithoutDepth, vector: Float64Array, size_m: Float64Array
    ) -> None:
        """Unite all evidence of two objects; `vector` (3,) and `size_m` (2,) describe the rectangle of both."""
        kept.information, kept.vector, kept.size_m = kept.information + gone.information, vector, size_m
        kept.size_scatter_m2 = np.maximum(kept.size_scatter_m2, gone.size_scatter_m2)
        whole = max(kept.weight + gone.weight, 1e-9)
        kept.distance_m = (kept.weight * kept.distance_m + gone.weight * gone.distance_m) / whole
        kept.weight = max(kept.weight, gone.weight)
        kept.read = (kept.hits * kept.read + gone.hits * gone.read) / max(kept.hits + gone.hits, 1)
        kept.first_frame, kept.last_frame = (
            min(kept.first_frame, gone.first_frame),
            max(kept.last_frame, gone.last_frame),
        )
        kept.frames_seen = max(kept.frames_seen, gone.frames_seen)
        kept.views = np.vstack([kept.views, gone.views])
