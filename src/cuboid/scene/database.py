"""The file of a scene: opened, checked to be one, and written by one process at a time."""

from __future__ import annotations

import sqlite3
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from cuboid.core.errors import InputError, OutputError
from cuboid.core.locks import lock_file, release
from cuboid.formats.reading import kind_of, real_path
from cuboid.outputs.pending import PendingFile
from cuboid.scene.schema import APPLICATION_ID, TABLES, VERSION
from cuboid.scene.validation import DamagedError

# Who writes holds a lock on the file of this name beside the scene.
LOCK = "-writer"
# SQLite keeps files of these names there.
BESIDE = ("-journal", "-wal", "-shm")
# How long one waits for another that has the file for a moment, seconds.
LOCK_TIMEOUT_S = 10.0
# A page of the file, bytes: the map's blocks are much larger.
PAGE_BYTES = 4096
# Pages of the log after which they are put where they belong, 64 MB: several commits, most of which write the same
# blocks. And memory for pages, KiB: with little, they go into the log as they are written, and not all in the end.
LOG_PAGES, CACHE_KB = 16384, 400


# The message for a damaged file.
RESCUE = "'cuboid scene check --rescue NEW' saves what can be read"


@contextmanager
def complaining(path: Path) -> Iterator[None]:
    """Turn what SQLite, the system and the validation refuse into one line.

    Raises
    ------
    InputError
        The file is damaged or no scene.
    OutputError
        It cannot be written.
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
    """A connection that says of a damaged file that it is, also where the damage is no text."""

    def execute(self, *given: Any) -> sqlite3.Cursor:
        try:
            return super().execute(*given)
        except UnicodeDecodeError as error:
            raise sqlite3.DatabaseError("what it says of its tables is no text") from error


@contextmanager
def transaction(connection: sqlite3.Connection) -> Iterator[None]:
    """Let all that is written inside be there afterwards, or nothing of it."""
    connection.execute("BEGIN IMMEDIATE")
    try:
        yield
        connection.execute("COMMIT")
    except BaseException:
        if connection.in_transaction:  # SQLite may have ended it: a full disk
            connection.execute("ROLLBACK")
        raise


def open_to_read(path: Path) -> sqlite3.Connection:
    """Open a scene that another one may be writing.

    The file is not changed: one of an earlier version is copied into a temporary database, and the copy is migrated.

    Raises
    ------
    InputError
        There is none, it is none, it is damaged, or of another version.
    """
    if not path.is_file():
        raise InputError(f"{path}: there is no such scene file")
    _refuse_other(path)
    with complaining(path):
        try:  # not "ro": whoever closes a scene last tidies up its log
            connection = _connect(path, "rw")
            _refuse_other_version(connection, path)
        except sqlite3.OperationalError:  # a place where nothing can be written: nobody else does either
            connection = _connect(path, "ro", immutable=True)
            _refuse_other_version(connection, path)
        connection.execute("PRAGMA query_only = ON")
    return connection


def open_damaged(path: Path) -> sqlite3.Connection:
    """Open what is left of a scene, whatever it holds, for reading.

    Raises
    ------
    InputError
        There is no file, or it is no database.
    """
    if not path.is_file():
        raise InputError(f"{path}: there is no such scene file")
    _refuse_other(path)
    with complaining(path):
        return _connect(path, "ro")


def has_table(connection: sqlite3.Connection, name: str) -> bool:
    """Tell whether a scene has a table, which it may be without."""
    query = "SELECT 1 FROM sqlite_master WHERE type = 'table' AND name = ?"
    return connection.execute(query, (name,)).fetchone() is not None


class Writing:
    """A scene opened by the one that writes it: its connection, and the lock that keeps others from writing.

    Parameters
    ----------
    path : Path
    create : bool
        Whether a scene that is not there is made.

    Attributes
    ----------
    connection : sqlite3.Connection
        Transactions begin and end where the caller says.

    Raises
    ------
    InputError
        It is no scene, damaged, or of another version; there is none and `create` is not given.
    OutputError
        Another one writes it, or it cannot be written.
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
            with complaining(path):
                self.connection = _connect(path, "rw")
                _prepare(self.connection, path)
        except BaseException:
            self._unlock()
            raise

    def close(self) -> None:
        """Let go of the file, without the room that is free in it; what was not committed is dropped."""
        try:
            with complaining(self._path):
                if self.connection.in_transaction:
                    self.connection.execute("ROLLBACK")
                with suppress(sqlite3.OperationalError):  # a full disk keeps its free room
                    self.connection.executescript("PRAGMA incremental_vacuum")
                self.connection.close()
        finally:
            self._unlock()

    def _unlock(self) -> None:
        release(self._lock, _lock_path(self._path))


def open_to_write(path: Path, *, create: bool = False) -> Writing:
    """Open or make a scene to write; see `Writing`."""
    return Writing(path, create=create)


def _connect(path: Path, mode: str, *, immutable: bool = False) -> sqlite3.Connection:
    quiet = "&immutable=1" if immutable else ""
    uri = f"{real_path(path).as_uri()}?mode={mode}{quiet}"
    connection = sqlite3.connect(
        uri, uri=True, timeout=LOCK_TIMEOUT_S, isolation_level=None, check_same_thread=False, factory=_Connection
    )
    connection.execute("PRAGMA foreign_keys = ON")
    return connection


def _refuse_other(path: Path) -> None:
    """Raise InputError where SQLite would take a file that is no database for an empty one, or wait for a device."""
    with suppress(OSError):
        if path.is_file() and 0 < path.stat().st_size < 100:
            raise InputError(f"{path}: is no scene file of Cuboid")
    whole = real_path(path)
    for ending in BESIDE:
        place = whole.with_name(whole.name + ending)
        with suppress(OSError):
            found = place.stat()
            if not stat.S_ISREG(found.st_mode):
                raise InputError(f"{place}: is {kind_of(found)}, a regular file was expected: it belongs to the scene")


def _refuse_other_version(connection: sqlite3.Connection, path: Path) -> None:
    """Raise InputError where a database is no scene, or one of another version."""
    application = connection.execute("PRAGMA application_id").fetchone()[0]
    version = int(connection.execute("PRAGMA user_version").fetchone()[0])
    if application != APPLICATION_ID:
        raise InputError(f"{path}: is a database, but no scene file of Cuboid")
    if version != VERSION:
        raise InputError(
            f"{path}: was written by another Cuboid (scene version {version}); this one reads version {VERSION}"
        )


def _make(path: Path) -> None:
    """Make an empty scene, which appears when it is whole: whoever reads finds a scene or nothing."""
    file = PendingFile(path)
    with file.writing(), complaining(path):
        connection = _connect(file.partial, "rwc")
        connection.execute(f"PRAGMA page_size = {PAGE_BYTES}")
        connection.execute("PRAGMA auto_vacuum = INCREMENTAL")
        connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        connection.execute(f"PRAGMA user_version = {VERSION}")
        connection.executescript("\n".join(table.sql(name) for name, table in TABLES.items() if not table.optional))
        connection.close()
        file.show()


def _prepare(connection: sqlite3.Connection, path: Path) -> None:
    """Refuse what is no scene of this version, and let others read while it is written."""
    _refuse_other_version(connection, path)
    if connection.execute("PRAGMA journal_mode = WAL").fetchone()[0] != "wal":
        raise OutputError(f"{path}: cannot be written: this place allows no write-ahead log")
    connection.execute("PRAGMA synchronous = NORMAL")
    connection.execute(f"PRAGMA wal_autocheckpoint = {LOG_PAGES}")
    connection.execute(f"PRAGMA cache_size = -{CACHE_KB}")


def _lock_path(path: Path) -> Path:
    return path.with_name(path.name + LOCK)


def _locked(path: Path) -> int:
    """Return a lock that keeps others from writing until it is released."""
    try:
        return lock_file(_lock_path(path))
    except BlockingIOError:
        raise OutputError(f"{path}: another program is writing this scene; others can only read it") from None
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror}") from error
