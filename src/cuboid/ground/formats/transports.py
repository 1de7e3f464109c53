"""Files at URLs, through `fsspec` and its file systems: https, s3, gs and others."""

from __future__ import annotations

import errno
import inspect
import io
import os
import threading
from collections import OrderedDict
from typing import TYPE_CHECKING, Any, BinaryIO

from cuboid.ground.core.extras import missing
from cuboid.ground.formats.archives import BUFFER_BYTES, Window, short_line
from cuboid.ground.formats.stores import FileEntry

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

# Block size of downloads, and number of blocks cached per open file: a small image fits into one block.
BLOCK_BYTES, BLOCKS_KEPT = 256 << 10, 32
FILES_OPEN = 8
# Seconds without an answer after which a server counts as gone.
CONNECT_S, SERVER_ANSWER_S = 20.0, 60.0
ATTEMPTS = 3
ABSENT, FORBIDDEN = (404, 410), (401, 403, 407)


class ServerStore:
    """The files of a server, as they were when they were first listed.

    Parameters
    ----------
    scheme : str
        "https", "s3", ...
    name : str
        The URL, for messages.

    Raises
    ------
    OSError
        The package for such URLs is not installed, or the kind of URL is unknown.
    """

    def __init__(self, scheme: str, name: str) -> None:
        self._lock = threading.RLock()
        self._http = scheme in ("http", "https")
        self._system = _filesystem(scheme, name)
        self._entries: dict[str, dict[str, FileEntry | None]] = {}  # by folder; None: a file of unknown size
        self._alone: dict[str, dict[str, FileEntry | None]] = {}  # entries that were requested one by one
        self._files: OrderedDict[str, tuple[Any, threading.Lock, int]] = OrderedDict()

    def entry(self, path: Path) -> FileEntry:
        """Return what lies at a path: as its folder's list says, where that is known, else as the server answers."""
        with self._lock:
            listed = self._entries.get(str(path.parent))
            if self._is_known_file(path.parent) or (listed is not None and path.name not in listed):
                raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
            siblings = self._alone.setdefault(str(path.parent), {}) if listed is None else listed
            found = siblings.get(path.name)
            if found is None:
                found = siblings[path.name] = self._ask(path)
            if found.is_folder and str(path) not in self._entries:
                self._entries[str(path)] = self._list(path)
            return found

    def _is_known_file(self, path: Path) -> bool:
        """Tell whether a path is known for a file: a server with a query in the name would answer for what is in it."""
        folder = str(path.parent)
        entry = self._alone.get(folder, {}).get(path.name) or self._entries.get(folder, {}).get(path.name)
        return entry is not None and not entry.is_folder

    def _ask(self, path: Path) -> FileEntry:
        url = str(path)
        found = _tried(lambda: self._system.info(url), url)
        if self._http:
            found = dict(found)
            page = found.get("mimetype") == "text/html" and path.suffix not in (".html", ".htm")
            found["type"] = "directory" if page else "file"
        if found["type"] == "directory":
            return FileEntry(0, True)
        if found.get("size") is None:
            raise OSError(errno.EIO, "the server does not say how large it is", url)
        return FileEntry(int(found["size"]), False)

    def _list(self, path: Path) -> dict[str, FileEntry | None]:
        url = f"{path}/" if self._http else str(path)
        found: dict[str, FileEntry | None] = {}
        for one in _tried(lambda: self._system.ls(url, detail=True), url):
            name = str(one["name"]).partition("?")[0].rstrip("/").rpartition("/")[2]
            if one["type"] == "directory":
                found[name] = FileEntry(0, True)
            elif name:
                found[name] = None if one.get("size") is None else FileEntry(int(one["size"]), False)
        return found

    def names(self, path: Path) -> list[str]:
        """Return the names in a folder."""
        if not self.entry(path).is_folder:
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(path))
        with self._lock:
            return [name for name in self._entries[str(path)] if name]

    def open(self, path: Path) -> BinaryIO:
        """Open a file; it is fetched block by block, as it is read."""
        size = self.entry(path).size
        with self._lock:
            url = str(path)
            if url not in self._files:
                options = {"block_size": BLOCK_BYTES, "cache_type": "blockcache"}
                kept = {"cache_options": {"maxblocks": BLOCKS_KEPT}, "size": size}
                file = _tried(lambda: self._system.open(url, "rb", **options, **kept), url)
                self._files[url] = (_Guarded(file, url), threading.Lock(), size)
                if len(self._files) > FILES_OPEN:
                    self._files.popitem(last=False)
            self._files.move_to_end(url)
            shared, lock, size = self._files[url]
        return io.BufferedReader(Window(shared, lock, 0, size, self), BUFFER_BYTES)


class _Guarded:
    """A file of `fsspec` that raises OSError for all faults."""

    def __init__(self, file: Any, url: str) -> None:
        self._file, self._url = file, url

    def seek(self, offset: int) -> None:
        self._file.seek(offset)

    def read(self, size: int) -> bytes:
        at = self._file.tell()

        def work() -> bytes:
            self._file.seek(at)
            data: bytes = self._file.read(size)
            return data

        found: bytes = _tried(work, self._url)
        return found


def _tried(work: Callable[[], Any], url: str) -> Any:
    """Do what a server may refuse, or fail at for a moment: the libraries then raise nearly anything."""
    for attempt in range(ATTEMPTS):
        try:
            return work()
        except PermissionError:
            raise
        except FileNotFoundError as error:  # of HTTP whatever went wrong
            status = getattr(error.__cause__, "status", None)
            if status in FORBIDDEN:
                raise PermissionError(errno.EACCES, f"the server forbids it ({status})", url) from None
            if error.__cause__ is None or status in ABSENT:
                raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), url) from None
            if attempt == ATTEMPTS - 1:
                raise OSError(errno.EIO, f"the server fails: {short_line(error.__cause__)}", url) from None
        except ValueError as error:
            raise OSError(errno.EIO, short_line(error), url) from None
        except Exception as error:
            if attempt == ATTEMPTS - 1:
                raise OSError(errno.EIO, f"the server fails: {short_line(error)}", url) from None
    raise AssertionError("unreachable")


def _filesystem(scheme: str, name: str) -> Any:
    try:
        import fsspec

        options: dict[str, Any] = {"skip_instance_cache": True}
        if scheme in ("http", "https"):
            import aiohttp

            timeout = aiohttp.ClientTimeout(total=None, sock_connect=CONNECT_S, sock_read=SERVER_ANSWER_S)
            options["client_kwargs"] = {"timeout": timeout}
        elif scheme == "s3":
            options["config_kwargs"] = {"connect_timeout": CONNECT_S, "read_timeout": SERVER_ANSWER_S}
        _, *asked = inspect.signature(fsspec.get_filesystem_class(scheme).__init__).parameters.values()
        if any(one.default is one.empty and one.kind is one.POSITIONAL_OR_KEYWORD for one in asked):
            raise ValueError(f"{scheme} needs to know a server")
        return fsspec.filesystem(scheme, **options)
    except ImportError:
        raise OSError(errno.ENOSYS, missing("a URL", "fsspec", "remote"), name) from None
    except ValueError:
        kinds = "https://, s3://, gs:// and what else fsspec knows"
        raise OSError(errno.EINVAL, f"no such kind of URL; there are {kinds}", name) from None
    except Exception as error:  # some look for their server at once
        raise OSError(errno.EIO, f"the server fails: {short_line(error)}", name) from None
