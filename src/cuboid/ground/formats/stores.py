"""The interface of a store of files: an archive, or a server."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Protocol


@dataclass(frozen=True, slots=True)
class FileEntry:
    """A file or a folder in a store: its size in bytes, 0 of a folder."""

    size: int
    is_folder: bool


class FileStore(Protocol):
    """A place that holds files; its methods raise OSError."""

    def entry(self, path: Path) -> FileEntry:
        """Return the entry at a path."""

    def names(self, path: Path) -> list[str]:
        """Return the names in a folder."""

    def open(self, path: Path) -> BinaryIO:
        """Open a file for reading, from any place in any order."""
