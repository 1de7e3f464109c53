"""What lies in a result folder, read when it is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from cuboid.errors import InputError
from cuboid.outputs import (
    ObjectsFile,
    PoseRow,
    RunReport,
    TrackRow,
    read_map,
    read_objects,
    read_run,
    read_tracks,
    read_trajectory,
)
from cuboid.outputs.folder import MAP, OBJECTS, RUN, TRACKS, TRAJECTORY
from cuboid.readers import Recording
from cuboid.readers.reopen import reopen_recording
from cuboid.results import MapPoints, TrackedObject
from cuboid.views.replay import used_frames


@dataclass(frozen=True)
class FinishedRun:
    """The results that `cuboid track` left in a folder; a file of them is read when it is first asked for.

    Attributes
    ----------
    folder : Path
        The result folder.
    recording_path : Path or None
        Where the recording lies now; None where it still is where it was.
    """

    folder: Path
    recording_path: Path | None = None

    def __post_init__(self) -> None:
        if not self.folder.is_dir():
            raise InputError(f"{self.folder}: expected a folder with the results of 'cuboid track'")

    @cached_property
    def report(self) -> RunReport:
        """How the run went."""
        return read_run(self.folder / RUN)

    @cached_property
    def found(self) -> ObjectsFile:
        """Objects, planes, up and intrinsics."""
        return read_objects(self.folder / OBJECTS)

    @cached_property
    def tracks(self) -> list[TrackRow]:
        """Objects seen, by frame and label."""
        return sorted(read_tracks(self.folder / TRACKS), key=lambda row: (row.frame, row.label))

    @cached_property
    def points(self) -> MapPoints:
        """The global point map."""
        return read_map(self.folder / MAP)

    @cached_property
    def poses(self) -> dict[int, PoseRow]:
        """Camera pose and time of each used frame, by its number in the recording.

        Raises
        ------
        InputError
            `trajectory.txt` has another number of lines than `run.json` has used frames.
        """
        rows, frames = read_trajectory(self.folder / TRAJECTORY), used_frames(self.report)
        if len(rows) != len(frames):
            raise InputError(
                f"{self.folder / TRAJECTORY}: expected {len(frames)} lines, one a used frame, got {len(rows)}"
            )
        return dict(zip(frames, rows, strict=True))

    @cached_property
    def survivor(self) -> dict[int, TrackedObject]:
        """The object that each label ended as: its own, or the one that it was merged into."""
        ended = {label: item for item in self.found.objects for label in item.merged_labels}
        return ended | {item.label: item for item in self.found.objects}

    @cached_property
    def recording(self) -> Recording:
        """The recording of the results.

        Raises
        ------
        InputError
            It is not there, or is another one.
        """
        path = self.recording_path or Path(self.report.recording)
        last_frame = max(self.poses, default=-1)
        report = self.report
        return reopen_recording(
            path, report.format, self.found.intrinsics, report.distortion, report.depth_camera, last_frame
        )
