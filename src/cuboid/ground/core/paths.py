"""Paths as callers give them: a string or any path object."""

from __future__ import annotations

import os
from pathlib import Path

PathLike = str | os.PathLike[str]


def as_path(path: PathLike) -> Path:
    """Return a caller's path as a `Path`; a path in an archive or on a server keeps its own class."""
    return path if isinstance(path, Path) else Path(path)


def file_name(name: str) -> str:
    """Return a name that a user gave, of a camera say, as the name of a file or folder."""
    return "".join(letter if letter.isalnum() or letter in "-_. " else "_" for letter in name).strip(". ") or "_"
