"""Results written while a run goes: rows leave memory with their frame."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import TextIO

from cuboid.errors import OutputError
from cuboid.outputs.folder import (
    MAP,
    OBJECTS,
    PROPOSALS,
    RUN,
    TRACKS,
    TRAJECTORY,
    TRAJECTORY_ONLINE,
    ResultFolder,
    writing,
)
from cuboid.outputs.objects import ObjectsFile, write_objects
from cuboid.outputs.ply import write_map
from cuboid.outputs.report import RunReport, write_run
from cuboid.outputs.rows import PROPOSALS_HEADER, TRACKS_HEADER, PoseRow, ProposalRow, TrackRow
from cuboid.results import FrameResult, MapPoints


class ResultWriter:
    """Writes the files of one run; they appear in the output folder when `finish` returns.

    Use it as a context manager: leaving it without `finish` leaves nothing behind.

    Parameters
    ----------
    path : Path
        The output folder.
    force : bool
        Whether results that lie there may be replaced.
    corrected : bool
        Whether poses are corrected after their frames: each frame's goes to `trajectory_online.txt` then, and the
        corrected ones are given to `finish`.

    Raises
    ------
    OutputError
        The folder exists and `force` is not given, or it cannot be written.
    """

    def __init__(self, path: Path, *, force: bool = False, corrected: bool = False) -> None:
        self._folder = ResultFolder(path, force=force)
        self._shown = path
        self._online = TRAJECTORY_ONLINE if corrected else TRAJECTORY
        with ExitStack() as stack:
            stack.push(self._folder)
            with writing(path):
                self._tracks = stack.enter_context(self._open(TRACKS))
                self._proposals = stack.enter_context(self._open(PROPOSALS))
                self._trajectory = stack.enter_context(self._open(self._online))
                self._tracks.write(TRACKS_HEADER + "\n")
                self._proposals.write(PROPOSALS_HEADER + "\n")
            stack.pop_all()

    def __enter__(self) -> ResultWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for file in (self._tracks, self._proposals, self._trajectory):
            with suppress(OSError):  # the rows that a full disk refused are lost with their file
                file.close()
        self._folder.__exit__(kind, error, trace)

    @contextmanager
    def naming(self, name: str) -> Iterator[Path]:
        """Give the place where another file of the results (the video) is written until `finish`.

        Complaints about it that are raised inside name the output folder, not the hidden working folder.
        """
        path = self._folder.file(name)
        try:
            yield path
        except OutputError as error:
            raise OutputError(str(error).replace(str(path), str(self._shown / name))) from error

    def add(self, result: FrameResult, pixels: int = 1) -> None:
        """Write the rows of one frame.

        Parameters
        ----------
        result : FrameResult
            What the tracker found.
        pixels : int
            Side of the block of the recording's pixels that one pixel of the tracker's image covers.

        Raises
        ------
        OutputError
            The disk is full.
        """
        frame, time_s = result.index, result.timestamp_s
        with writing(self._folder.file(TRACKS), self._shown / TRACKS):
            for seen in result.sightings:
                rect = seen.rect_xyxy * pixels
                row = TrackRow(frame, time_s, seen.label, seen.box, seen.iou, seen.visible, rect)
                self._tracks.write(row.line() + "\n")
        with writing(self._folder.file(PROPOSALS), self._shown / PROPOSALS):
            for own in result.proposals:
                rect = own.rect_xyxy * pixels
                self._proposals.write(ProposalRow(frame, time_s, own.label, own.box, own.score, rect).line() + "\n")
        with writing(self._folder.file(self._online), self._shown / self._online):
            self._trajectory.write(PoseRow(time_s, result.T_world_camera).line() + "\n")

    def finish(
        self, objects: ObjectsFile, points: MapPoints, report: RunReport, corrected: Sequence[PoseRow] | None = None
    ) -> None:
        """Write the files of the run as a whole and let all results appear.

        Parameters
        ----------
        objects : ObjectsFile
        points : MapPoints
        report : RunReport
        corrected : sequence of PoseRow, optional
            The poses as corrected since.

        Raises
        ------
        OutputError
            The disk is full or the output folder came into being during the run.
        """
        self._write(OBJECTS, lambda path: write_objects(path, objects))
        self._write(MAP, lambda path: write_map(path, points))
        self._write(RUN, lambda path: write_run(path, report))
        if corrected is not None:
            lines = "".join(row.line() + "\n" for row in corrected)
            self._write(TRAJECTORY, lambda path: _write_text(path, lines))
        with writing(self._shown):
            for file in (self._tracks, self._proposals, self._trajectory):
                file.flush()
                os.fsync(file.fileno())
                file.close()
        self._folder.commit()

    def _open(self, name: str) -> TextIO:
        return self._folder.file(name).open("w", encoding="utf-8", newline="\n")

    def _write(self, name: str, write: Callable[[Path], None]) -> None:
        with writing(self._folder.file(name), self._shown / name):
            write(self._folder.file(name))


def _write_text(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", newline="\n")
