"""The output folder: nothing in it looks whole before it is.

A run writes into a hidden working folder. A new output folder is that working folder, renamed in one step at
the end; where results of an earlier run are replaced (`force`), the working folder lies inside the output
folder, the old results stay until the new ones are complete, and ``run.json`` (which says that results are
complete) goes first and comes last.
"""

from __future__ import annotations

import errno
import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType

from cuboid.errors import OutputError

RUN = "run.json"
OBJECTS = "objects.json"
TRACKS = "tracks.csv"
PROPOSALS = "proposals.csv"
TRAJECTORY = "trajectory.txt"
TRAJECTORY_ONLINE = "trajectory_online.txt"
MAP = "map.ply"
VIDEO = "labelled.mp4"
REPORT = "report.html"

OUTPUT_NAMES = (OBJECTS, TRACKS, PROPOSALS, TRAJECTORY, TRAJECTORY_ONLINE, MAP, VIDEO, REPORT, RUN)


@contextmanager
def writing(path: Path, shown_as: Path | None = None) -> Iterator[None]:
    """Turn the system's refusal to write `path` into one line.

    Parameters
    ----------
    path : Path
        What is written.
    shown_as : Path, optional
        The name that the message gives it (the user never named a working folder).

    Raises
    ------
    OutputError
        The disk is full, the place is not writable, a file grew over the allowed size.
    """
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            reason = f"the disk is full ({reason})"
        raise OutputError(f"{shown_as or path}: cannot be written: {reason}") from error


class ResultFolder:
    """An output folder that appears, or changes, only when `commit` is called.

    Use it as a context manager: leaving it without `commit` removes all that was written.

    Parameters
    ----------
    path : Path
        The folder that the user named.
    force : bool
        Whether results that lie there may be replaced. Files of other names are never touched.

    Raises
    ------
    OutputError
        The folder exists and `force` is not given, it is a file, or it cannot be written.
    """

    def __init__(self, path: Path, *, force: bool = False) -> None:
        self.path = path
        self._real = Path(os.path.realpath(path))
        self._replace = self._real.is_dir()
        self._refuse(force)
        place = self._real if self._replace else self._real.parent
        with writing(path):
            place.mkdir(parents=True, exist_ok=True)
            self._working = place / f".{self._real.name}.{secrets.token_hex(4)}.partial"
            self._working.mkdir()

    def _refuse(self, force: bool) -> None:
        if self._replace and not force:
            raise OutputError(f"{self.path}: the output folder exists; --force replaces the results in it")
        if self._real.exists() and not self._replace:
            raise OutputError(f"{self.path}: is a file; the output must be a folder")

    def __enter__(self) -> ResultFolder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        shutil.rmtree(self._working, ignore_errors=True)

    def file(self, name: str) -> Path:
        """Return where the file of this name is written now."""
        return self._working / name

    def commit(self) -> None:
        """Let the results appear under the name that the user gave.

        Raises
        ------
        OutputError
            The output folder came into being during the run, or is no longer writable.
        """
        with writing(self.path):
            if self._replace:
                self._replace_results()
            else:
                self._working.rename(self._real)

    def _replace_results(self) -> None:
        (self._real / RUN).unlink(missing_ok=True)
        for name in OUTPUT_NAMES:
            if self.file(name).exists():
                self.file(name).replace(self._real / name)
            else:
                (self._real / name).unlink(missing_ok=True)
