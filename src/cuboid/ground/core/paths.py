"""Paths as callers give them: a string or any path object."""

from __future__ import annotations

import os
from pathlib import Path

PathLike = str | os.PathLike[str]


def as_path(path: PathLike) -> Path:
    """Return a caller's path as a `Path`; a path in an archive or on a server keeps its own class."""
    return path if isinstance(path, Path) else Path(path)
