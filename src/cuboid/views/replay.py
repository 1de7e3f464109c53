"""A finished run again, frame by frame, from its result folder: what was seen, what was known but hidden."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from cuboid.errors import InputError
from cuboid.frame import Float64Array, Intrinsics
from cuboid.geometry.box import Box
from cuboid.outputs import (
    ObjectsFile,
    ProposalRow,
    RunReport,
    TrackRow,
    read_objects,
    read_proposals,
    read_run,
    read_tracks,
    read_trajectory,
)
from cuboid.outputs.folder import OBJECTS, PROPOSALS, RUN, TRACKS, TRAJECTORY
from cuboid.outputs.text import LENGTH, number


@dataclass(frozen=True, slots=True)
class Known:
    """An object that is known in a frame.

    Attributes
    ----------
    label : int
    box : Box
        In the world, as it was last seen up to that frame.
    """

    label: int
    box: Box


@dataclass(frozen=True, slots=True)
class ReplayedFrame:
    """What the results say of one frame.

    Attributes
    ----------
    index : int
        Of the recording.
    T_world_camera : (4, 4) float64
    sightings : tuple of TrackRow
    proposals : tuple of ProposalRow
    hidden : tuple of Known
        Known objects that the frame does not see.
    """

    index: int
    T_world_camera: Float64Array
    sightings: tuple[TrackRow, ...]
    proposals: tuple[ProposalRow, ...]
    hidden: tuple[Known, ...]

    @property
    def known(self) -> int:
        """Objects known in this frame, seen or not."""
        return len(self.sightings) + len(self.hidden)


class Replay:
    """The results of a run, frame by frame.

    Parameters
    ----------
    folder : Path
        What `cuboid track` left behind.

    Attributes
    ----------
    recording : Path
        Where the recording lay.
    format : str
        Name of its layout.
    intrinsics : Intrinsics
        Of its color image.
    distortion : tuple of float
        Of its lens, as it was taken out.
    depth_camera : DepthCamera or None
        From which depth was carried into color.
    every : int
        One in so many frames was used.
    frames_per_second : float or None
        Of the tracker: one over its median time of a frame.

    Raises
    ------
    InputError
        The folder is not a result folder, or a file in it is malformed.
    """

    def __init__(self, folder: Path) -> None:
        report, found = open_results(folder)
        self.recording = Path(report.recording)
        self.format = report.format
        self.intrinsics: Intrinsics = found.intrinsics
        self.distortion = report.distortion
        self.depth_camera = report.depth_camera
        self.every = _every(report)
        median_ms = report.milliseconds["frame"].median_ms if "frame" in report.milliseconds else 0.0
        self.frames_per_second = 1e3 / median_ms if median_ms > 0 else None
        self._lasting = {item.label for item in found.objects}
        self._poses = read_trajectory(folder / TRAJECTORY)
        self._sightings: dict[int, list[TrackRow]] = defaultdict(list)
        self._proposals: dict[int, list[ProposalRow]] = defaultdict(list)
        for row in read_tracks(folder / TRACKS):
            self._sightings[row.frame].append(row)
        for own in read_proposals(folder / PROPOSALS):
            self._proposals[own.frame].append(own)
        self._used = used_frames(report)

    def __len__(self) -> int:
        """Return how many frames were used."""
        return len(self._poses)

    @property
    def last_frame(self) -> int:
        """The last frame of the recording that was used; -1 where none was."""
        return self._used[-1] if self._used else -1

    def frames(self, timestamp_of: Callable[[int], float]) -> Iterator[ReplayedFrame]:
        """Iterate over the frames that have a pose, in order.

        Parameters
        ----------
        timestamp_of : callable
            Seconds of a frame of the recording: lines of the trajectory have no frame numbers.
        """
        poses = iter(self._poses)
        pose = next(poses, None)
        boxes: dict[int, Box] = {}
        for index in self._used:
            if pose is None or number(pose.timestamp_s, LENGTH) != number(timestamp_of(index), LENGTH):
                continue
            sightings = tuple(self._sightings.get(index, ()))
            boxes.update((row.label, row.box) for row in sightings)
            seen = {row.label for row in sightings}
            hidden = tuple(
                Known(label, box)
                for label, box in sorted(boxes.items())
                if label not in seen and label in self._lasting
            )
            proposals = tuple(self._proposals.get(index, ()))
            yield ReplayedFrame(index, pose.T_world_camera, sightings, proposals, hidden)
            pose = next(poses, None)


def open_results(folder: Path) -> tuple[RunReport, ObjectsFile]:
    """Return how a run went and what it found.

    Raises
    ------
    InputError
        The folder is not a result folder, or a file in it is malformed.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: expected a folder with the results of 'cuboid track'")
    return read_run(folder / RUN), read_objects(folder / OBJECTS)


def used_frames(report: RunReport) -> list[int]:
    """Return the frames of the recording that a run used, ascending."""
    skipped = {frame for frame, _ in report.skipped}
    every = _every(report)
    return [index for index in range(0, report.frames_read * every, every) if index not in skipped]


def _every(report: RunReport) -> int:
    return int(report.config.get("every", 1))
