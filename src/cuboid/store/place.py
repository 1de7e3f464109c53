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

from cuboid.errors import InputError, OutputError
from cuboid.outputs.pending import PendingFile

# Whose errors are refusals of an object store.
CLOUD_PACKAGES = ("botocore", "aiobotocore", "gcsfs", "azure", "aiohttp")
# The folder of a store that holds the result folders.
RESULTS = "results"


class Place:
    """A folder that is written file by file.

    Parameters
    ----------
    url : str
        A path, or a URL of fsspec such as ``s3://bucket/store``.

    Raises
    ------
    InputError
        Nobody knows this kind of URL, or a package for it is missing.
    """

    def __init__(self, url: str) -> None:
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
        except (ImportError, ValueError) as error:
            raise InputError(f"{self.url}: cannot be opened: {error}") from None

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

    def names(self, folder: str) -> list[str]:
        """Return all files below a folder, relative to the store, sorted; none where there is no such folder."""
        start = len(self.path(""))
        with _refusals(self.url, "read"):
            try:
                found = self.fs.find(self.path(folder))
            except FileNotFoundError:
                return []
        return sorted(str(name)[start:] for name in found if not Path(str(name)).name.startswith("."))

    def read(self, name: str) -> bytes:
        """Return what a file holds; FileNotFoundError where there is none."""
        with _refusals(f"{self.url}/{name}", "read"):
            return bytes(self.fs.cat_file(self.path(name)))

    def put(self, name: str, content: bytes) -> None:
        """Write a file that appears, or replaces the one that is there, when it is whole.

        Raises
        ------
        OutputError
            It cannot be written.
        """
        if self.local is None:
            with _refusals(f"{self.url}/{name}", "written"):
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
            with _refusals(f"{self.url}/{name}", "written"):
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
        """Write a table as a file of Parquet, in groups of so many rows."""
        content = io.BytesIO()
        pq.write_table(table, content, compression="zstd", row_group_size=group_rows)
        self.put(name, content.getvalue())

    def read_table(self, name: str, columns: list[str] | None = None) -> pa.Table:
        """Return the table in a file of Parquet; FileNotFoundError where there is none."""
        return pq.read_table(io.BytesIO(self.read(name)), columns=columns, partitioning=None)

    def put_folder(self, folder: Path, name: str, last: str) -> None:
        """Copy the files of a local folder, the one that makes them whole last."""
        for file in sorted(folder.iterdir(), key=lambda file: (file.name == last, file.name)):
            self.put(f"{name}/{file.name}", file.read_bytes())


def is_remote(url: str) -> bool:
    """Tell whether a path is a URL of another place than this machine."""
    return "://" in url and not url.startswith("file://")


@contextmanager
def _refusals(what: str, verb: str) -> Iterator[None]:
    """Turn what a file system refuses into one line; FileNotFoundError and FileExistsError pass."""
    try:
        yield
    except (FileNotFoundError, FileExistsError):
        raise
    except Exception as error:
        if not isinstance(error, OSError) and not type(error).__module__.startswith(CLOUD_PACKAGES):
            raise
        fault = InputError if verb == "read" else OutputError
        raise fault(f"{what}: cannot be {verb}: {error}") from error
