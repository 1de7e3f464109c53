"""Where compiled kernels are kept: files that carry the stamp of what they were compiled from, so none can be stale."""

from __future__ import annotations

import os
import stat
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import cache, cached_property
from pathlib import Path
from types import FunctionType
from typing import Any

from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile

from cuboid.core.kernelstamp import stamp_of

# The environment variable of numba that names its cache folder; a user who sets it has chosen the folder.
VARIABLE = "NUMBA_CACHE_DIR"
# This many earlier versions of each kernel are kept, for the branches of a developer.
KEPT_VERSIONS = 3
# Kernels that no run has used for this long are removed: those of versions that are no longer installed.
UNUSED_S = 30 * 24 * 3600.0
# Hexadecimal digits of the stamp in a file's name; the whole stands inside.
STAMP_DIGITS = 20


@cache
def cache_folder() -> Path:
    """Return the folder of compiled kernels: this user's alone, for what lies there is run."""
    chosen = os.environ.get(VARIABLE)
    if chosen:
        return Path(chosen)
    for folder in _candidates():
        if _own(folder):
            return folder
    return Path(tempfile.mkdtemp(prefix="cuboid-kernels-"))


def _candidates() -> Iterator[Path]:
    """Yield the places of the user's caches, the usual one first."""
    for base in (os.environ.get("XDG_CACHE_HOME"), os.environ.get("LOCALAPPDATA")):
        if base and os.path.isabs(base):
            yield Path(base, "cuboid", "kernels")
    home = os.path.expanduser("~")
    if os.path.isabs(home):
        yield Path(home, ".cache", "cuboid", "kernels")
    yield Path(tempfile.gettempdir(), f"cuboid-kernels-{_user()}")


def _user() -> int:
    return os.getuid() if hasattr(os, "getuid") else 0  # on Windows these folders are the user's anyway


def _own(folder: Path) -> bool:
    """Make a folder, or tell whether it is this user's alone: what lies in it is run."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError:
        return False
    mine = not hasattr(os, "getuid") or (found.st_uid == os.getuid() and not found.st_mode & 0o022)
    return stat.S_ISDIR(found.st_mode) and mine and os.access(folder, os.W_OK | os.X_OK)


class _Location:
    """Where numba finds the folder of a kernel; it stands for numba's own locators, which know only the source file."""

    def __init__(self, function: FunctionType) -> None:
        self._py_file = function.__code__.co_filename

    def get_cache_path(self) -> str:
        return str(cache_folder())

    def ensure_cache_path(self) -> None:
        cache_folder().mkdir(parents=True, exist_ok=True)


class _Results(CompileResultCacheImpl):
    """The files of a compiled kernel that numba writes, named by kernel and stamp."""

    def __init__(self, function: FunctionType) -> None:
        self._lineno = function.__code__.co_firstlineno
        self._locator = _Location(function)


class KernelCache(FunctionCache):
    """The compiled code of one kernel on disk.

    Its files are named by module, function and a stamp of all that the code depends on (`cuboid.core.kernelstamp`). The
    stamp is made when the kernel is first called: before, what it uses may not be defined yet.

    Parameters
    ----------
    function : FunctionType
        The kernel before it is compiled.
    options : mapping of str to object
        How it is compiled.

    Attributes
    ----------
    compiled : bool
        Whether this process has compiled it.
    """

    def __init__(self, function: FunctionType, options: Mapping[str, Any]) -> None:
        self._name = f"{function.__module__}.{function.__qualname__}"
        self._py_func = function
        self._options = options
        self._impl = _Results(function)
        self._cache_path = str(cache_folder())
        self.compiled = False
        self.enable()

    @cached_property
    def stamp(self) -> str:
        """Stamp of all that the kernel is compiled from."""
        return stamp_of(self._py_func, self._options)

    @property
    def index(self) -> Path:
        """The file that lists the compiled signatures."""
        return cache_folder() / f"{self._base}.nbi"

    @property
    def _base(self) -> str:
        return f"{self._name}-{self.stamp[:STAMP_DIGITS]}"

    @cached_property
    def _cache_file(self) -> Any:  # type: ignore[override]
        return IndexDataCacheFile(self._cache_path, self._base, self.stamp)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return what lies compiled of a signature; None where it is to be compiled."""
        try:
            found = super().load_overload(sig, target_context)
        except Exception:  # a damaged file may raise anything: the kernel is compiled again
            found = None
            with suppress(OSError):
                self.index.unlink()
        if found is not None:
            with suppress(OSError):
                os.utime(self.index)
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what was compiled; where the disk is full or cannot be written, this run goes on without."""
        self.compiled = True
        with suppress(OSError):
            new = not self.index.exists()
            super().save_overload(sig, data)
            if new:
                prune(self._name, self.index)

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        """Return numba's key and the fields of named tuples among the arguments, whose order the code depends on."""
        arguments = getattr(sig, "args", sig)
        fields = tuple(getattr(getattr(one, "instance_class", None), "_fields", ()) for one in arguments)
        return super()._index_key(sig, codegen), fields


def prune(name: str, current: Path) -> None:
    """Remove old versions of a kernel, and what no run has used for long.

    Parameters
    ----------
    name : str
        Module and function of the kernel.
    current : Path
        The file of its version in use.
    """
    folder, now_s = current.parent, time.time()
    ages = {index: now_s - index.stat().st_mtime for index in folder.glob("*.nbi") if index != current}
    earlier = sorted((index for index in ages if index.name.rpartition("-")[0] == name), key=ages.__getitem__)
    for index in {*earlier[KEPT_VERSIONS:], *(index for index, age_s in ages.items() if age_s > UNUSED_S)}:
        for data in folder.glob(f"{index.stem}.*.nbc"):
            data.unlink(missing_ok=True)
        index.unlink(missing_ok=True)
