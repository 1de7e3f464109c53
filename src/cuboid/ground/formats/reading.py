"""Opening of files: only regular files, with a size limit for each kind."""

from __future__ import annotations

import os
import stat
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from io import TextIOWrapper
from pathlib import Path
from typing import BinaryIO

from cuboid.ground.core.errors import InputError
from cuboid.ground.formats.stored import StoredPath

# Maximum size of each kind of file. A map of 10,000 objects takes 6 MB of JSON, a day of poses 250 MB of text.
MAX_JSON_BYTES = 64 << 20
MAX_TEXT_BYTES = 1 << 30
MAX_BINARY_BYTES = 1 << 30
# A line of a text file; a path has at most 4096 bytes.
MAX_LINE_CHARS = 10_000

_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a FIFO",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


class UnreadableError(InputError):
    """A file cannot be read.

    Attributes
    ----------
    reason : str
        Reason, without the file's name.
    missing : bool
        Whether the file is missing.
    """

    def __init__(self, path: Path, reason: str, missing: bool = False) -> None:
        super().__init__(f"{path}: {reason}")
        self.reason = reason
        self.missing = missing


@contextmanager
def opened(path: Path, most_bytes: int) -> Iterator[BinaryIO]:
    """Open a regular file of at most this many bytes for reading.

    Raises
    ------
    UnreadableError
        There is no such file, it is a folder, a FIFO, a device or a socket, it is too large, or the system refuses.
    """
    with _refusals(path):
        try:
            found = path.stat()
            _refuse_special(path, found, most_bytes)  # before opening, which has side effects on a device
            stored = isinstance(path, StoredPath)
            file = path.open("rb") if stored else open(path, "rb", opener=_open)  # noqa: SIM115
        except ValueError:  # a NUL, or half a character, in the name
            raise UnreadableError(path, "cannot be read: no file can have this name", missing=True) from None
        with file:
            if not stored:
                _refuse_special(path, os.fstat(file.fileno()), most_bytes)
            yield file


def read_bytes(path: Path, most_bytes: int) -> bytes:
    """Return the content of a file; raises what `opened` raises."""
    with opened(path, most_bytes) as file:
        size = file.seek(0, os.SEEK_END)  # of one that grows meanwhile, what was there
        file.seek(0)
        return file.read(size)


def names_in(folder: Path) -> Iterator[str]:
    """Iterate over the names in a folder, in no order.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    try:
        if isinstance(folder, StoredPath):
            yield from folder.names()
        else:
            with os.scandir(folder) as items:
                yield from (item.name for item in items)
    except OSError as error:
        raise InputError(f"{folder} cannot be read: {error.strerror}") from None


def text_lines(path: Path) -> Generator[str, None, None]:
    """Iterate over the lines of a text file, without their ends; a byte order mark is left out.

    Raises
    ------
    UnreadableError
        As of `opened`, or it is not UTF-8 text, or a line is too long.
    """
    with opened(path, MAX_TEXT_BYTES) as file, TextIOWrapper(file, encoding="utf-8-sig") as text:
        number = 0
        try:
            while line := text.readline(MAX_LINE_CHARS + 1):
                number += 1
                if len(line) > MAX_LINE_CHARS:
                    raise UnreadableError(path, f"line {number} is longer than {MAX_LINE_CHARS} characters")
                yield line.rstrip("\n")
        except UnicodeDecodeError:
            raise UnreadableError(path, f"is not a text file (UTF-8), about line {number + 1}") from None


def real_path(path: Path) -> Path:
    """Return a path with all links resolved; a path in a circle of links is returned unchanged."""
    return Path(os.path.realpath(path))


def kind_of(found: os.stat_result) -> str:
    """Return the kind of something that is no regular file, with an article."""
    return _KINDS.get(stat.S_IFMT(found.st_mode), "no file")


@contextmanager
def _refusals(path: Path) -> Iterator[None]:
    """Turn the system's errors into one line."""
    try:
        yield
    except (FileNotFoundError, NotADirectoryError):
        raise UnreadableError(path, "cannot be read: No such file or directory", missing=True) from None
    except OSError as error:
        raise UnreadableError(path, f"cannot be read: {error.strerror or error}") from None


def _open(path: str, flags: int) -> int:
    """Open without blocking, for example on a FIFO without a writer."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def _refuse_special(path: Path, found: os.stat_result, most_bytes: int) -> None:
    if not stat.S_ISREG(found.st_mode):
        raise UnreadableError(path, f"is {kind_of(found)}, a regular file was expected")
    if found.st_size > most_bytes:
        raise UnreadableError(path, _too_large(most_bytes))


def _too_large(most_bytes: int) -> str:
    return f"is larger than {most_bytes >> 20} MB, which no file of its kind is"
