"""Where a store lies: a folder of this machine or of an object store, of which a file appears whole or not at all."""

from __future__ import annotations

import io
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any

import fsspec
import pyarrow as pa
import pyarrow.parquet as pq

from cuboid.core.errors import CuboidError, InputError, OutputError, one_line
from cuboid.formats.reading import MAX_BINARY_BYTES, UnreadableError, read_bytes
from cuboid.outputs.pending import PendingFile

# Whose errors are refusals of an object store.
CLOUD_PACKAGES = ("botocore", "aiobotocore", "gcsfs", "azure", "aiohttp")
# The folder of a store that holds the result folders.
RESULTS = "results"

# With fewer rows dictionaries of values take as long to make as everything else, and spare nothing.
DICTIONARY_ROWS = 10_000


class Place:
    """A folder that is written file by file.

    Parameters
    ----------
    url : str
        A path, or a URL of fsspec such as ``s3://bucket/store``.

    Raises
    ------
    InputError
        Nobody knows this kind of URL, a package for it is missing, or it names no place.
    """

    def __init__(self, url: str) -> None:
        if url.endswith("://"):
            raise InputError(f"{url}: expected a folder or URL of a store")
        self.url = url.rstrip("/") or "/"
        _ = self.fs

    def __getstate__(self) -> dict[str, Any]:
        return {"url": self.url}

    @cached_property
    def _opened(self) -> tuple[Any, str]:
        try:
            if not is_remote(self.url):
                return fsspec.filesystem("file"), os.path.abspath(self.url.removeprefix("file://"))
            fs, root = fsspec.core.url_to_fs(self.url, use_listings_cache=False)
            return fs, str(root)
        except (ImportError, ValueError, TypeError, OSError) as error:
            raise InputError(f"{self.url}: cannot be opened: {one_line(str(error))}") from None

    @property
    def fs(self) -> Any:
        """The file system of fsspec."""
        return self._opened[0]

    @property
    def root(self) -> str:
        """The folder, as the file system calls it."""
        return self._opened[1]

    @property
    def local(self) -> Path | None:
        """The folder, where it is of this machine."""
        return None if is_remote(self.url) else Path(self.root)

    def path(self, name: str) -> str:
        """Return what the file system calls a file of the folder."""
        return f"{self.root.rstrip('/')}/{name}"

    def address(self, name: str) -> str:
        """Return what DuckDB calls a file of the folder: a path, or a URL of the file system."""
        path = self.path(name)
        return path if self.local is not None else str(self.fs.unstrip_protocol(path))

    def names(self, folder: str) -> list[str]:
        """Return all files below a folder, relative to the store, sorted; none where there is no such folder."""
        start = len(self.path(""))
        with refusals(self.url, "read"):
            try:
                found = self.fs.find(self.path(folder))
            except FileNotFoundError:
                return []
        return sorted(str(name)[start:] for name in found if not Path(str(name)).name.startswith("."))

    def read(self, name: str) -> bytes:
        """Return what a file holds; FileNotFoundError where there is none.

        Raises
        ------
        InputError
            It cannot be read: it is none, or the place refuses.
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
        """Write a file that appears, or replaces the one that is there, when it is whole.

        Raises
        ------
        OutputError
            It cannot be written.
        """
        if self.local is None:
            with refusals(f"{self.url}/{name}", "written"):
                self.fs.pipe_file(self.path(name), content)
            return
        file = PendingFile(self.local / name)
        with file.writing():
            file.path.parent.mkdir(parents=True, exist_ok=True)
            file.partial.write_bytes(content)
            file.show()

    def create(self, name: str, content: bytes) -> bool:
        """Write a file that appears whole; False, and nothing is written, where there is one of this name already."""
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
                os.link(file.partial, file.path)  # fails where the name is taken; a rename would replace
            except FileExistsError:
                return False
            finally:
                file.drop()
        return True

    def remove(self, names: Iterable[str]) -> None:
        """Remove files; those that are gone already are no fault."""
        for name in names:
            try:
                self.fs.rm_file(self.path(name))
            except FileNotFoundError:
                continue
            except OSError as error:
                raise OutputError(f"{self.url}/{name}: cannot be removed: {error}") from error

    def put_table(self, name: str, table: pa.Table, group_rows: int) -> None:
        """Write a table as a file of Parquet, in groups of this many rows."""
        content = io.BytesIO()
        many = len(table) >= DICTIONARY_ROWS
        pq.write_table(table, content, compression="zstd", row_group_size=group_rows, use_dictionary=many)
        self.put(name, content.getvalue())

    def read_table(self, name: str, schema: pa.Schema) -> pa.Table:
        """Return columns of the table in a file of Parquet; FileNotFoundError where there is none.

        Parameters
        ----------
        name : str
        schema : pyarrow.Schema
            Of the columns.

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
        """Copy the files of a local folder, the one that makes them whole last."""
        for file in sorted(folder.iterdir(), key=lambda file: (file.name == last, file.name)):
            self.put(f"{name}/{file.name}", file.read_bytes())


def is_remote(url: str) -> bool:
    """Tell whether a path is a URL of another place than this machine."""
    return "://" in url and not url.startswith("file://")


@contextmanager
def refusals(what: str, verb: str) -> Iterator[None]:
    """Turn what a file system refuses into one line; FileNotFoundError and FileExistsError pass."""
    try:
        yield
    except (FileNotFoundError, FileExistsError):
        raise
    except Exception as error:
        known = isinstance(error, (OSError, ValueError)) or type(error).__module__.startswith(CLOUD_PACKAGES)
        if not known or isinstance(error, CuboidError):
            raise
        fault = OutputError if verb == "written" else InputError
        raise fault(f"{what}: cannot be {verb}: {one_line(str(error) or type(error).__name__)}") from error
