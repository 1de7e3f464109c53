"""A file, or a folder of files, that appears when it is complete."""

from __future__ import annotations

import contextlib
import re
import secrets
import shutil
import stat
from collections.abc import Iterator
from pathlib import Path

from cuboid.ground.core.errors import OutputError
from cuboid.ground.formats.folder import writing
from cuboid.ground.formats.reading import kind_of, real_path

DEVICES = Path("/dev")


class PendingFile:
    """A file that is written under a hidden name beside its path and then renamed.

    Parameters
    ----------
    path : Path
        The final path.

    Attributes
    ----------
    path : Path
    partial : Path
        The path at which it is written.

    Raises
    ------
    OutputError
        The path is not that of a file: root could replace a device.
    """

    def __init__(self, path: Path) -> None:
        _refuse_special(path)
        self.path = path
        self.partial = path.with_name(f".{path.name}.{secrets.token_hex(4)}.partial")

    @contextlib.contextmanager
    def writing(self) -> Iterator[None]:
        """Turn an error of the system into one line, and leave no partial file.

        Raises
        ------
        OutputError
            The file cannot be written.
        """
        try:
            with writing(self.path):
                yield
        except BaseException:
            self.drop()
            raise

    def show(self) -> None:
        """Move the file to its path; an existing one is replaced."""
        self.partial.replace(self.path)

    def drop(self) -> None:
        """Delete the partial file."""
        with contextlib.suppress(OSError):
            self.partial.unlink(missing_ok=True)


def _refuse_special(path: Path) -> None:
    if real_path(path.parent) == DEVICES:  # there a link such as stdout may lead to a file
        raise OutputError(f"{path}: is a device; the output must be a file")
    with contextlib.suppress(OSError, ValueError):  # an error is raised when the file is written
        found = path.stat()
        if not stat.S_ISREG(found.st_mode):
            raise OutputError(f"{path}: is {kind_of(found)}; the output must be a file")


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield the path at which to write a file that appears at the end; an existing one is replaced.

    Raises
    ------
    OutputError
        The file cannot be written; an existing one is unchanged.
    """
    file = PendingFile(path)
    with file.writing():
        yield file.partial
        file.show()


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file atomically; an existing one is replaced.

    Raises
    ------
    OutputError
        The file cannot be written; an existing one is unchanged.
    """
    with replacing(path) as partial:
        partial.write_bytes(content.encode("utf-8", "backslashreplace") if isinstance(content, str) else content)


def refuse_taken(path: Path, *, force: bool) -> None:
    """Raise OutputError if a file must not be written at a path: for a folder, or an existing file without `force`."""
    with writing(path):
        if path.is_dir():
            raise OutputError(f"{path}: is a folder; the output must be a file")
        if path.exists() and not force:
            raise OutputError(f"{path}: exists; --force replaces it")


@contextlib.contextmanager
def new_file(path: Path, *, force: bool) -> Iterator[Path]:
    """Yield the path at which to write a file that appears at the end.

    Parameters
    ----------
    path : Path
    force : bool
        Whether an existing file is replaced.

    Raises
    ------
    OutputError
        The file exists and `force` is not given, it is a folder, or it cannot be written.
    """
    refuse_taken(path, force=force)
    with replacing(path) as partial:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield partial


@contextlib.contextmanager
def new_folder(path: Path, *, force: bool, replaces: str) -> Iterator[Path]:
    """Yield the path at which to write a folder of files that appears at the end.

    Parameters
    ----------
    path : Path
    force : bool
        Whether existing files of the same kind are replaced; other files stay.
    replaces : str
        Regular expression of the file names of this kind.

    Raises
    ------
    OutputError
        The folder exists and `force` is not given, it is a file, or it cannot be written.
    """
    with writing(path):
        if path.exists() and not path.is_dir():
            raise OutputError(f"{path}: is a file; the output must be a folder")
        if path.is_dir() and not force:
            raise OutputError(f"{path}: the folder exists; --force replaces the files of an earlier export in it")
    working = path.with_name(f".{path.name}.{secrets.token_hex(4)}.partial")
    try:
        with writing(path):
            working.mkdir(parents=True)
            yield working
            if path.is_dir():
                _replace(working, path, re.compile(replaces))
            else:
                working.rename(path)
    finally:
        shutil.rmtree(working, ignore_errors=True)


def _replace(working: Path, path: Path, kind: re.Pattern[str]) -> None:
    """Move all files of a folder into another, after those of the same kind there are deleted."""
    for old in sorted(path.iterdir()):
        if old.is_file() and kind.fullmatch(old.name):
            old.unlink()
    for new in sorted(working.iterdir()):
        new.replace(path / new.name)
