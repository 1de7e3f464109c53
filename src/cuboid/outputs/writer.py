"""Results written while a run goes: rows leave memory with their frame."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
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
        self._keep: Callable[[str, str], None] = lambda name, text: None

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

    def go_on(self, texts: Mapping[str, str], keep: Callable[[str, str], None]) -> None:
        """Begin with the rows of a run that was broken off, and tell of each new text where it goes.

        Parameters
        ----------
        texts : mapping of str to str
            By the name of the file.
        keep : callable
            Told the name of the file and the text.

        Raises
        ------
        OutputError
            The disk is full.
        """
        self._keep = keep
        files = {TRACKS: self._tracks, PROPOSALS: self._proposals, self._online: self._trajectory}
        for name, text in texts.items():
            with writing(self._folder.file(name), self._shown / name):
                files[name].write(text)

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
        tracks = (
            TrackRow(seen.label, seen.box, seen.iou, seen.visible, seen.rect_xyxy * pixels, frame, time_s).line()
            for seen in result.sightings
        )
        proposals = (
            ProposalRow(frame, time_s, own.label, own.box, own.score, own.rect_xyxy * pixels).line()
            for own in result.proposals
        )
        self._rows(TRACKS, self._tracks, tracks)
        self._rows(PROPOSALS, self._proposals, proposals)
        self._rows(self._online, self._trajectory, [PoseRow(time_s, result.T_world_camera).line()])

    def _rows(self, name: str, file: TextIO, lines: Iterable[str]) -> None:
        text = "".join(f"{line}\n" for line in lines)
        with writing(self._folder.file(name), self._shown / name):
            file.write(text)
        self._keep(name, text)

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
