"""Where compiled kernels are kept where the installation itself cannot be written."""

from __future__ import annotations

import os
import stat
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

# What numba reads for the folder; who sets it has chosen.
VARIABLE = "NUMBA_CACHE_DIR"


def choose_cache(beside: Path) -> None:
    """Let numba keep its machine code beside the sources, or where the user's caches are; said when it is first made.

    Call it before the first kernel is defined.

    Parameters
    ----------
    beside : Path
        The folder of the sources.
    """
    if VARIABLE in os.environ or _writable(beside / "__pycache__") or _writable(beside):
        return
    for folder in _candidates():
        new = not folder.exists()
        if _own(folder):
            _set(folder)
            if new:
                print(f"cuboid: the installation cannot be written; compiled kernels go to {folder}", file=sys.stderr)
            return
    _set(Path(tempfile.mkdtemp(prefix="cuboid-kernels-")))


def _set(folder: Path) -> None:
    os.environ[VARIABLE] = str(folder)
    if "numba" in sys.modules:  # it has read its settings already
        sys.modules["numba"].config.CACHE_DIR = str(folder)


def _candidates() -> Iterator[Path]:
    """Yield the places of the user's caches, the usual one first."""
    base = os.environ.get("XDG_CACHE_HOME")
    if base and os.path.isabs(base):
        yield Path(base, "cuboid", "kernels")
    home = os.path.expanduser("~")
    if os.path.isabs(home):
        yield Path(home, ".cache", "cuboid", "kernels")
    yield Path(tempfile.gettempdir(), f"cuboid-kernels-{os.getuid()}" if hasattr(os, "getuid") else "cuboid-kernels")


def _own(folder: Path) -> bool:
    """Make a folder, or tell whether it is this user's alone: what lies in it is run."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError:
        return False
    return stat.S_ISDIR(found.st_mode) and _private(found) and _writable(folder)


def _private(found: os.stat_result) -> bool:
    """Tell whether only this user can write; on Windows the folders of a user's profile are private."""
    return not hasattr(os, "getuid") or (found.st_uid == os.getuid() and not found.st_mode & 0o022)


def _writable(folder: Path) -> bool:
    return os.access(folder, os.W_OK | os.X_OK)
