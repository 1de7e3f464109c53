"""Locks keep two processes apart, on POSIX and, as far as it can be tried here, on Windows."""

from __future__ import annotations

import fcntl
import importlib.util
import os
import subprocess
import sys
import threading
from pathlib import Path
from types import ModuleType

import pytest

from cuboid.ground import locks

HOLDER = """
import sys
from pathlib import Path
from cuboid.ground import locks
handle = locks.{call}(Path({path!r}))
print("locked", flush=True)
sys.stdin.read()
"""


def windows_locks(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Load the module as Windows does, with locks of bytes as `msvcrt` makes them."""
    msvcrt = ModuleType("msvcrt")
    msvcrt.LK_NBLCK, msvcrt.LK_UNLCK = 2, 0  # type: ignore[attr-defined]

    def locking(handle: int, mode: int, count: int) -> None:
        if mode == 0:
            fcntl.flock(handle, fcntl.LOCK_UN)
            return
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise PermissionError(13, "Permission denied") from error

    msvcrt.locking = locking  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "msvcrt", msvcrt)
    spec = importlib.util.spec_from_file_location("windows_locks", locks.__file__)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    with monkeypatch.context() as patched:
        patched.setattr(sys, "platform", "win32")
        patched.setitem(sys.modules, "fcntl", None)
        spec.loader.exec_module(module)
    return module


@pytest.fixture(params=["posix", "windows"])
def module(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    return locks if request.param == "posix" else windows_locks(monkeypatch)


def test_a_folder_is_locked_until_it_is_released(module: ModuleType, tmp_path: Path) -> None:
    handle = module.lock_folder(tmp_path)
    with pytest.raises(BlockingIOError):
        module.lock_folder(tmp_path, wait=False)
    module.release(handle)
    module.release(module.lock_folder(tmp_path, wait=False))
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_gone_is_not_made(module: ModuleType, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        module.lock_folder(tmp_path / "gone")
    assert list(tmp_path.iterdir()) == []


def test_the_file_of_a_lock_is_removed_with_it(module: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "a.lock"
    handle = module.lock_file(path)
    with pytest.raises(BlockingIOError):
        module.lock_file(path)
    module.release(handle, path)
    assert not path.exists()
    module.release(module.lock_file(path), path)


def test_who_waits_gets_the_lock_when_it_is_released(module: ModuleType, tmp_path: Path) -> None:
    handle = module.lock_folder(tmp_path)
    taken: list[int] = []
    thread = threading.Thread(target=lambda: taken.append(module.lock_folder(tmp_path)))
    thread.start()
    assert taken == []
    module.release(handle)
    thread.join(30.0)
    assert len(taken) == 1
    module.release(taken[0])


@pytest.mark.parametrize("call", ["lock_folder", "lock_file"])
def test_a_process_that_is_killed_loses_its_lock(tmp_path: Path, call: str) -> None:
    path = tmp_path if call == "lock_folder" else tmp_path / "a.lock"
    words = [sys.executable, "-c", HOLDER.format(call=call, path=str(path))]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "locked\n"
        with pytest.raises(BlockingIOError):
            locks.lock_folder(path, wait=False) if call == "lock_folder" else locks.lock_file(path)
        holder.kill()
    os.close(locks.lock_folder(path, wait=False) if call == "lock_folder" else locks.lock_file(path))


def test_a_file_system_without_locks_stops_only_who_requires_one(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(38, "Function not implemented")

    monkeypatch.setattr(fcntl, "flock", refuse)
    locks.release(locks.lock_folder(tmp_path))
    with pytest.raises(OSError, match="not implemented"):
        locks.lock_folder(tmp_path, required=True)
