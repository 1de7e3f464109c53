"""Views of a run as it goes: nothing, or a labelled video."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from cuboid.core.errors import OutputError
from cuboid.core.frame import Frame, Intrinsics
from cuboid.core.results import FrameResult, TrackedObject, names_of
from cuboid.views.drawing import Status, draw_frame
from cuboid.views.encoding import Mp4Writer
from cuboid.views.tags import SteadyNames

# Depth cameras of this kind run at 30 frames/s. Where only every n-th frame is used the video keeps the pace
# of the scene, down to a rate at which motion can still be followed.
FRAMES_PER_SECOND = 30.0
SLOWEST_FRAMES_PER_SECOND = 5.0


def video_rate(every: int) -> float:
    """Return the frames a second of a video that shows every n-th frame of a recording."""
    return max(FRAMES_PER_SECOND / every, SLOWEST_FRAMES_PER_SECOND)


class FrameSink(Protocol):
    """Shown every used frame of a run."""

    def show(self, frame: Frame, result: FrameResult, objects: Sequence[TrackedObject]) -> None:
        """Show a frame, what was found in it, and all objects known after it."""

    def close(self, complete: bool) -> None:
        """End; `complete` is False where the run was broken off."""


class VideoView:
    """Writes every frame with its labelled boxes into an MP4.

    Parameters
    ----------
    path : Path
        The file; it appears when the view is closed.
    intrinsics : Intrinsics
        Of the frames that will be shown.
    fps : float
        Frames a second of the video.
    """

    def __init__(self, path: Path, intrinsics: Intrinsics, fps: float) -> None:
        self._intrinsics = intrinsics
        self._writer = Mp4Writer(path, fps)
        self._steady = SteadyNames()

    def show(self, frame: Frame, result: FrameResult, objects: Sequence[TrackedObject]) -> None:
        """Append a frame.

        Raises
        ------
        OutputError
            The file cannot be written.
        """
        hidden = hidden_objects(result, objects)
        status = Status(
            frame=frame.index,
            seen=len(result.sightings),
            known=result.objects_known,
        )
        picture = draw_frame(
            frame.color, result.T_world_camera, self._intrinsics, result.sightings, hidden, status,
            names=names_of(objects), steady=self._steady,
        )  # fmt: skip
        self._writer.add(picture)

    def close(self, complete: bool) -> None:
        """Finish the file with the frames shown so far.

        Parameters
        ----------
        complete : bool
            False where the run was broken off: what can be kept is kept, and a failure to keep it does not
            hide what broke the run off.

        Raises
        ------
        OutputError
            The file cannot be written; only for a complete run.
        """
        with contextlib.nullcontext() if complete else contextlib.suppress(OutputError):
            self._writer.close()


def hidden_objects(result: FrameResult, objects: Sequence[TrackedObject]) -> list[TrackedObject]:
    """Return the known objects that a frame does not see."""
    seen = {sighting.label for sighting in result.sightings}
    return [item for item in objects if item.label not in seen]
