"""A cache folder of limited size for files from archives and servers that libraries need on disk."""

from __future__ import annotations

import atexit
import errno
import os
import shutil
import tempfile
import threading
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

# Environment variable and default of the cache's size limit: a compressed bag of an hour at 640x480.
LIMIT_VARIABLE, LIMIT_MB = "CUBOID_CACHE_MB", 4096
# Free space that the cache leaves on the disk.
LEFT_FREE_BYTES = 512 << 20


class Cache:
    """The most recently used files; all are deleted when the process ends."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._folder: Path | None = None
        self._files: OrderedDict[str, tuple[Path, int]] = OrderedDict()
        self._made = 0

    def file(self, path: Path, size: int, write: Callable[[BinaryIO], None]) -> Path:
        """Return the cached file with the contents of a path; `write` creates it if it is missing.

        Raises
        ------
        OSError
            It is larger than the cache may be, the disk is full, or `write` raises it.
        """
        key = f"{path} {size}"
        with self._lock:
            if key not in self._files:
                self._make_room(size, str(path))
                self._files[key] = (self._write(path, write), size)
            self._files.move_to_end(key)
            return self._files[key][0]

    def _write(self, path: Path, write: Callable[[BinaryIO], None]) -> Path:
        if self._folder is None:
            self._folder = Path(tempfile.mkdtemp(prefix="cuboid-cache-"))
            atexit.register(shutil.rmtree, self._folder, ignore_errors=True)
        self._made += 1
        made = self._folder / f"{self._made}{path.suffix}"
        try:
            with made.open("wb") as file:
                write(file)
        except BaseException:
            made.unlink(missing_ok=True)
            raise
        return made

    def _make_room(self, size: int, name: str) -> None:
        limit = _limit_bytes()
        if size > limit:
            raise OSError(
                errno.EFBIG,
                f"is compressed or needed on disk, and has {size >> 20} MB: more than the {limit >> 20} MB that may be "
                f"kept there; unpack or fetch it first, or set {LIMIT_VARIABLE}",
                name,
            )
        while self._files and sum(held for _, held in self._files.values()) + size > limit:
            _, (oldest, _) = self._files.popitem(last=False)
            oldest.unlink(missing_ok=True)
        if shutil.disk_usage(tempfile.gettempdir()).free < size + LEFT_FREE_BYTES:
            raise OSError(errno.ENOSPC, f"needs {size >> 20} MB in {tempfile.gettempdir()}, which is full", name)


def _limit_bytes() -> int:
    text = os.environ.get(LIMIT_VARIABLE, "")
    return (int(text) if text.isdigit() else LIMIT_MB) << 20


CACHE = Cache()
