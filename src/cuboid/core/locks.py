"""Locks between processes, on files and folders; the system lets go of them when their process ends."""

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

    # Windows wakes nobody who waits for a lock; it is asked again after this time, seconds.
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
        """Open a file that stands for a folder: Windows opens no folders, nor renames those with open files."""
        os.stat(folder)  # FileNotFoundError where there is none
        name = hashlib.sha256(os.path.normcase(os.path.realpath(folder)).encode()).hexdigest()[:32]
        return os.open(Path(tempfile.gettempdir(), f"cuboid-{name}.lock"), os.O_RDWR | os.O_CREAT)

    def release(handle: int, path: Path | None = None) -> None:
        """Unlock, and remove the file `path` of the lock where it is given."""
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
        """Unlock, and remove the file `path` of the lock where it is given."""
        if path is not None:
            with suppress(OSError):  # before it is unlocked: nobody else can hold it yet
                path.unlink()
        os.close(handle)


def lock_folder(folder: Path, *, wait: bool = True, required: bool = False) -> int:
    """Lock a folder until `release`.

    Parameters
    ----------
    folder : Path
    wait : bool
        Whether to wait while another process has it.
    required : bool
        Whether a file system without locks is an error. Otherwise the folder is not locked there.

    Returns
    -------
    handle : int

    Raises
    ------
    BlockingIOError
        Another process has it, and `wait` is False.
    OSError
        It cannot be opened, or cannot be locked although that is `required`.
    """
    return _locked(_open_folder(folder), wait=wait, required=required)


def lock_file(path: Path) -> int:
    """Make a file and lock it until `release(handle, path)`, which removes it; without locks it is only opened.

    Raises
    ------
    BlockingIOError
        Another process has it.
    OSError
        It cannot be opened or made.
    """
    while True:
        handle = _locked(os.open(path, os.O_RDWR | os.O_CREAT, 0o644), wait=False, required=False)
        with suppress(OSError):
            if os.fstat(handle).st_ino == path.stat().st_ino:
                return handle
        release(handle)  # the process that had it has just removed it


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
