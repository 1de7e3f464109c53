"""The tracker: from frames with or without camera poses to their sightings, and to a result folder at the end."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cuboid.ground.compiling.compiletime import working_s
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.limits import MEMORY_MB
from cuboid.ground.core.paths import PathLike, as_path
from cuboid.ground.core.tolerances import DETECT_EVERY
from cuboid.method.poses.sources import checked_origin
from cuboid.results.files.writer import RowLog
from cuboid.runs.tracking.checks import own_warnings
from cuboid.runs.tracking.running import RunningTracker
from cuboid.runs.tracking.types import RecordingLike

if TYPE_CHECKING:
    from cuboid.method.detection.types import Detector
    from cuboid.method.proposals.types import ProposalSource


class Tracker(RunningTracker):
    """Finds the objects of a static scene in RGB-D frames and keeps their labels; `cuboid track` is built on it.

    Parameters
    ----------
    intrinsics : Intrinsics
        Intrinsics of every frame that does not come with a camera of a rig (`Frame.camera`).
    config : TrackerConfig, optional
    proposals : str or ProposalSource, optional
        Name of a source of 2D proposals, with its options, or any callable from (frame, intrinsics) to `Proposals`.
    poses : {"given", "auto", "corrected", "estimated", "synchronised"}, optional
        Source of the camera poses. "given": the pose of each frame, unchanged. "synchronised": the same, but the offset
        between the clocks of poses and images is measured in the first 10 s, and corrected if it is certain; for
        frames of a live source, as `cuboid.open_recording` does it for recordings. "auto": the same, with a warning if
        the poses drift. "corrected": given poses, corrected if they drift. "estimated": from the video. By default the
        first frame decides: "given" if it has a pose, otherwise "estimated".
    memory_mb : float
        Memory limit of the process, in units of 2**20 bytes, above which parts of the map out of view are evicted; they
        are loaded again when accessed.
    detector : str or Detector, optional
        File of an ONNX model, or name of a detector, with its options; or any callable from (frame, intrinsics) to
        `Detections`. Objects get names from it.
    detector_every : int
        The detector processes each n-th frame.
    shapes : bool
        Keep views of the objects, in memory and in the results, so that `mesh` does not need the recording.

    Raises
    ------
    InputError
        If the intrinsics are of another type, or no proposal source or detector has that name.
    ValueError
        If `poses` is none of these words, or `detector_every` is less than 1.

    Examples
    --------
    >>> recording = cuboid.open_recording("my-recording")  # doctest: +SKIP
    >>> tracker = cuboid.Tracker(recording.intrinsics)  # doctest: +SKIP
    >>> for frame in recording:  # doctest: +SKIP
    ...     print([seen.label for seen in tracker.update(frame).sightings])
    >>> tracker.save("results", recording=recording)  # doctest: +SKIP
    """

    def __init__(
        self,
        intrinsics: Intrinsics,
        config: TrackerConfig | None = None,
        proposals: str | ProposalSource | None = None,
        *,
        poses: str | None = None,
        memory_mb: float = MEMORY_MB,
        detector: str | Detector | None = None,
        detector_every: int = DETECT_EVERY,
        shapes: bool = False,
    ) -> None:
        from cuboid.runs.tracking.posed_tracker import PosedTracker

        if not isinstance(intrinsics, Intrinsics):
            raise InputError(
                "expected intrinsics as cuboid.Intrinsics(fx, fy, cx, cy, width, height), "
                f"got {type(intrinsics).__name__}"
            )
        config, rows = config or TrackerConfig(), RowLog()
        origin = None if poses is None else checked_origin(poses)
        mapper = PosedTracker(intrinsics, config, proposals, memory_mb=memory_mb)
        mapper.use_detector(detector, detector_every)
        super().__init__(intrinsics, config, mapper, origin, rows.add, shapes=shapes)
        self._begun_s, self._proposals, self._rows = working_s(), proposals, rows
        self._detector, self._detector_every = detector, detector_every

    @property
    def warnings(self) -> tuple[str, ...]:
        """Likely faults of the frames, one line each."""
        return own_warnings(self)

    def save(
        self,
        output: PathLike,
        *,
        recording: RecordingLike | None = None,
        force: bool = False,
        relations: bool = False,
        furniture: bool = True,
    ) -> None:
        """Write the result folder that `cuboid track` writes: objects, sightings, poses, map, report, 3D page.

        Parameters
        ----------
        output : path
            The folder; it is created if necessary.
        recording : RecordingLike, optional
            The recording of the frames: `run.json` names it, and the 3D page gets images of the objects.
        force : bool
            Replace existing results in `output`.
        relations : bool
            Find the relations of the objects and include them in the results; this takes 0.1 to 2 s.
        furniture : bool
            Include the furniture that bears the supporting planes, see `find_furniture`.

        Raises
        ------
        OutputError
            If the folder exists and `force` is not given, or if it cannot be written.
        """
        from cuboid.method.detection import detector_name
        from cuboid.method.proposals import source_name
        from cuboid.runs.tracking.saving import save_results

        settings: dict[str, Any] = {"proposals": source_name(self._proposals)}
        if self._detector is not None:
            settings |= {"detector": detector_name(self._detector), "detector_every": self._detector_every}
            settings["vocabulary"] = list(self.vocabulary)
        settings["tracker"] = self.config.to_dict()
        seconds = working_s() - self._begun_s
        output = as_path(output)
        save_results(
            self,
            self._rows,
            output,
            recording,
            settings,
            seconds,
            force=force,
            relations=relations,
            furniture=furniture,
        )
