"""Interfaces of the loop over a recording, and the outcome of a run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.frame import Frame, Intrinsics, Rig
from cuboid.ground.core.results import FrameResult, MapPoints, SupportPlane, TrackedObject
from cuboid.inputs.readers import Recording
from cuboid.method.poses.sources import Posed
from cuboid.results.files import RunReport
from cuboid.results.files.object_table import ObjectTable
from cuboid.results.files.queries import MapQueries
from cuboid.results.views.live.watch import TrackerView

if TYPE_CHECKING:
    from cuboid.inputs.readers.depth_camera import DepthCamera
    from cuboid.method.proposals.types import ProposalSource
    from cuboid.results.views.video import FrameSink
    from cuboid.runs.tracking.preparing import PreparedImages


class RecordingLike(Protocol):
    """The interface of a recording; `cuboid.open_recording` returns one."""

    @property
    def path(self) -> Path:
        """Path of the recording."""

    @property
    def format(self) -> str:
        """Name of its format."""

    @property
    def intrinsics(self) -> Intrinsics:
        """Intrinsics of its images."""

    @property
    def distortion(self) -> tuple[float, ...]:
        """Coefficients of the lens distortion that was removed; empty if there was none."""

    @property
    def depth_units_per_metre(self) -> float:
        """Depth units per metre in its depth images."""

    @property
    def depth_camera(self) -> DepthCamera | None:
        """The depth camera whose images were registered to color; None if depth was already aligned."""

    @property
    def has_poses(self) -> bool:
        """Whether camera poses come with it."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """Likely faults of its files, one line each."""

    def __len__(self) -> int:
        """Return the number of frames, including unusable ones."""

    def read(self, index: int) -> Frame:
        """Return a frame; raises FrameError if it is unusable."""

    def pose(self, index: int) -> Float64Array | None:
        """Return a frame's pose; raises FrameError if it has none."""

    def without_poses(self) -> RecordingLike:
        """Return the same recording without its poses."""


@runtime_checkable
class RigLike(Protocol):
    """What a recording of several cameras has besides."""

    @property
    def rig(self) -> Rig:
        """The cameras, with their poses in the rig."""

    def settings(self) -> dict[str, Any]:
        """Return the entry of `run.json`."""


def lens_settings(recording: RecordingLike) -> dict[str, Any]:
    """Return the entries of `run.json` about the processing of a recording's images."""
    depth_camera = {} if recording.depth_camera is None else recording.depth_camera.document()
    return {
        "distortion": list(recording.distortion),
        "depth_units_per_metre": recording.depth_units_per_metre,
        **depth_camera,
        **(recording.pose_clock.settings() if isinstance(recording, Recording) else {}),
    }


class MapLike(TrackerView, Protocol):
    """The interface of a running tracker between two frames."""

    @property
    def config(self) -> TrackerConfig:
        """The configuration in use."""

    @property
    def points_known(self) -> int:
        """Points of the global point map."""

    @property
    def map_bytes(self) -> int:
        """Memory of the global point map."""

    def find_furniture(self, points: MapPoints) -> ObjectTable:
        """Return the furniture that bears the supporting planes, found among the points of the map."""


class KeptMap(MapQueries):
    """Queries of a map that another tracker owns."""

    _mapper: MapLike

    @property
    def config(self) -> TrackerConfig:
        """The configuration in use; its depth noise is raised to that of the first frame, if that is larger."""
        return self._mapper.config

    @property
    def planes(self) -> list[SupportPlane]:
        """The supporting planes."""
        return self._mapper.planes

    @property
    def up(self) -> Float64Array | None:
        """Up in the world, (3,); None while unknown."""
        return self._mapper.up

    @property
    def points_known(self) -> int:
        """Number of points in the global point map."""
        return self._mapper.points_known

    @property
    def map_bytes(self) -> int:
        """Memory of the global point map, bytes."""
        return self._mapper.map_bytes

    def map_points(self) -> MapPoints:
        """Return the global point map."""
        return self._mapper.map_points()

    def find_furniture(self, points: MapPoints | None = None) -> ObjectTable:
        """Find the furniture that bears the supporting planes, such as a table or a shelf; this takes 0.1 to 2 s.

        A piece gets a label when it is first found, and keeps it.

        Parameters
        ----------
        points : MapPoints, optional
            The present global point map, if the caller has it.

        Returns
        -------
        ObjectTable
            Objects of the kind "support", by label; `planes` are the planes that each bears.
        """
        return self._mapper.find_furniture(self.map_points() if points is None else points)


class TrackerLike(MapLike, Protocol):
    """A tracker of frames whose pose is known."""

    def update(self, frame: Frame, anchor: int = 0) -> FrameResult:
        """Process one frame, whose pose is anchored to a keyframe."""

    def apply_correction(self, moved: Mapping[int, Float64Array]) -> None:
        """Apply a pose correction: move the map, planes and objects with the keyframes, by (4, 4)."""


@runtime_checkable
class Preparing(Protocol):
    """A tracker of posed frames that can do a part of the next frames' work ahead; a `TrackerLike`, too."""

    def prepare(self, frame: Frame) -> PreparedImages:
        """Do the part of a frame's work that needs neither its pose nor the map."""

    def update(self, frame: Frame, anchor: int = 0, prepared: PreparedImages | None = None) -> FrameResult:
        """Process one frame, of which `prepared` may be given."""


@dataclass(frozen=True, slots=True)
class PreparedFrame:
    """A frame after the part of its work that needs no map.

    Attributes
    ----------
    frame : Frame
    posed : Posed or None
        Its pose; None if the frame cannot be used.
    images : PreparedImages or None
        Its images, if they were prepared ahead.
    refused : FrameError or None
        The fault of the frame, an error of the caller.
    reason : str
        Why the frame is skipped.
    milliseconds : mapping of str to float
        Times of the stages that were done ahead.
    """

    frame: Frame
    posed: Posed | None = None
    images: PreparedImages | None = None
    refused: FrameError | None = None
    reason: str = ""
    milliseconds: Mapping[str, float] = field(default_factory=dict)


class Progress:
    """Receives the progress of a run; this base class does nothing."""

    def start(self, frames: int | None) -> None:
        """Report the start of a run over this many frames; None if the number is unknown."""

    def frame(self, result: FrameResult) -> None:
        """Report that a frame was used."""

    def skipped(self, index: int, reason: str) -> None:
        """Report that a frame was skipped."""

    def warning(self, line: str) -> None:
        """Report a problem that the run goes on with, such as a camera that was knocked or pulled out."""


MakeTracker = Callable[[Intrinsics, TrackerConfig, "str | ProposalSource | None"], TrackerLike]
MakeFrameSink = Callable[[Path, Intrinsics, int], "FrameSink"]
Watch = Callable[[Frame, FrameResult, MapLike], None]


@dataclass(frozen=True, slots=True)
class RunOutcome:
    """The outcome of a run: objects, report, times.

    Attributes
    ----------
    report : RunReport
    objects : tuple of TrackedObject
    planes : tuple of SupportPlane
    up : (3,) float64 or None
    milliseconds : mapping of str to sequence of float
        Times of every used frame, warm-up included, for "frame" and for each stage.
    frames_per_second : float
        Used frames per second, after warm-up.
    points : int
        Number of points in the global point map at the end.
    map_bytes : int
        Memory of the global point map, bytes.
    furniture : tuple of TrackedObject
        The furniture that bears the supporting planes; empty unless requested.
    """

    report: RunReport
    objects: tuple[TrackedObject, ...]
    planes: tuple[SupportPlane, ...]
    up: Float64Array | None
    milliseconds: Mapping[str, Sequence[float]]
    frames_per_second: float
    points: int
    map_bytes: int
    furniture: tuple[TrackedObject, ...] = ()

    def __repr__(self) -> str:
        report = self.report
        frames = f"{report.frames_used} of {report.frames_read} frames in {report.seconds:.1f} s"
        return f"RunOutcome({len(self.objects)} objects; {frames})"

    def _repr_html_(self) -> str:
        """Show the objects and a summary of the run in a notebook."""
        report, found = self.report, ObjectTable(self.objects)
        line = f"{report.frames_used} of {report.frames_read} frames in {report.seconds:.1f} s"
        return f"{found._repr_html_()}<p>{line}</p>"
