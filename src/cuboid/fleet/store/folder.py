"""The place of a store: a local folder or one in an object store; files appear complete or not at all."""

from __future__ import annotations

import io
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import fsspec
import pyarrow as pa
import pyarrow.parquet as pq

from cuboid.ground.core.errors import CuboidError, InputError, OutputError, one_line
from cuboid.ground.formats.reading import MAX_BINARY_BYTES, UnreadableError, read_bytes
from cuboid.results.files.pending import PendingFile, new_file

# Packages whose errors are refusals of an object store.
CLOUD_PACKAGES = ("botocore", "aiobotocore", "gcsfs", "azure", "aiohttp")
# Folder of the result folders within a store.
RESULTS = "results"

# Minimum number of rows for Parquet dictionaries: with fewer rows they double the writing time and save no space.
DICTIONARY_ROWS = 10_000


class StoreFolder:
    """A folder of files, local or in an object store.

    Parameters
    ----------
    url : str
        A path, or a URL of fsspec such as ``s3://bucket/store``.

    Attributes
    ----------
    url : str
    local : Path or None
        The folder's local path, or None if it is remote.
    fs
        The fsspec file system.
    root : str
        The folder's path in the file system.

    Raises
    ------
    InputError
        The kind of URL is unknown, a package for it is missing, or it names no place.
    """

    def __init__(self, url: str) -> None:
        if url.endswith("://"):
            raise InputError(f"{url}: expected a folder or URL of a store")
        self.url = url.rstrip("/") or "/"
        local = os.path.abspath(self.url.removeprefix("file://"))
        self.local = None if is_remote(self.url) else Path(local)
        self.fs, self.root = self._remote() if self.local is None else (fsspec.filesystem("file"), local)

    def __reduce__(self) -> tuple[type[StoreFolder], tuple[str]]:
        return StoreFolder, (self.url,)

    def _remote(self) -> tuple[Any, str]:
        """Return the file system of a URL, and the folder's path in it."""
        try:
            fs, root = fsspec.core.url_to_fs(self.url, use_listings_cache=False)
            return fs, str(root)
        except (ImportError, ValueError, TypeError, OSError) as error:
            raise InputError(f"{self.url}: cannot be opened: {one_line(str(error))}") from None

    def path(self, name: str) -> str:
        """Return a file's path in the file system."""
        return f"{self.root.rstrip('/')}/{name}"

    def address(self, name: str) -> str:
        """Return a file's address for DuckDB: a path, or a URL of the file system."""
        path = self.path(name)
        return path if self.local is not None else str(self.fs.unstrip_protocol(path))

    def names(self, folder: str) -> list[str]:
        """Return all files below a folder, relative to the store, sorted; none if the folder is missing."""
        start = len(self.path(""))
        with refusals(self.url, "read"):
            try:
                found = self.fs.find(self.path(folder))
            except FileNotFoundError:
                return []
        return sorted(str(name)[start:] for name in found if not Path(str(name)).name.startswith("."))

    def read(self, name: str) -> bytes:
        """Return the contents of a file; raise FileNotFoundError if it is missing.

        Raises
        ------
        InputError
            It cannot be read: it is no file, or the file system refuses.
        """
        if self.local is not None:
            try:
                return read_bytes(self.local / name, MAX_BINARY_BYTES)
            except UnreadableError as error:
                if error.missing:
                    raise FileNotFoundError(str(error)) from None
                raise
        with refusals(f"{self.url}/{name}", "read"):
            return bytes(self.fs.cat_file(self.path(name)))

    def put(self, name: str, content: bytes) -> None:
        """Write a file atomically; it replaces an existing one.

        Raises
        ------
        OutputError
            The file cannot be written.
        """
        if self.local is None:
            with refusals(f"{self.url}/{name}", "written"):
                self.fs.pipe_file(self.path(name), content)
            return
        with new_file(self.local / name, force=True) as partial:
            partial.write_bytes(content)

    def create(self, name: str, content: bytes) -> bool:
        """Create a file atomically; return False, without writing, if the name is already taken."""
        if self.local is None:
            with refusals(f"{self.url}/{name}", "written"):
                try:
                    self.fs.pipe_file(self.path(name), content, mode="create")
                except FileExistsError:
                    return False
            return True
        file = PendingFile(self.local / name)
        with file.writing():
            file.path.parent.mkdir(parents=True, exist_ok=True)
            file.partial.write_bytes(content)
            try:
                os.link(file.partial, file.path)  # fails if the name is taken; a rename would replace the file
            except FileExistsError:
                return False
            finally:
                file.drop()
        return True

    def remove(self, names: Iterable[str]) -> None:
        """Remove files; missing ones are ignored."""
        for name in names:
            try:
                self.fs.rm_file(self.path(name))
            except FileNotFoundError:
                continue
            except OSError as error:
                raise OutputError(f"{self.url}/{name}: cannot be removed: {error}") from error

    def put_table(self, name: str, table: pa.Table, group_rows: int) -> None:
        """Write a table as a Parquet file, in groups of `group_rows` rows."""
        content = io.BytesIO()
        many = len(table) >= DICTIONARY_ROWS
        pq.write_table(table, content, compression="zstd", row_group_size=group_rows, use_dictionary=many)
        self.put(name, content.getvalue())

    def read_table(self, name: str, schema: pa.Schema) -> pa.Table:
        """Return columns of the table in a Parquet file; raise FileNotFoundError if it is missing.

        Parameters
        ----------
        name : str
        schema : pyarrow.Schema
            Schema of the columns.

        Raises
        ------
        InputError
            The file is damaged, or holds another table.
        """
        content = self.read(name)
        try:
            return pq.read_table(io.BytesIO(content), columns=schema.names, partitioning=None).cast(schema)
        except (pa.ArrowException, OSError, ValueError, KeyError) as error:
            raise InputError(f"{self.url}/{name}: is no table of a store, or damaged: {one_line(str(error))}") from None

    def put_folder(self, folder: Path, name: str, last: str) -> None:
        """Copy the files of a local folder; `last`, which marks the copy as complete, is copied last."""
        for file in sorted(folder.iterdir(), key=lambda file: (file.name == last, file.name)):
            self.put(f"{name}/{file.name}", file.read_bytes())


def is_remote(url: str) -> bool:
    """Tell whether a path is a URL of a remote place."""
    return "://" in url and not url.startswith("file://")


@contextmanager
def refusals(what: str, verb: str) -> Iterator[None]:
    """Turn errors of a file system into one line; FileNotFoundError and FileExistsError pass."""
    try:
        yield
    except (FileNotFoundError, FileExistsError):
        raise
    except Exception as error:
        expected = isinstance(error, (OSError, ValueError)) or type(error).__module__.startswith(CLOUD_PACKAGES)
        if not expected or isinstance(error, CuboidError):
            raise
        fault = OutputError if verb == "written" else InputError
        raise fault(f"{what}: cannot be {verb}: {one_line(str(error) or type(error).__name__)}") from error
