"""What a detector adds to a tracker: names, and things that depth does not read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cuboid.core.frame import Float64Array, Frame
from cuboid.core.observation import Observation
from cuboid.core.results import Sighting, TrackedObject
from cuboid.core.tolerances import DETECT_EVERY
from cuboid.detection import make_detector
from cuboid.detection.types import Detections, Detector
from cuboid.objects.entry import MapObject
from cuboid.objects.naming import chosen_name, name_objects, name_scores
from cuboid.objects.store import ObjectStore
from cuboid.objects.unread import UnreadMap
from cuboid.objects.unread_object import Planes, box_of, size_sigma_of
from cuboid.objects.visibility import Visibility
from cuboid.tracking.rolling import Roll


class Detecting:
    """A detector that looks at some frames of a tracker, or none.

    Attributes
    ----------
    vocabulary : tuple of str
        Classes of the detector, once it has looked at a frame.
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
        """Whether there is a detector."""
        return self._detect is not None

    def begin(self, store: ObjectStore, far_m: float) -> None:
        """Begin with a map of objects; things that depth does not read begin no farther away than `far_m`."""
        self._unread = UnreadMap(store, far_m)

    @property
    def unread(self) -> UnreadMap:
        """The things that depth does not read."""
        return self._unread

    def is_due(self, count: int) -> bool:
        """Tell whether the detector looks at a frame that `count` others came before."""
        return self._detect is not None and count % self._every == 0

    def look(
        self, given: Frame, roll: Roll, visible: Sequence[tuple[MapObject, Visibility]], seen: Observation
    ) -> None:
        """Let the detector look at a frame as it was given, and add what it sees to the evidence.

        Parameters
        ----------
        given : Frame
        roll : Roll
            By which the image of `seen` is turned.
        visible : sequence of (MapObject, Visibility)
            The objects of the map that the frame shows.
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
        name_objects(turned, [(entry, view.visible, view.rect_xyxy) for entry, view in visible], seen.eye)
        self._unread.look(turned, visible, seen)

    def sightings(self, shown: Sequence[Sighting], seen: Observation, planes: Planes) -> tuple[Sighting, ...]:
        """Return the sightings of a frame with those of things that depth does not read."""
        return self._unread.sightings(shown, seen, planes)

    @property
    def labelled(self) -> int:
        """How many things that depth does not read have a label."""
        return len(self._unread.confirmed())

    def objects(self, planes: Planes, T_world_map: Float64Array) -> list[TrackedObject]:
        """Return the things with a label that depth does not read, by label, in the world."""
        found = []
        for one in self._unread.confirmed():
            box, kind = box_of(one, planes)
            found.append(
                TrackedObject(
                    label=one.label,
                    box=box.moved(T_world_map),
                    score=one.score,
                    heat=0.0,
                    first_frame=one.first_frame,
                    last_frame=one.last_frame,
                    frames_seen=one.frames_seen,
                    points=0,
                    mean_color=np.zeros(3),
                    plane=None,
                    merged_labels=tuple(one.merged_labels),
                    kind=kind,
                    size_sigma_m=tuple(size_sigma_of(one, planes, kind).tolist()),
                    **chosen_name(name_scores(one.name_log_odds)),
                )
            )
        return found

    def apply_correction(self, moved: Mapping[int, Float64Array]) -> None:
        """Move things with their keyframes; see `ObjectMap.apply_correction`."""
        self._unread.apply_correction(moved)
