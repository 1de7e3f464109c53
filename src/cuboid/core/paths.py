"""Paths as callers name them: a text or any object of a path."""

from __future__ import annotations

import os
from pathlib import Path

PathLike = str | os.PathLike[str]


def as_path(path: PathLike) -> Path:
    """Return a path that a caller named; one of an archive or a server stays what it is."""
    return path if isinstance(path, Path) else Path(path)
