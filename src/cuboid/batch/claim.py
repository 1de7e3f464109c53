"""One batch at a time works on a store: another one waits, and then does what is left."""

from __future__ import annotations

import fcntl
import json
import os
import secrets
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from cuboid.errors import CuboidError
from cuboid.outputs.folder import writing
from cuboid.store.place import Place

# The lock of a store; other commands leave hidden files alone.
LOCK = ".batch.lock"
# On an object store the lock is a file that its holder writes anew this often; after so long without, seconds, the
# holder counts as killed.
RENEW_S = 10.0
EXPIRE_S = 60.0
# A batch that waits looks this often, seconds.
POLL_S = 1.0


@contextmanager
def claimed(place: Place, waiting: Callable[[], None]) -> Iterator[None]:
    """Hold a store for one batch; wait while another batch holds it.

    On a folder the lock ends with its process. On an object store that of a killed batch expires after `EXPIRE_S`; it
    is no guarantee there, and two batches that hold it both are safe, but do the same work.

    Parameters
    ----------
    place : Place
        The store.
    waiting : callable
        Called once where another batch holds the store.

    Raises
    ------
    OutputError
        The store cannot be written.
    """
    with _file_lock(place.local, waiting) if place.local is not None else _lease(place, waiting):
        yield


@contextmanager
def _file_lock(store: Path, waiting: Callable[[], None]) -> Iterator[None]:
    handle = _locked(store, waiting)
    try:
        yield
    finally:
        with suppress(OSError):  # nothing was done: leave no folder
            if os.listdir(store) == [LOCK]:
                (store / LOCK).unlink()
                store.rmdir()
        os.close(handle)


def _locked(store: Path, waiting: Callable[[], None]) -> int:
    """Return a handle of the lock's file; it is locked until the handle is closed."""
    while True:
        with writing(store / LOCK):
            store.mkdir(parents=True, exist_ok=True)
            handle = os.open(store / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        with suppress(OSError):  # a file system without locks
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                waiting()
                fcntl.flock(handle, fcntl.LOCK_EX)
        with suppress(FileNotFoundError):
            if os.fstat(handle).st_ino == (store / LOCK).stat().st_ino:
                return handle
        os.close(handle)  # the holder before has just removed the file


@contextmanager
def _lease(place: Place, waiting: Callable[[], None]) -> Iterator[None]:
    holder = secrets.token_hex(8)
    _take(place, _lease_content(holder, 0), waiting)
    ended = threading.Event()
    renewing = threading.Thread(target=_renew, args=(place, holder, ended), daemon=True)
    renewing.start()
    try:
        yield
    finally:
        ended.set()
        renewing.join()
        place.remove([LOCK])


def _take(place: Place, content: bytes, waiting: Callable[[], None]) -> None:
    """Create the file of the lock; remove one that nobody renews."""
    seen, since_s = b"", time.monotonic()
    while not place.create(LOCK, content):
        try:
            found = place.read(LOCK)
        except FileNotFoundError:  # just released
            continue
        now_s = time.monotonic()
        if found != seen:
            if not seen:
                waiting()
            seen, since_s = found, now_s
        elif now_s - since_s > EXPIRE_S:
            place.remove([LOCK])
            continue
        time.sleep(POLL_S)


def _renew(place: Place, holder: str, ended: threading.Event) -> None:
    count = 0
    while not ended.wait(RENEW_S):
        count += 1
        with suppress(CuboidError):  # a network that fails for a moment
            place.put(LOCK, _lease_content(holder, count))


def _lease_content(holder: str, count: int) -> bytes:
    return json.dumps({"holder": holder, "renewed": count}).encode("ascii")
