"""The output folder: results appear only when complete, and old results are kept until then.

A run writes into a hidden working folder. A new output folder is that working folder, renamed in one step at the end.
If results of an earlier run are replaced (`force`), the working folder lies inside the output folder. The old
results stay until the new ones are complete; then the working folder gets the name `COMPLETE`, in one step, and its
files replace the old ones: the old ``run.json``, which says that results are complete, is deleted first, and the new
one comes last. A process that is killed in between leaves `COMPLETE` behind; the next process that opens the folder
finishes the work (`finish_replacing`).

A working folder is locked while its run lives, so that folders of killed runs can be recognised and removed.
"""

from __future__ import annotations

import errno
import glob
import os
import secrets
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType

from cuboid.ground.core.errors import OutputError
from cuboid.ground.core.paths import PathLike, as_path
from cuboid.ground.locks import lock_folder, release

RUN = "run.json"
OBJECTS = "objects.json"
TRACKS = "tracks.csv"
PROPOSALS = "proposals.csv"
TRAJECTORY = "trajectory.txt"
TRAJECTORY_ONLINE = "trajectory_online.txt"
MAP = "map.ply"
EVENTS = "events.csv"
AGENTS = "agents.csv"
VIDEO = "labelled.mp4"
PICTURE = "labelled.png"
REPORT = "report.html"
VIEWS = "views.zip"
EMBEDDINGS = "embeddings.npz"

# Complete results inside an output folder whose old ones they are about to replace, and the list of their files.
COMPLETE = ".complete"
# A younger working folder may not be locked yet, seconds.
YOUNG_S = 5.0
NAMES = "names"

OUTPUT_NAMES = (
    OBJECTS,
    TRACKS,
    PROPOSALS,
    TRAJECTORY,
    TRAJECTORY_ONLINE,
    EVENTS,
    AGENTS,
    MAP,
    VIDEO,
    PICTURE,
    REPORT,
    VIEWS,
    EMBEDDINGS,
    RUN,
)


@contextmanager
def writing(path: Path, shown_as: Path | None = None) -> Iterator[None]:
    """Turn the system's errors in writing `path` into one line.

    Parameters
    ----------
    path : Path
        The file or folder.
    shown_as : Path, optional
        Its name in the message: the user does not know the working folder. Default: `path`.

    Raises
    ------
    OutputError
        The disk is full, the place is not writable, or a file is larger than allowed.
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
    path : path
        The folder that the user named.
    force : bool
        Whether results in the folder may be replaced. Files with other names are never changed.

    Raises
    ------
    OutputError
        The folder exists, or another run is writing it, and `force` is not given; it is a file, or it cannot be
        written.
    """

    def __init__(self, path: PathLike, *, force: bool = False) -> None:
        self.path = as_path(path)
        with writing(self.path):
            self._real, self._force = Path(os.path.realpath(path)), force
            self._replace = self._real.is_dir()
            self._refuse(force)
            place = self._real if self._replace else self._real.parent
            place.mkdir(parents=True, exist_ok=True)
            if self._replace:
                finish_replacing(self._real)
            if _remove_abandoned(place, self._real.name) and not force:
                raise OutputError(f"{self.path}: another run is writing this folder; name another output folder")
            self._working = place / f".{self._real.name}.{secrets.token_hex(4)}.partial"
            self._working.mkdir()
            self._lock = lock_folder(self._working)

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
        release(self._lock)

    def file(self, name: str) -> Path:
        """Return the path at which the file with this name is written until `commit`."""
        return self._working / name

    def commit(self) -> None:
        """Publish the results under the user's name.

        Raises
        ------
        OutputError
            The output folder was created by another program during the run, or is no longer writable.
        """
        with writing(self.path):
            if not self._real.is_dir():
                self._working.rename(self._real)
                return
            if not self._replace:
                self._enter()
            lock = lock_folder(self._real)  # of two runs into one folder, the second to end replaces the first
            try:
                finish_replacing(self._real, locked=True)
                names = [name for name in OUTPUT_NAMES if self.file(name).exists()]
                self.file(NAMES).write_text("\n".join(names), encoding="utf-8")
                self._working.rename(self._real / COMPLETE)
                finish_replacing(self._real, locked=True)
            finally:
                release(lock)

    def _enter(self) -> None:
        """Move the working folder into the output folder, which another run made meanwhile."""
        if not self._force:
            raise OutputError(
                f"{self.path}: the output folder came into being during the run, and is not replaced without --force; "
                "nothing was written"
            )
        self._working = self._working.rename(self._real / self._working.name)
        self._replace = True


def finish_replacing(folder: Path, *, locked: bool = False) -> None:
    """Finish replacing old results by complete ones, also after the run that began it was killed.

    Parameters
    ----------
    folder : Path
        An output folder.
    locked : bool
        Whether the caller holds the lock of the folder.

    Raises
    ------
    OSError
        The folder cannot be written.
    """
    complete = folder / COMPLETE
    if not complete.is_dir():
        return
    lock = None if locked else lock_folder(folder)
    try:
        if not (complete / NAMES).exists():  # another process has just done it
            shutil.rmtree(complete, ignore_errors=True)
            return
        names = (complete / NAMES).read_text(encoding="utf-8").splitlines()
        if (complete / RUN).exists():  # otherwise all new files are in place already
            (folder / RUN).unlink(missing_ok=True)
        for name in OUTPUT_NAMES:  # run.json is the last
            if (complete / name).exists():
                (complete / name).replace(folder / name)
            elif name not in names:
                (folder / name).unlink(missing_ok=True)
        shutil.rmtree(complete, ignore_errors=True)
    finally:
        if lock is not None:
            release(lock)


def _remove_abandoned(place: Path, name: str) -> bool:
    """Remove the working folders of runs that were killed; return whether another run is alive."""
    alive = False
    for abandoned in place.glob(f".{glob.escape(name)}.*.partial"):
        with suppress(OSError):
            try:
                lock = lock_folder(abandoned, wait=False, required=True)
            except BlockingIOError:
                alive = True
                continue
            try:
                if time.time() - abandoned.stat().st_mtime >= YOUNG_S:
                    shutil.rmtree(abandoned, ignore_errors=True)
            finally:
                release(lock)
    return alive
