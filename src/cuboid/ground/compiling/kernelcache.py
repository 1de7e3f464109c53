"""The cache of compiled kernels: each file name contains a stamp of its source, so that no file can be stale.

Kernels that came with the installation (`cuboid.ground.compiling.baseline`) are looked up first. The user's cache holds
all others.
"""

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

from numba.core.caching import FunctionCache

from cuboid.ground import locks
from cuboid.ground.compiling import baseline, compiletime
from cuboid.ground.compiling.kernelstamp import stamp_of
from cuboid.ground.compiling.loading import KernelFile, KernelResults

# The environment variable of numba that names its cache folder; a user who sets it has chosen the folder.
VARIABLE = "NUMBA_CACHE_DIR"
# Number of earlier versions of each kernel that are kept, for a developer who switches branches.
KEPT_VERSIONS = 3
# Kernels that no run has used for this long are removed, seconds: they belong to versions no longer installed.
UNUSED_S = 30 * 24 * 3600.0
# How long a process waits for another one that compiles the same kernel, seconds; the slowest takes 5 s on a free core.
# It then compiles the kernel itself: the other process may be stopped.
MAX_WAIT_S = 60.0
# Pause between two tries to lock a kernel, seconds.
RETRY_S = 0.02
# Hexadecimal digits of the stamp in a file name; the full stamp is inside the file.
STAMP_DIGITS = 20


@cache
def cache_folder() -> Path:
    """Return the folder of compiled kernels; only this user may write to it, because its files are executed."""
    chosen = os.environ.get(VARIABLE)
    if chosen:
        return Path(chosen)
    for folder in _candidates():
        if _make_private(folder):
            return folder
    return Path(tempfile.mkdtemp(prefix="cuboid-kernels-"))


def _candidates() -> Iterator[Path]:
    """Yield the possible cache folders of the user, the usual one first."""
    for base in (os.environ.get("XDG_CACHE_HOME"), os.environ.get("LOCALAPPDATA")):
        if base and os.path.isabs(base):
            yield Path(base, "cuboid", "kernels")
    home = os.path.expanduser("~")
    if os.path.isabs(home):
        yield Path(home, ".cache", "cuboid", "kernels")
    yield Path(tempfile.gettempdir(), f"cuboid-kernels-{_user()}")


def _user() -> int:
    return os.getuid() if hasattr(os, "getuid") else 0  # on Windows these folders are the user's anyway


def _make_private(folder: Path) -> bool:
    """Make a folder and return whether only this user can write to it; its files are executed."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
    except OSError:
        return False
    is_private = not hasattr(os, "getuid") or (status.st_uid == os.getuid() and not status.st_mode & 0o022)
    return stat.S_ISDIR(status.st_mode) and is_private and os.access(folder, os.W_OK | os.X_OK)


def is_writable() -> bool:
    """Return whether compiled kernels can be stored."""
    folder = cache_folder()
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
    return folder.is_dir() and os.access(folder, os.W_OK | os.X_OK)


class _Location:
    """Tells numba the folder of a kernel; it replaces numba's locators, which know only the source file."""

    def __init__(self, function: FunctionType) -> None:
        self._py_file = function.__code__.co_filename

    def get_cache_path(self) -> str:
        return str(cache_folder())

    def ensure_cache_path(self) -> None:
        cache_folder().mkdir(parents=True, exist_ok=True)


class _Results(KernelResults):
    """The files of a compiled kernel, named by kernel and stamp."""

    def __init__(self, function: FunctionType) -> None:
        self._lineno = function.__code__.co_firstlineno
        self._locator = _Location(function)


class KernelCache(FunctionCache):
    """The compiled code of one kernel on disk.

    Its files are named by module, function and a stamp of all inputs of the compilation
    (`cuboid.ground.compiling.kernelstamp`). The stamp is computed when the kernel is first called: earlier, functions
    that it uses may not be defined yet.

    Parameters
    ----------
    function : FunctionType
        The Python function before compilation.
    options : mapping of str to object
        Compile options.

    Attributes
    ----------
    name : str
        Module and function, joined by a point.
    compiled : bool
        Whether this process has compiled it.
    """

    def __init__(self, function: FunctionType, options: Mapping[str, Any]) -> None:
        self.name = f"{function.__module__}.{function.__qualname__}"
        self._py_func = function
        self._options = options
        self._impl = _Results(function)
        self._cache_path = str(cache_folder())
        self._lock: int | None = None
        self.compiled = False
        self.enable()

    @cached_property
    def stamp(self) -> str:
        """Stamp of everything from which the kernel is compiled."""
        return stamp_of(self._py_func, self._options)

    @property
    def index(self) -> Path:
        """The file that lists the compiled signatures."""
        return cache_folder() / f"{self._base}.nbi"

    @property
    def installed(self) -> bool:
        """Whether its machine code came with the installation, and this processor can run it."""
        return baseline.usable_baseline() is not None and (baseline.FOLDER / f"{self._base}.nbi").exists()

    @property
    def busy(self) -> bool:
        """Whether another process is compiling the kernel."""
        try:
            locks.release(locks.lock_file(self._lock_path), self._lock_path)
        except BlockingIOError:
            return True
        except OSError:  # nothing can be written
            return False
        return False

    @property
    def _base(self) -> str:
        return f"{self.name}-{self.stamp[:STAMP_DIGITS]}"

    @cached_property
    def _cache_file(self) -> Any:  # type: ignore[override]
        return KernelFile(self._cache_path, self._base, self.stamp)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the cached code for a signature; None if this process must compile it.

        The kernel is then locked until `save_overload`: another process that needs it waits, and loads it.
        """
        found = self._load_installed(sig, target_context)
        if found is None:
            found = self._load(sig, target_context)
        if found is None and self._lock_or_wait():
            found = self._load(sig, target_context)
            if found is not None:
                self._unlock()
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save compiled code; if the disk is full or not writable, the run continues without saving it."""
        self.compiled = True
        try:
            with suppress(OSError):
                new = not self.index.exists()
                super().save_overload(sig, data)
                if new:
                    prune(self.name, self.index)
        finally:
            self._unlock()

    def _load(self, sig: Any, target_context: Any) -> Any:
        found = None
        try:
            with self._guard_against_spurious_io_errors():
                found = self._load_overload(sig, target_context)
        except Exception:  # a damaged file may raise anything: the kernel is compiled again
            with suppress(OSError):
                self.index.unlink()
        if found is not None:
            with suppress(OSError):
                os.utime(self.index)
        return found

    def _load_installed(self, sig: Any, target_context: Any) -> Any:
        """Return the code for a signature that came with the installation; None if there is none that can be used."""
        processor = baseline.usable_baseline()
        if processor is None:
            return None
        key, fields = self._index_key(sig, target_context.codegen())
        triple = key[1][0]
        key = key[0], (triple, processor.cpu, processor.environment["NUMBA_CPU_FEATURES"]), *key[2:]
        try:
            data = KernelFile(str(baseline.FOLDER), self._base, self.stamp).load((key, fields))
            return None if data is None else self._impl.rebuild(target_context, data)
        except Exception:  # a damaged file may raise anything: the user's cache has the kernel, or it is compiled
            return None

    @property
    def _lock_path(self) -> Path:
        return cache_folder() / f"{self._base}.lock"

    def _lock_or_wait(self) -> bool:
        """Lock the kernel; return whether another process had it, so that it may be in the cache now."""
        if self._lock is not None:  # it calls itself with other types
            return False
        try:
            if self._try_lock():
                return False
            compiletime.begin()
            try:
                self._wait()
            finally:
                compiletime.end()
        except OSError:  # nothing can be written: each process compiles for itself
            return False
        return True

    def _wait(self) -> None:
        """Wait until no other process compiles the kernel, and lock it; give up after `MAX_WAIT_S`."""
        begun_s = time.perf_counter()
        while not self._try_lock() and time.perf_counter() - begun_s < MAX_WAIT_S:
            time.sleep(RETRY_S)

    def _try_lock(self) -> bool:
        with suppress(BlockingIOError):
            self._lock = locks.lock_file(self._lock_path)
        return self._lock is not None

    def _unlock(self) -> None:
        if self._lock is not None:
            locks.release(self._lock, self._lock_path)
            self._lock = None

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        """Return numba's key plus the field names of named tuples in the arguments: the code depends on their order."""
        arguments = getattr(sig, "args", sig)
        fields = tuple(getattr(getattr(argument, "instance_class", None), "_fields", ()) for argument in arguments)
        return super()._index_key(sig, codegen), fields


def prune(name: str, current: Path) -> None:
    """Remove old versions of a kernel, and kernels that no run has used for `UNUSED_S`.

    Parameters
    ----------
    name : str
        Module and function of the kernel.
    current : Path
        The index file of the version in use.
    """
    folder, now_s = current.parent, time.time()
    ages = {index: now_s - index.stat().st_mtime for index in folder.glob("*.nbi") if index != current}
    earlier = sorted((index for index in ages if index.name.rpartition("-")[0] == name), key=ages.__getitem__)
    for index in {*earlier[KEPT_VERSIONS:], *(index for index, age_s in ages.items() if age_s > UNUSED_S)}:
        for data in folder.glob(f"{index.stem}.*.nbc"):
            data.unlink(missing_ok=True)
        index.unlink(missing_ok=True)
