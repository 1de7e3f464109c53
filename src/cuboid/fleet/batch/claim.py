"""A lock for one batch at a time on a store: a second batch waits, and then processes the remaining recordings."""

from __future__ import annotations

import json
import secrets
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from cuboid.fleet.store.folder import StoreFolder
from cuboid.ground.core.errors import CuboidError
from cuboid.ground.formats.folder import writing
from cuboid.ground.locks import lock_file, release

# The lock of a store; other commands leave hidden files alone.
LOCK = ".batch.lock"
# On an object store the lock is a file that its holder rewrites every RENEW_S seconds; if it was not rewritten for
# EXPIRE_S seconds, the holder counts as killed.
RENEW_S = 10.0
EXPIRE_S = 60.0
# Interval at which a waiting batch checks the lock, seconds.
LOCK_POLL_S = 1.0


@contextmanager
def claimed(place: StoreFolder, waiting: Callable[[], None]) -> Iterator[None]:
    """Hold a store for one batch; wait while another batch holds it.

    In a local folder the lock ends with its process. On an object store the lock of a killed batch expires after
    `EXPIRE_S`. It is no guarantee there: two batches may hold it, which is safe, but they do the same work twice.

    Parameters
    ----------
    place : StoreFolder
        The store.
    waiting : callable
        Called once if another batch holds the store.

    Raises
    ------
    OutputError
        The store cannot be written.
    """
    with _file_lock(place.local, waiting) if place.local is not None else _lease(place, waiting):
        yield


@contextmanager
def _file_lock(store: Path, waiting: Callable[[], None]) -> Iterator[None]:
    handle = _locked(store / LOCK, waiting)
    try:
        yield
    finally:
        release(handle, store / LOCK)
        with suppress(OSError):  # removes the folder if it is empty, when nothing was done
            store.rmdir()


def _locked(path: Path, waiting: Callable[[], None]) -> int:
    """Return the handle of the lock's file once it is locked."""
    called = False
    while True:
        with writing(path), suppress(BlockingIOError, FileNotFoundError):  # held by another batch, or just removed
            path.parent.mkdir(parents=True, exist_ok=True)
            return lock_file(path)
        if not called:
            waiting()
            called = True
        time.sleep(LOCK_POLL_S)


@contextmanager
def _lease(place: StoreFolder, waiting: Callable[[], None]) -> Iterator[None]:
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


def _take(place: StoreFolder, content: bytes, waiting: Callable[[], None]) -> None:
    """Create the lock file; remove an expired one."""
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
        time.sleep(LOCK_POLL_S)


def _renew(place: StoreFolder, holder: str, ended: threading.Event) -> None:
    count = 0
    while not ended.wait(RENEW_S):
        count += 1
        with suppress(CuboidError):  # a short network failure
            place.put(LOCK, _lease_content(holder, count))


def _lease_content(holder: str, count: int) -> bytes:
    return json.dumps({"holder": holder, "renewed": count}).encode("ascii")
