"""The files of a finished run together: each read when it is asked for, and held against the others."""

from __future__ import annotations

from contextlib import suppress
from functools import cached_property

from cuboid.errors import InputError
from cuboid.outputs.folder import MAP, OBJECTS, PROPOSALS, RUN, TRACKS, TRAJECTORY, finish_replacing
from cuboid.outputs.objects import ObjectsFile, read_objects
from cuboid.outputs.ply import read_map
from cuboid.outputs.report import RunReport, read_run
from cuboid.outputs.rows import (
    PoseRow,
    ProposalRow,
    TrackRow,
    read_proposal_labels,
    read_proposals,
    read_tracks,
    read_trajectory,
)
from cuboid.paths import PathLike, as_path
from cuboid.results import MapPoints, TrackedObject


class FinishedResults:
    """The results that `cuboid track` left in a folder; a file of them is read when it is first asked for.

    Parameters
    ----------
    folder : path
        The result folder.

    Attributes
    ----------
    folder : Path

    Raises
    ------
    InputError
        There is no such folder; or, when a file is asked for, it is missing, malformed, or does not fit the others.
    """

    def __init__(self, folder: PathLike) -> None:
        self.folder = as_path(folder)
        if not self.folder.is_dir():
            raise InputError(f"{self.folder}: expected a folder with the results of 'cuboid track'")
        with suppress(OSError):  # of a folder that cannot be written, what is there is read
            finish_replacing(self.folder)

    @cached_property
    def report(self) -> RunReport:
        """How the run went."""
        return read_run(self.folder / RUN)

    @cached_property
    def found(self) -> ObjectsFile:
        """Objects, planes, up and intrinsics."""
        return read_objects(self.folder / OBJECTS)

    @cached_property
    def points(self) -> MapPoints:
        """The global point map."""
        return read_map(self.folder / MAP)

    @cached_property
    def poses(self) -> dict[int, PoseRow]:
        """Camera pose and time of each used frame, by its number in the recording, in order."""
        rows = read_trajectory(self.folder / TRAJECTORY)
        if len(rows) != self.report.frames_used:
            raise InputError(
                f"{self.folder / TRAJECTORY}: expected {self.report.frames_used} lines, one a used frame of {RUN}, "
                f"got {len(rows)}"
            )
        return dict(zip(self.report.used().tolist(), rows, strict=True))

    @cached_property
    def tracks(self) -> list[TrackRow]:
        """Objects seen, by frame and label."""
        rows = sorted(read_tracks(self.folder / TRACKS), key=lambda row: (row.frame, row.label))
        self._refuse_unused(TRACKS, rows)
        return rows

    @cached_property
    def proposals(self) -> list[ProposalRow]:
        """The frames' own boxes, in the order of the file."""
        rows = read_proposals(self.folder / PROPOSALS)
        self._refuse_unused(PROPOSALS, rows)
        return rows

    @cached_property
    def proposal_labels(self) -> list[int]:
        """The label of each of the frames' own boxes, 0 for none."""
        return read_proposal_labels(self.folder / PROPOSALS)

    @cached_property
    def survivor(self) -> dict[int, TrackedObject]:
        """The object that each label ended as: its own, or the one that it was merged into."""
        ended = {label: item for item in self.found.objects for label in item.merged_labels}
        return ended | {item.label: item for item in self.found.objects}

    @property
    def last_frame(self) -> int:
        """The last frame of the recording that was used; -1 where none was."""
        return next(reversed(self.poses), -1)

    def _refuse_unused(self, name: str, rows: list[TrackRow] | list[ProposalRow]) -> None:
        strange = {row.frame for row in rows} - self.poses.keys()
        if strange:
            raise InputError(f"{self.folder / name}: frame {min(strange)} is not among the used frames of {RUN}")
