"""What each frame of a recording shows by itself: its clusters and boxes, before any matching."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import numpy.typing as npt

from cuboid import open_recording
from cuboid.ground.arrays import Float64Array
from cuboid.ground.core import observation
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.results import FrameResult
from cuboid.ground.core.working import WorkingImage
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.overlap import pack
from cuboid.lab.evaluation.result import BoxRows, MapBoxes, Result
from cuboid.method.surfaces.frame_segments import FrameSegment, FrameSegments, points_of, segment_frame
from cuboid.runs.pipeline.options import RunHooks, TrackOptions
from cuboid.runs.pipeline.run import track_recording
from cuboid.runs.tracking.posed_tracker import PosedTracker
from scenes import Case


@dataclass(frozen=True, slots=True)
class Observation:
    """A cluster of one frame.

    Attributes
    ----------
    points : (N, 3) float64
        World, metres.
    pixels : (N,) int64
        Of the working image.
    box : Box
    plane : ((3,) float64, float) or None
        Normal and offset of what it stands on.
    label : int
        The label that the tracker gave it then, 0 none.
    """

    points: Float64Array
    pixels: npt.NDArray[np.int64]
    box: Box
    plane: tuple[Float64Array, float] | None
    label: int


@dataclass(frozen=True, slots=True)
class Observed:
    """The clusters of one frame.

    Attributes
    ----------
    frame : int
    eye : (3,) float64
        Where the camera was.
    width : int
        Of the working image.
    clusters : tuple of Observation
    """

    frame: int
    eye: Float64Array
    width: int
    clusters: tuple[Observation, ...]


class _Listening(PosedTracker):
    """A tracker that keeps what its frames show."""

    def __init__(self, *arguments: Any, every: int) -> None:
        super().__init__(*arguments)
        self.seen: list[Observed] = []
        self._every = every

    def update(self, frame: Frame, anchor: int = 0) -> FrameResult:
        """Take in a frame; keep its clusters with the boxes and labels that it was given."""
        clusters: list[FrameSegment] = []
        images: list[WorkingImage] = []

        def listen(seen: observation.Observation, *arguments: Any) -> FrameSegments:
            things = segment_frame(seen, *arguments)
            clusters.extend(things.segments)
            images.append(seen.image)
            return things

        with patch("cuboid.runs.tracking.posed_tracker.segment_frame", listen):
            result = super().update(frame, anchor)
        if frame.index % self._every == 0:
            parts = tuple(
                Observation(
                    points_of(cluster.pixels, images[0], result.T_world_camera),
                    cluster.pixels,
                    proposal.box,
                    self._plane_of(cluster),
                    proposal.label,
                )
                for cluster, proposal in zip(clusters, result.proposals, strict=True)
            )
            step = max(1, self.intrinsics.width // self.config.working_width_px)
            self.seen.append(Observed(frame.index, result.T_world_camera[:3, 3], self.intrinsics.width // step, parts))
        return result

    def _plane_of(self, cluster: FrameSegment) -> tuple[Float64Array, float] | None:
        """Return the plane that most of a cluster is above."""
        identity = max(cluster.supports, key=lambda k: (cluster.supports[k], -k), default=-1)
        plane = self._planes.find(identity)
        return None if plane is None else self._planes.in_world(plane)


def observe(case: Case, every: int = 1, limit: int | None = None) -> list[Observed]:
    """Track a recording and return what each n-th frame of it showed by itself."""
    made: list[_Listening] = []

    def make(intrinsics: Intrinsics, config: TrackerConfig, proposals: Any) -> PosedTracker:
        made.append(_Listening(intrinsics, config, proposals, every=every))
        return made[0]

    track_recording(open_recording(case.recording), None, TrackOptions(limit=limit), hooks=RunHooks(make_tracker=make))
    return made[0].seen


def as_result(frames: Iterable[int], rows: list[tuple[int, int, Box]]) -> Result:
    """Return (frame, label, box) of these frames as a result to be judged; the map is each label's last box."""
    table = BoxRows(
        np.array([row[0] for row in rows], np.int64),
        np.array([row[1] for row in rows], np.int64),
        pack([row[2] for row in rows]),
    )
    last = {label: box for _, label, box in rows}
    often = np.bincount(table.label, minlength=1)
    labels = sorted(last)
    known = MapBoxes(
        np.array(labels, np.int64),
        pack([last[label] for label in labels]),
        np.array([often[label] for label in labels], np.float64),
    )
    return Result(Path("benchmark"), table, known, frames=np.array(list(frames), np.int64))
