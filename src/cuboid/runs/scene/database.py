"""The file of a scene: opening, validation, and the lock that allows one writing process at a time."""

from __future__ import annotations

import sqlite3
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from cuboid.ground.core.errors import InputError, OutputError
from cuboid.ground.core.limits import MAX_SCENE_VALUE_BYTES
from cuboid.ground.formats.reading import kind_of, real_path
from cuboid.ground.locks import lock_file, release
from cuboid.results.files.pending import replacing
from cuboid.runs.scene.schema import APPLICATION_ID, SCENE_VERSION, TABLES
from cuboid.runs.scene.validation import DamagedError

# The writing process holds a lock on the file with this suffix beside the scene.
LOCK = "-writer"
# Suffixes of SQLite's own files beside the scene.
SUFFIXES = ("-journal", "-wal", "-shm")
# Maximum waiting time, seconds, for another process that briefly holds the file.
LOCK_TIMEOUT_S = 10.0
# Size of a page of the file, bytes: the map's blocks are much larger.
PAGE_BYTES = 4096
# Pages of the write-ahead log before a checkpoint copies them into the file (64 MB): several commits, most of which
# write the same blocks. CACHE_KB is the memory for pages, KiB: a small cache makes SQLite write pages to the log
# continuously, not all at the end.
LOG_PAGES, CACHE_KB = 16384, 400


# The message for a damaged file.
RESCUE = "'cuboid scene check --rescue NEW' saves what can be read"


@contextmanager
def user_errors(path: Path) -> Iterator[None]:
    """Turn errors of SQLite, the system and the validation into one line.

    Raises
    ------
    InputError
        The file is damaged or no scene.
    OutputError
        The file cannot be written.
    """
    try:
        yield
    except DamagedError as error:
        raise InputError(f"{path}: {error}; {RESCUE}") from None
    except sqlite3.ProgrammingError:
        raise
    except sqlite3.DatabaseError as error:
        code = getattr(error, "sqlite_errorcode", 0) & 0xFF
        if code == sqlite3.SQLITE_NOTADB:
            raise InputError(f"{path}: is no scene file of Cuboid") from error
        if code in (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR):
            raise OutputError(f"{path}: cannot be written: the disk is full, or fails ({error})") from error
        if code in (sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY, sqlite3.SQLITE_PERM):
            raise OutputError(f"{path}: cannot be opened or written: {error}") from error
        if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
            raise OutputError(f"{path}: another program holds the file: {error}") from error
        raise InputError(f"{path}: the scene file is damaged ({error}); {RESCUE}") from error


class _Connection(sqlite3.Connection):
    """A connection that reports a damaged file as damaged, also where a text is not valid UTF-8."""

    def execute(self, *given: Any) -> sqlite3.Cursor:
        try:
            return super().execute(*given)
        except UnicodeDecodeError as error:
            raise sqlite3.DatabaseError("what it says of its tables is no text") from error


@contextmanager
def transaction(connection: sqlite3.Connection) -> Iterator[None]:
    """Run a transaction: everything written inside is kept, or nothing."""
    connection.execute("BEGIN IMMEDIATE")
    try:
        yield
        connection.execute("COMMIT")
    except BaseException:
        if connection.in_transaction:  # SQLite may have ended it already: full disk
            connection.execute("ROLLBACK")
        raise


def open_to_read(path: Path) -> sqlite3.Connection:
    """Open a scene for reading, while another process may write it.

    The file is not changed: one of an earlier version is copied into a temporary database, and the copy is migrated.

    Raises
    ------
    InputError
        There is no file, it is no scene, it is damaged, or of another version.
    """
    if not path.is_file():
        raise InputError(f"{path}: there is no such scene file")
    _refuse_other(path)
    with user_errors(path):
        try:  # not "ro": the last connection to close a scene cleans up its log
            connection = _connect(path, "rw")
            _refuse_other_version(connection, path)
        except sqlite3.OperationalError:  # read-only place: no other process writes there either
            connection = _connect(path, "ro", immutable=True)
            _refuse_other_version(connection, path)
        connection.execute("PRAGMA query_only = ON")
    return connection


def open_damaged(path: Path) -> sqlite3.Connection:
    """Open a possibly damaged scene for reading, without validation.

    Raises
    ------
    InputError
        There is no file, or it is no database.
    """
    if not path.is_file():
        raise InputError(f"{path}: there is no such scene file")
    _refuse_other(path)
    with user_errors(path):
        return _connect(path, "ro")


class Writing:
    """A scene opened for writing: its connection, and the lock that keeps other processes from writing.

    Parameters
    ----------
    path : Path
    create : bool
        Whether a missing scene is created.

    Attributes
    ----------
    connection : sqlite3.Connection
        The caller begins and ends transactions.

    Raises
    ------
    InputError
        The file is no scene, damaged, or of another version; or it is missing and `create` is False.
    OutputError
        Another process writes the scene, or it cannot be written.
    """

    def __init__(self, path: Path, *, create: bool = False) -> None:
        self._path = path
        if not create and not path.is_file():
            raise InputError(f"{path}: there is no such scene file")
        if path.is_dir():
            raise OutputError(f"{path}: is a folder; expected a scene file")
        _refuse_other(path)
        self._lock = _locked(path)
        try:
            if create and not (path.exists() and path.stat().st_size):
                _make(path)
            with user_errors(path):
                self.connection = _connect(path, "rw")
                _prepare(self.connection, path)
        except BaseException:
            self._unlock()
            raise

    def close(self) -> None:
        """Close the file after releasing its free pages; uncommitted changes are dropped."""
        try:
            with user_errors(self._path):
                if self.connection.in_transaction:
                    self.connection.execute("ROLLBACK")
                with suppress(sqlite3.OperationalError):  # on a full disk the free pages stay
                    self.connection.executescript("PRAGMA incremental_vacuum")
                self.connection.close()
        finally:
            self._unlock()

    def _unlock(self) -> None:
        release(self._lock, _lock_path(self._path))


def _connect(path: Path, mode: str, *, immutable: bool = False) -> sqlite3.Connection:
    quiet = "&immutable=1" if immutable else ""
    uri = f"{real_path(path).as_uri()}?mode={mode}{quiet}"
    connection = sqlite3.connect(
        uri, uri=True, timeout=LOCK_TIMEOUT_S, isolation_level=None, check_same_thread=False, factory=_Connection
    )
    connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_SCENE_VALUE_BYTES)
    connection.execute("PRAGMA foreign_keys = ON")
    return connection


def _refuse_other(path: Path) -> None:
    """Raise InputError for files that SQLite would take for an empty database, and for devices."""
    with suppress(OSError):
        if path.is_file() and 0 < path.stat().st_size < 100:
            raise InputError(f"{path}: is no scene file of Cuboid")
    whole = real_path(path)
    for ending in SUFFIXES:
        place = whole.with_name(whole.name + ending)
        with suppress(OSError):
            found = place.stat()
            if not stat.S_ISREG(found.st_mode):
                raise InputError(f"{place}: is {kind_of(found)}, a regular file was expected: it belongs to the scene")


def _refuse_other_version(connection: sqlite3.Connection, path: Path) -> None:
    """Raise InputError if a database is no scene, or of another version."""
    application = connection.execute("PRAGMA application_id").fetchone()[0]
    version = int(connection.execute("PRAGMA user_version").fetchone()[0])
    if application != APPLICATION_ID:
        raise InputError(f"{path}: is a database, but no scene file of Cuboid")
    if version != SCENE_VERSION:
        raise InputError(
            f"{path}: was written by another Cuboid (scene version {version}); this one reads version {SCENE_VERSION}"
        )


def _make(path: Path) -> None:
    """Create an empty scene that appears only when complete: readers find a whole scene or no file."""
    with replacing(path) as partial, user_errors(path):
        connection = _connect(partial, "rwc")
        connection.execute(f"PRAGMA page_size = {PAGE_BYTES}")
        connection.execute("PRAGMA auto_vacuum = INCREMENTAL")
        connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        connection.execute(f"PRAGMA user_version = {SCENE_VERSION}")
        connection.executescript("\n".join(table.sql(name) for name, table in TABLES.items()))
        connection.close()


def _prepare(connection: sqlite3.Connection, path: Path) -> None:
    """Refuse a file that is no scene of this version, and allow others to read during writes."""
    _refuse_other_version(connection, path)
    if connection.execute("PRAGMA journal_mode = WAL").fetchone()[0] != "wal":
        raise OutputError(f"{path}: cannot be written: this place allows no write-ahead log")
    connection.execute("PRAGMA synchronous = NORMAL")
    connection.execute(f"PRAGMA wal_autocheckpoint = {LOG_PAGES}")
    connection.execute(f"PRAGMA cache_size = -{CACHE_KB}")


def _lock_path(path: Path) -> Path:
    return path.with_name(path.name + LOCK)


def _locked(path: Path) -> int:
    """Return a lock that keeps other processes from writing until it is released."""
    try:
        return lock_file(_lock_path(path))
    except BlockingIOError:
        raise OutputError(f"{path}: another program is writing this scene; others can only read it") from None
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror}") from error
