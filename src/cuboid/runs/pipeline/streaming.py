"""Live frames, whose number is not known in advance, as input of the loop over a recording."""

from __future__ import annotations

from collections import Counter
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.frame import Frame, Intrinsics, Rig
from cuboid.inputs.cameras.live_rig import LiveRig
from cuboid.inputs.recordings.rig import RigRecording
from cuboid.method.poses.sources import NO_POSE
from cuboid.runs.pipeline.loop import Decoded

if TYPE_CHECKING:
    from cuboid.inputs.readers import Recording
    from cuboid.inputs.readers.depth_camera import DepthCamera

GONE = "a live camera's frames are gone; --record keeps them"
# Name of the format, in results, for a camera whose frames were not recorded.
FORMAT = "camera"


@runtime_checkable
class FrameSource(Protocol):
    """A source of frames: a live camera, or any other iterable object with these attributes.

    Attributes
    ----------
    name : str
        Name in messages and results.
    intrinsics : Intrinsics
        Intrinsics of every frame.
    depth_units_per_metre : float
        Depth units per metre in the original depth images.
    has_poses : bool
        Whether frames come with a camera pose.
    dropped : int
        Number of frames dropped so far because they were not read in time.
    record : Path or None
        Folder in which the frames are recorded, complete after the iteration has ended.
    warnings : list of str
        Problems so far.
    """

    name: str
    intrinsics: Intrinsics
    depth_units_per_metre: float
    has_poses: bool
    record: Path | None
    warnings: list[str]

    @property
    def dropped(self) -> int:
        """Number of frames dropped so far because they were not read in time."""

    def __iter__(self) -> Iterator[Frame]:
        """Iterate over the frames in order, with indices from 0; raises InputError if there is none."""


class Stream:
    """Adapts a source of frames to the interface of a recording; frames can be read again only if they are recorded.

    Parameters
    ----------
    source : FrameSource
    """

    distortion: tuple[float, ...] = ()
    depth_camera: DepthCamera | None = None

    def __init__(self, source: FrameSource) -> None:
        self.source = source
        self.path, self.format = source.record or Path(source.name), FORMAT
        self.intrinsics = source.intrinsics
        self.depth_units_per_metre = source.depth_units_per_metre
        self.has_poses = source.has_poses
        self._poses: dict[int, Float64Array] = {}
        self._count = 0
        self._kept: Recording | None = None

    @property
    def warnings(self) -> tuple[str, ...]:
        """Problems of the source so far."""
        return tuple(self.source.warnings)

    def __len__(self) -> int:
        """Return the number of frames so far."""
        return self._count

    def without_poses(self) -> Stream:
        """Return the same stream: the estimation of poses ignores the poses of frames."""
        return self

    def pose(self, index: int) -> Float64Array | None:
        """Return the pose that came with a frame; raises FrameError if it had none."""
        if not self.has_poses:
            return None
        if index not in self._poses:
            raise FrameError(NO_POSE)
        return self._poses[index]

    def read(self, index: int) -> Frame:
        """Read a frame again; raises FrameError if it was not recorded."""
        if self._kept is None:
            raise FrameError(GONE)
        return self._kept.read(index)

    def decode(self, every: int, limit: int | None) -> Generator[Decoded, None, None]:
        """Iterate over each n-th frame of each camera, at most `limit`; closing the iterator ends the source, too."""
        given, frames = 0, iter(self.source)
        seen: Counter[str] = Counter()  # the frames of each camera
        try:
            while given != limit:
                frame = next(frames, None)
                if frame is None:
                    return
                self._count = frame.index + 1
                seen[frame.camera_name] += 1
                if (seen[frame.camera_name] - 1) % every:
                    continue
                if frame.T_world_camera is not None:
                    self._poses[frame.index] = frame.T_world_camera
                yield Decoded(frame.index, frame, "", 0.0)  # waiting for a camera does not count as decoding
                given += 1
        finally:
            if isinstance(frames, Generator):
                frames.close()
            self._reopen()

    def _reopen(self) -> None:
        """Open the recording of the frames, if there is one, so that frames can be read again."""
        if self.source.record is not None and self.source.record.is_dir():
            from cuboid.inputs.recordings.opening import OFF, open_recording

            self._kept = open_recording(self.source.record, register=OFF)
            self.path, self.format = self._kept.path, self._kept.format
            self.depth_units_per_metre = self._kept.depth_units_per_metre


class RigStream(Stream):
    """Adapts the live cameras of a rig.

    Parameters
    ----------
    source : LiveRig
    """

    def __init__(self, source: LiveRig) -> None:
        super().__init__(source)
        self._cameras = source

    @property
    def rig(self) -> Rig:
        """The cameras with their poses in the rig."""
        return self._cameras.rig

    @property
    def kept(self) -> Recording | None:
        """The recording of the frames, after the run; None if there is none."""
        return self._kept

    def settings(self) -> dict[str, Any]:
        """Return the entry of `run.json`."""
        return self._kept.settings() if isinstance(self._kept, RigRecording) else self._cameras.settings()


def stream_of(source: FrameSource) -> Stream:
    """Return a source of frames with the interface of a recording."""
    return RigStream(source) if isinstance(source, LiveRig) else Stream(source)
