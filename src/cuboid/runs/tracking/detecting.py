"""The detector's part in a tracker: names, and objects without depth readings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.frame import Frame
from cuboid.ground.core.observation import Observation
from cuboid.ground.core.results import Sighting, TrackedObject
from cuboid.ground.core.tolerances import DETECT_EVERY
from cuboid.method.detection import make_detector
from cuboid.method.detection.types import Detections, Detector
from cuboid.method.objects.box_without_depth import Planes, box_of, size_sigma_of
from cuboid.method.objects.detection_votes import add_votes, name_objects
from cuboid.method.objects.entry import MapObject, ObjectRecord
from cuboid.method.objects.naming import chosen_name, name_scores
from cuboid.method.objects.store import ObjectStore
from cuboid.method.objects.visibility import Visibility
from cuboid.method.objects.without_depth import WithoutDepth
from cuboid.runs.tracking.rolling import Roll


def same_fields(entry: ObjectRecord) -> dict[str, Any]:
    """Return the fields of results that objects with and without depth readings have in common."""
    names = ("label", "score", "first_frame", "last_frame", "frames_seen")
    return {
        **{name: getattr(entry, name) for name in names},
        "merged_labels": tuple(entry.merged_labels),
        **chosen_name(name_scores(entry.name_log_odds)),
    }


class Detecting:
    """A detector that processes some frames of a tracker; there may be none.

    Attributes
    ----------
    vocabulary : tuple of str
        Classes of the detector, after it has processed a frame.
    """

    def __init__(self) -> None:
        self._detect: Detector | None = None
        self._every = DETECT_EVERY
        self.vocabulary: tuple[str, ...] = ()

    def use(self, detector: str | Detector | None, every: int) -> None:
        """Use a detector; see `PosedTracker.use_detector`."""
        if every < 1:
            raise ValueError(f"a detector looks at each n-th frame, n >= 1, got {every}")
        self._detect = None if detector is None else make_detector(detector)
        self._every = every

    @property
    def is_used(self) -> bool:
        """Whether a detector is in use."""
        return self._detect is not None

    def begin(self, store: ObjectStore, config: TrackerConfig) -> None:
        """Start with a map of objects."""
        self._store, self._without_depth = store, WithoutDepth(store, config)

    @property
    def without_depth(self) -> WithoutDepth:
        """The objects without depth readings."""
        return self._without_depth

    def is_due(self, count: int) -> bool:
        """Return whether the detector processes a frame with `count` earlier frames."""
        return self._detect is not None and count % self._every == 0

    def detect(
        self, given: Frame, roll: Roll, visible: Sequence[tuple[MapObject, Visibility]], seen: Observation
    ) -> None:
        """Run the detector on an unrotated frame, and add its detections to the evidence.

        Parameters
        ----------
        given : Frame
        roll : Roll
            Rotation of the image of `seen`.
        visible : sequence of (MapObject, Visibility)
            The visible objects of the map.
        seen : Observation
        """
        assert self._detect is not None
        camera = roll.intrinsics
        found = self._detect(given, camera)
        if not isinstance(found, Detections):
            raise TypeError(f"a detector must return cuboid.Detections, got {type(found).__name__}")
        if len(found) and (found.boxes_xyxy[:, 2:] > (camera.width, camera.height)).any():
            raise ValueError(
                f"detections of frame {given.index} lie outside its {camera.width} x {camera.height} pixels"
            )
        self.vocabulary = self.vocabulary or tuple(name for name in found.names if name)
        turned = roll.detections(found)
        name_objects(turned, visible, self._store, seen.eye)
        # The detections stand for all frames up to the next ones: segments vote in each of them.
        add_votes(turned, visible, self._store, min(1.0, self._every * seen.weight))
        self._without_depth.update(turned, visible, seen)

    def sightings(
        self, shown: Sequence[Sighting], seen: Observation, planes: Planes, min_probability: float
    ) -> tuple[Sighting, ...]:
        """Return the sightings of a frame, including those of objects without depth readings."""
        return self._without_depth.sightings(shown, seen, planes, min_probability)

    @property
    def labelled(self) -> int:
        """Number of labelled objects without depth readings."""
        return len(self._without_depth.confirmed())

    def objects(self, planes: Planes, T_world_map: Float64Array) -> list[TrackedObject]:
        """Return the labelled objects without depth readings, by label, in the world; the map has the pose (4, 4)."""
        found = []
        for entry in self._without_depth.confirmed():
            box, kind = box_of(entry, planes)
            found.append(
                TrackedObject(
                    **same_fields(entry),
                    box=box.moved(T_world_map),
                    heat=0.0,
                    points=0,
                    mean_color=np.zeros(3),
                    plane=None,
                    kind=kind,
                    size_sigma_m=tuple(size_sigma_of(entry, planes, kind).tolist()),
                )
            )
        return found

    def apply_correction(self, moved: Mapping[int, Float64Array]) -> None:
        """Move objects with their keyframes, by (4, 4); see `ObjectMap.apply_correction`."""
        self._store.apply_correction_without_depth(moved)
