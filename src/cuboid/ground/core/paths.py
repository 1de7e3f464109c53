"""Paths as callers give them: a string or any path object."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from cuboid.ground.core.errors import OutputError

PathLike = str | os.PathLike[str]


def as_path(path: PathLike) -> Path:
    """Return a caller's path as a `Path`; a path in an archive or on a server keeps its own class."""
    return path if isinstance(path, Path) else Path(path)


def file_name(name: str) -> str:
    """Return a name that a user gave, of a camera say, as the name of a file or folder."""
    return "".join(letter if letter.isalnum() or letter in "-_. " else "_" for letter in name).strip(". ") or "_"


def refuse_same_file_names(names: Sequence[str]) -> None:
    """Refuse names of cameras of which two give the same file name.

    Raises
    ------
    OutputError
    """
    first: dict[str, str] = {}
    for name in names:
        other = first.setdefault(file_name(name), name)
        if other != name:
            raise OutputError(f"cameras '{other}' and '{name}' would be written to one file; rename one in rig.json")
