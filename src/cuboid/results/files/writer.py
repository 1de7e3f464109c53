"""Writing of results during a run: the rows of each frame are written at once."""

from __future__ import annotations

import os
import tempfile
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, TextIO

from cuboid.ground.core.errors import OutputError
from cuboid.ground.core.paths import PathLike
from cuboid.ground.core.results import FrameResult, MapPoints, Sighting
from cuboid.ground.formats.folder import (
    AGENTS,
    EVENTS,
    MAP,
    OBJECTS,
    PROPOSALS,
    RUN,
    TRACKS,
    TRAJECTORY,
    TRAJECTORY_ONLINE,
    VIEWS,
    ResultFolder,
    writing,
)
from cuboid.results.files.objects import ObjectsFile, write_objects
from cuboid.results.files.ply import write_map
from cuboid.results.files.report import RunReport, write_run
from cuboid.results.files.rows import (
    AGENTS_HEADER,
    EVENTS_HEADER,
    PROPOSALS_HEADER,
    RIG_TRACKS_HEADER,
    TRACKS_HEADER,
    AgentRow,
    EventRow,
    PoseRow,
    ProposalRow,
    TrackRow,
)

if TYPE_CHECKING:
    from cuboid.method.shapes.keeping import ViewKeeper

# Rows of a run without an output folder stay in memory up to this size per file; larger ones go to disk.
MAX_IN_MEMORY_BYTES = 1 << 22


# Files that exist only if something moves, with their headers.
OPTIONAL = {EVENTS: EVENTS_HEADER, AGENTS: AGENTS_HEADER}


class ResultWriter:
    """Writes the files of one run; they appear in the output folder when `finish` returns.

    Use it as a context manager: leaving it without `finish` removes all that was written.

    Parameters
    ----------
    path : path
        The output folder.
    force : bool
        Whether results in the folder may be replaced.
    corrected : bool
        Whether poses are corrected after their frames: then the first pose of each frame goes to
        `trajectory_online.txt`, and `finish` gets the corrected ones.
    rig : bool
        Whether frames come from several cameras: then `tracks.csv` names the camera of each row.

    Raises
    ------
    OutputError
        The folder exists and `force` is not given, or it cannot be written.
    """

    def __init__(self, path: PathLike, *, force: bool = False, corrected: bool = False, rig: bool = False) -> None:
        self._folder = ResultFolder(path, force=force)
        self._shown = self._folder.path
        self._online = TRAJECTORY_ONLINE if corrected else TRAJECTORY
        with ExitStack() as stack:
            stack.push(self._folder)
            with writing(self._shown):
                names = TRACKS, PROPOSALS, self._online
                self._files = {name: stack.enter_context(self._open(name)) for name in names}
                self._files[TRACKS].write((RIG_TRACKS_HEADER if rig else TRACKS_HEADER) + "\n")
                self._files[PROPOSALS].write(PROPOSALS_HEADER + "\n")
            stack.pop_all()
        self._keep: Callable[[str, str], None] = lambda name, text: None

    def __enter__(self) -> ResultWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for file in self._files.values():
            with suppress(OSError):  # the rows that a full disk refused are lost with their file
                file.close()
        self._folder.__exit__(kind, error, trace)

    @contextmanager
    def naming(self, name: str) -> Iterator[Path]:
        """Yield the path at which another file of the results (the video) is written until `finish`.

        OutputErrors inside the context name the output folder, not the hidden working folder.
        """
        path = self._folder.file(name)
        try:
            yield path
        except OutputError as error:
            raise OutputError(str(error).replace(str(path), str(self._shown / name))) from error

    def go_on(self, texts: Mapping[str, str], keep: Callable[[str, str], None] | None = None) -> None:
        """Continue with the rows of an interrupted run, and pass each new text to `keep`.

        Parameters
        ----------
        texts : mapping of str to str
            Rows so far, by the name of the file.
        keep : callable, optional
            Called with the name of the file and each new text.

        Raises
        ------
        OutputError
            The disk is full.
        """
        self._keep = keep or self._keep
        for name, text in texts.items():
            self._write_rows(name, text)

    def add(self, result: FrameResult, pixels: int = 1) -> None:
        """Write the rows of one frame.

        Parameters
        ----------
        result : FrameResult
            Results of the tracker.
        pixels : int
            Factor from pixels of the tracker's image to pixels of the recording.

        Raises
        ------
        OutputError
            The disk is full.
        """
        names = TRACKS, PROPOSALS, self._online, *OPTIONAL
        for name, lines in zip(names, lines_of(result, pixels), strict=True):
            if lines or name not in OPTIONAL:
                text = "".join(f"{line}\n" for line in lines)
                self._write_rows(name, text)
                self._keep(name, text)

    def _write_rows(self, name: str, text: str) -> None:
        """Write rows of a file; an optional file is created with its first rows."""
        with writing(self._folder.file(name), self._shown / name):
            if name not in self._files:
                self._files[name] = self._open(name)
                self._files[name].write(OPTIONAL[name] + "\n")
            self._files[name].write(text)

    def finish(
        self,
        objects: ObjectsFile,
        points: MapPoints,
        report: RunReport,
        corrected: Sequence[PoseRow] | None = None,
        views: ViewKeeper | None = None,
    ) -> None:
        """Write the files that cover the whole run, and publish all results.

        Parameters
        ----------
        objects : ObjectsFile
        points : MapPoints
        report : RunReport
        corrected : sequence of PoseRow, optional
            The corrected poses.
        views : ViewKeeper, optional
            The stored views of the objects.

        Raises
        ------
        OutputError
            The disk is full, or another program created the output folder during the run.
        """
        self._write(OBJECTS, lambda path: write_objects(path, objects))
        self._write(MAP, lambda path: write_map(path, points))
        self._write(RUN, lambda path: write_run(path, report))
        if views is not None:
            self._write(VIEWS, lambda path: path.write_bytes(views.content()))
        if corrected is not None:
            lines = "".join(row.line() + "\n" for row in corrected)
            self._write(TRAJECTORY, lambda path: _write_text(path, lines))
        with writing(self._shown):
            for file in self._files.values():
                file.flush()
                os.fsync(file.fileno())
                file.close()
        self._folder.commit()

    def _open(self, name: str) -> TextIO:
        return self._folder.file(name).open("w", encoding="utf-8", newline="\n")

    def _write(self, name: str, write: Callable[[Path], object]) -> None:
        with writing(self._folder.file(name), self._shown / name):
            write(self._folder.file(name))


class RowLog:
    """The rows of a run whose output folder is not known yet: few rows in memory, more in temporary files."""

    def __init__(self) -> None:
        with ExitStack() as stack:
            self._files = [stack.enter_context(_spooled()) for _ in range(3 + len(OPTIONAL))]
            weakref.finalize(self, stack.pop_all().close)

    def add(self, result: FrameResult) -> None:
        """Store the rows of one frame."""
        for file, lines in zip(self._files, lines_of(result), strict=True):
            file.writelines(f"{line}\n" for line in lines)

    def texts(self, *, corrected: bool) -> dict[str, str]:
        """Return the rows by the name of their file; `corrected` as in `ResultWriter`."""
        names = TRACKS, PROPOSALS, TRAJECTORY_ONLINE if corrected else TRAJECTORY, *OPTIONAL
        texts = {}
        for name, file in zip(names, self._files, strict=True):
            file.seek(0)
            texts[name] = file.read()
        return {name: text for name, text in texts.items() if text or name not in OPTIONAL}


def _spooled() -> tempfile.SpooledTemporaryFile[str]:
    return tempfile.SpooledTemporaryFile(MAX_IN_MEMORY_BYTES, "w+", encoding="utf-8", newline="\n")


def lines_of(result: FrameResult, pixels: int = 1) -> tuple[list[str], ...]:
    """Return the lines of one frame in `tracks.csv`, `proposals.csv`, the trajectory, `events.csv` and `agents.csv`.

    Parameters
    ----------
    result : FrameResult
    pixels : int
        As in `ResultWriter.add`.
    """
    frame, time_s = result.index, result.timestamp_s
    tracks = [_track_row(seen, pixels, result).line() for seen in result.sightings]
    proposals = [
        ProposalRow(proposal.label, proposal.box, proposal.score, proposal.rect_xyxy * pixels, frame, time_s).line()
        for proposal in result.proposals
    ]
    events = [EventRow.of(event, result).line() for event in result.events]
    agents = [AgentRow(frame, time_s, box).line() for box in result.agents]
    return tracks, proposals, [PoseRow(time_s, result.T_world_camera).line()], events, agents


def _track_row(seen: Sighting, pixels: int, result: FrameResult) -> TrackRow:
    values = seen.label, seen.box, seen.iou, seen.visible, seen.rect_xyxy * pixels
    frame = result.index, result.timestamp_s
    return TrackRow(*values, *frame, probability=seen.probability, camera=result.camera)


def _write_text(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", newline="\n")
