"""Views of a run in progress: none, or a labelled video."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from cuboid.ground.core.errors import OutputError
from cuboid.ground.core.frame import Frame, Intrinsics, RigCamera
from cuboid.ground.core.results import FrameResult, TrackedObject, names_of
from cuboid.results.views.drawing import Status, draw_frame, hidden_objects
from cuboid.results.views.encoding import Mp4Writer
from cuboid.results.views.mosaic import CamerasVideo
from cuboid.results.views.tags import SteadyNames

# RGB-D cameras run at 30 frames/s. If only every n-th frame is used, the video keeps the speed of the scene, down to
# the lowest rate at which motion can still be followed.
FRAMES_PER_SECOND = 30.0
SLOWEST_FRAMES_PER_SECOND = 5.0


def video_rate(every: int) -> float:
    """Return the frame rate, frames/s, of a video that shows every n-th frame of a recording."""
    return max(FRAMES_PER_SECOND / every, SLOWEST_FRAMES_PER_SECOND)


class FrameSink(Protocol):
    """Receives every used frame of a run."""

    def show(self, frame: Frame, result: FrameResult, objects: Sequence[TrackedObject]) -> None:
        """Show a frame, its results, and all objects of the map after it."""

    def close(self, complete: bool) -> None:
        """End the view; `complete` is False if the run was interrupted or failed."""


class VideoView:
    """Writes every frame with its labelled boxes into an MP4; pictures of a rig's cameras are side by side.

    Parameters
    ----------
    path : Path
        The file; it appears when the view is closed.
    intrinsics : Intrinsics
        Of the frames that will be shown.
    fps : float
        Frame rate of the video, frames/s.
    cameras : sequence of RigCamera
        Cameras of the frames, if there are several.
    """

    def __init__(self, path: Path, intrinsics: Intrinsics, fps: float, cameras: Sequence[RigCamera] = ()) -> None:
        self._intrinsics = intrinsics
        self._writer = Mp4Writer(path, fps)
        self._video = CamerasVideo(self._writer, cameras)
        self._steady: dict[str, SteadyNames] = {}

    def show(self, frame: Frame, result: FrameResult, objects: Sequence[TrackedObject]) -> None:
        """Append a frame.

        Raises
        ------
        OutputError
            The file cannot be written.
        """
        hidden = hidden_objects(result.sightings, objects)
        status = Status(frame.index, seen=len(result.sightings), known=result.objects_known)
        picture = draw_frame(
            frame.color,
            result.T_world_camera,
            frame.intrinsics_or(self._intrinsics),
            result.sightings,
            hidden,
            status,
            names=names_of(objects),
            steady=self._steady.setdefault(frame.camera_name, SteadyNames()),
        )
        self._video.add(frame.camera_name, picture)

    def close(self, complete: bool) -> None:
        """Finish the file with the frames shown so far.

        Parameters
        ----------
        complete : bool
            False if the run was interrupted or failed. The frames so far are kept if possible; an error in doing so
            does not hide the error that ended the run.

        Raises
        ------
        OutputError
            The file cannot be written; only for a complete run.
        """
        with contextlib.nullcontext() if complete else contextlib.suppress(OutputError):
            self._video.finish()
            self._writer.close()
