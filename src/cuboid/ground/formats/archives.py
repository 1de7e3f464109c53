"""Files in .zip and .tar archives, without unpacking: the index is read, then each requested file."""

from __future__ import annotations

import errno
import io
import os
import struct
import tarfile
import threading
import weakref
import zipfile
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO

from cuboid.ground.formats import cache
from cuboid.ground.formats.stores import FileEntry

# Maximum size of a compressed file that is unpacked in memory; larger ones go to the cache, for random access.
MAX_IN_MEMORY = 16 << 20
# Header of a file in a zip: signature and fields, then the lengths of its name and of the extra field.
_LOCAL_HEADER = struct.Struct("<26xHH")
BUFFER_BYTES = 1 << 16


class Window(io.RawIOBase):
    """A part of a shared file, as a separate file.

    Parameters
    ----------
    file : file
    lock : Lock
        Lock that is held while the file is positioned and read.
    start, size : int
        Bytes.
    owner : object
        Owner of the file; it is kept alive by this object.
    """

    def __init__(self, file: Any, lock: threading.Lock, start: int, size: int, owner: object) -> None:
        self._file, self._lock, self._start, self._size, self._at = file, lock, start, size, 0
        self._owner = owner

    def readable(self) -> bool:
        """Return True."""
        return True

    def seekable(self) -> bool:
        """Return True."""
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Set the position."""
        base = {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self._size}[whence]
        if base + offset < 0:
            raise OSError(errno.EINVAL, "a place before the file's beginning")
        self._at = base + offset
        return self._at

    def tell(self) -> int:
        """Return the position."""
        return self._at

    def readinto(self, buffer: bytearray | memoryview) -> int:  # type: ignore[override]
        """Read bytes into a buffer."""
        wanted = max(0, min(len(buffer), self._size - self._at))
        with self._lock:
            self._file.seek(self._start + self._at)
            data = self._file.read(wanted)
        buffer[: len(data)] = data
        self._at += len(data)
        return len(data)


class _ArchiveStore:
    """Folders and files by their names from the root of an archive; the file stays open as long as the store."""

    def __init__(self, archive: Path, file: BinaryIO) -> None:
        self._root, self._lock, self._file = archive, threading.Lock(), file
        weakref.finalize(self, self._file.close)
        self._sizes: dict[str, int] = {}
        self._folders: dict[str, dict[str, None]] = {"": {}}

    def _add(self, sizes: Iterable[tuple[str, int]]) -> None:
        """Add files by their names."""
        for name, size in sizes:
            self._sizes[name] = size
            while name:
                folder, _, last = name.rpartition("/")
                is_listed = folder in self._folders
                self._folders.setdefault(folder, {})[last] = None
                if is_listed:
                    break
                name = folder

    def _name(self, path: Path) -> str:
        """Return a path as seen from the root."""
        return "/".join(path.parts[len(self._root.parts) :])

    def _file_name(self, path: Path) -> str:
        """Return the same of a file; raise OSError for a folder."""
        if self.entry(path).is_folder:
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        return self._name(path)

    def entry(self, path: Path) -> FileEntry:
        """Return the entry at a path."""
        name = self._name(path)
        if name in self._folders:
            return FileEntry(0, True)
        if name not in self._sizes:
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
        return FileEntry(self._sizes[name], False)

    def names(self, path: Path) -> list[str]:
        """Return the names in a folder."""
        name = self._name(path)
        if name not in self._folders:
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(path))
        return list(self._folders[name])


def _plain(name: str) -> str | None:
    """Return a normalised name; None if it leads out of the archive."""
    parts = [part for part in PurePosixPath(name.replace("\\", "/")).parts if part != "."]
    return None if not parts or parts[0] == "/" or ".." in parts else "/".join(parts)


class ZipStore(_ArchiveStore):
    """The files of a zip archive.

    Parameters
    ----------
    archive : Path
    file : file
        The archive itself, open for reading; the store closes it.

    Raises
    ------
    OSError
        The index is missing or damaged.
    """

    def __init__(self, archive: Path, file: BinaryIO) -> None:
        super().__init__(archive, file)
        self._file.seek(max(0, self._file.seek(0, os.SEEK_END) - 1))
        self._file.read(1)  # zipfile would hide a server's error
        try:
            self._zip = zipfile.ZipFile(self._file)
            infos = self._zip.infolist()
        except OSError:
            raise
        except Exception as error:  # a damaged file makes the library raise nearly anything
            raise OSError(errno.EINVAL, f"no whole zip archive: {short_line(error)}", str(archive)) from None
        self._infos = {name: one for one in infos if not one.filename.endswith("/") and (name := _plain(one.filename))}
        self._add((name, one.file_size) for name, one in self._infos.items())

    def open(self, path: Path) -> BinaryIO:
        """Open a file; a compressed one is unpacked in memory or in the cache."""
        info = self._infos[self._file_name(path)]
        if info.flag_bits & 0x1:
            raise PermissionError(errno.EACCES, "is encrypted", str(path))
        if info.compress_type == zipfile.ZIP_STORED:
            return io.BufferedReader(self._window(info), BUFFER_BYTES)
        if info.file_size <= MAX_IN_MEMORY:
            return io.BytesIO(self._unpacked(info, path))
        return cache.CACHE.file(path, info.file_size, lambda file: self._unpack_into(info, file, path)).open("rb")

    def _window(self, info: zipfile.ZipInfo) -> Window:
        with self._lock:
            self._file.seek(info.header_offset)
            header = self._file.read(_LOCAL_HEADER.size)
        if len(header) < _LOCAL_HEADER.size:
            raise OSError(errno.EIO, "lies beyond the archive's end")
        start = info.header_offset + _LOCAL_HEADER.size + sum(_LOCAL_HEADER.unpack(header))
        return Window(self._file, self._lock, start, info.file_size, self)

    def _unpacked(self, info: zipfile.ZipInfo, path: Path) -> bytes:
        file = io.BytesIO()
        self._unpack_into(info, file, path)
        return file.getvalue()

    def _unpack_into(self, info: zipfile.ZipInfo, file: BinaryIO, path: Path) -> None:
        try:
            with self._lock, self._zip.open(info) as packed:
                while data := packed.read(1 << 20):
                    file.write(data)
        except OSError:
            raise
        except Exception as error:  # as above
            raise OSError(errno.EIO, f"cannot be unpacked: {short_line(error)}", str(path)) from None


class TarStore(_ArchiveStore):
    """The files of a tar archive; of a truncated one the complete files.

    Parameters
    ----------
    archive : Path
    file : file
        As of `ZipStore`.

    Raises
    ------
    OSError
        It is none.
    """

    def __init__(self, archive: Path, file: BinaryIO) -> None:
        super().__init__(archive, file)
        end = self._file.seek(0, os.SEEK_END)
        self._file.seek(0)
        self._spans: dict[str, tuple[int, int]] = {}
        try:
            tar = tarfile.open(fileobj=self._file, mode="r:")  # noqa: SIM115 - the file stays open
        except (tarfile.TarError, ValueError, EOFError) as error:
            raise OSError(errno.EINVAL, f"no tar archive: {short_line(error)}", str(archive)) from None
        with suppress(tarfile.TarError, ValueError, EOFError, KeyError, UnicodeError):  # what was found counts
            for one in tar:
                whole = one.isreg() and not one.issparse() and one.offset_data + one.size <= end
                if whole and (name := _plain(one.name)):
                    self._spans[name] = (one.offset_data, one.size)
                tar.members = []  # type: ignore[attr-defined] # it would keep them all
        self._add((name, size) for name, (_, size) in self._spans.items())

    def open(self, path: Path) -> BinaryIO:
        """Open a file."""
        start, size = self._spans[self._file_name(path)]
        return io.BufferedReader(Window(self._file, self._lock, start, size, self), BUFFER_BYTES)


def short_line(error: BaseException) -> str:
    """Return the message of an error in a short line."""
    return " ".join(str(error).split())[:120] or type(error).__name__
