"""Locks between processes, on files and folders; the operating system releases them when a process ends."""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

if sys.platform == "win32":
    import msvcrt

    # Windows does not wake a process that waits for a lock; the lock is tried again after this time, seconds.
    RETRY_S = 0.05

    def _take(handle: int, *, wait: bool) -> None:
        while True:
            try:
                os.lseek(handle, 0, os.SEEK_SET)
                msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
                return
            except PermissionError as error:
                if not wait:
                    raise BlockingIOError(error.errno, error.strerror) from None
                time.sleep(RETRY_S)

    def _open_folder(folder: Path) -> int:
        """Open a lock file in place of a folder: Windows opens no folders, and renames none that contain open files."""
        os.stat(folder)  # raises FileNotFoundError if the folder does not exist
        name = hashlib.sha256(os.path.normcase(os.path.realpath(folder)).encode()).hexdigest()[:32]
        return os.open(Path(tempfile.gettempdir(), f"cuboid-{name}.lock"), os.O_RDWR | os.O_CREAT)

    def release(handle: int, path: Path | None = None) -> None:
        """Unlock, and remove the lock file `path` if it is given."""
        with suppress(OSError):
            os.lseek(handle, 0, os.SEEK_SET)
            msvcrt.locking(handle, msvcrt.LK_UNLCK, 1)
        os.close(handle)
        if path is not None:
            with suppress(OSError):  # another process has it open already
                path.unlink()

else:
    import fcntl

    def _take(handle: int, *, wait: bool) -> None:
        fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))

    def _open_folder(folder: Path) -> int:
        return os.open(folder, os.O_RDONLY)

    def release(handle: int, path: Path | None = None) -> None:
        """Unlock, and remove the lock file `path` if it is given."""
        if path is not None:
            with suppress(OSError):  # removed before unlocking: no other process can hold the lock yet
                path.unlink()
        os.close(handle)


def lock_folder(folder: Path, *, wait: bool = True, required: bool = False) -> int:
    """Lock a folder until `release`.

    Parameters
    ----------
    folder : Path
    wait : bool
        Whether to wait while another process holds the lock.
    required : bool
        Whether a file system without locks is an error. If False, the folder stays unlocked there.

    Returns
    -------
    handle : int

    Raises
    ------
    BlockingIOError
        If another process holds the lock and `wait` is False.
    OSError
        If the folder cannot be opened, or cannot be locked although `required` is True.
    """
    return _locked(_open_folder(folder), wait=wait, required=required)


def lock_file(path: Path) -> int:
    """Create a file and lock it until `release(handle, path)`, which removes it; without lock support, only open it.

    Raises
    ------
    BlockingIOError
        If another process holds the lock.
    OSError
        If the file cannot be opened or created.
    """
    while True:
        handle = _locked(os.open(path, os.O_RDWR | os.O_CREAT, 0o644), wait=False, required=False)
        with suppress(OSError):
            if os.fstat(handle).st_ino == path.stat().st_ino:
                return handle
        release(handle)  # the process that held the lock has just removed the file


def _locked(handle: int, *, wait: bool, required: bool) -> int:
    try:
        _take(handle, wait=wait)
    except BlockingIOError:
        os.close(handle)
        raise
    except OSError:
        if required:
            os.close(handle)
            raise
    return handle
