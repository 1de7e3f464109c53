"""The identity of a task: the files of its recording, the settings, the version. Equal tasks are done once."""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import fsspec
import msgspec

from cuboid.batch.sources import Source
from cuboid.core.errors import InputError, one_line
from cuboid.store.place import is_remote, refusals
from cuboid.store.rows import RunHead, settings_text

# Names that object stores give to the digest, or else the time, of the contents of a file.
MARKS = ("ETag", "etag", "md5Hash", "content_md5", "generation", "LastModified", "last_modified", "mtime", "updated")


@dataclass(frozen=True, slots=True)
class _File:
    name: str
    size: int
    mark: str
    modified: datetime


def head_of(source: Source, settings: dict[str, Any], version: str) -> RunHead:
    """Return what a task is of; costs a look at each file of the recording, none is opened.

    Raises
    ------
    InputError
        The recording cannot be listed.
    """
    files = sorted(_remote(source.url) if is_remote(source.url) else _local(source.url), key=lambda file: file.name)
    if not files:
        raise InputError(f"{source.url}: does not exist, or holds no file")
    content = [[file.name, file.size, file.mark] for file in files]
    text = settings_text(settings)
    what = msgspec.json.encode([source.url, source.name, content, text, version])
    return RunHead(
        run=hashlib.sha256(what).hexdigest()[:20],
        recording=source.name,
        source=source.url,
        version=version,
        settings=text,
        newest=max(file.modified for file in files),
        size_bytes=sum(file.size for file in files),
    )


def _local(path: str) -> Iterator[_File]:
    try:
        if not os.path.isdir(path):
            yield _stated("", os.stat(path))
            return
        start = len(os.path.join(path, ""))
        for folder, folders, names in os.walk(path):
            folders[:] = [name for name in folders if not name.startswith(".")]
            for name in names:
                if not name.startswith("."):
                    whole = os.path.join(folder, name)
                    yield _stated(whole[start:], os.lstat(whole))
    except OSError as error:
        raise InputError(f"{error.filename or path} cannot be read: {error.strerror}") from None


def _stated(name: str, found: os.stat_result) -> _File:
    size = found.st_size if stat.S_ISREG(found.st_mode) else 0
    return _File(name, size, str(found.st_mtime_ns), datetime.fromtimestamp(found.st_mtime_ns // 1000 / 1e6, UTC))


def _remote(url: str) -> Iterator[_File]:
    try:
        with refusals(url, "listed"):
            fs, path = fsspec.core.url_to_fs(url, use_listings_cache=False)
            found = fs.find(path, detail=True)
    except (OSError, ImportError, TypeError) as error:
        raise InputError(f"{url}: cannot be listed: {one_line(str(error))}") from None
    for name, info in found.items():
        mark = next((str(info[key]) for key in MARKS if info.get(key)), "")
        yield _File(str(name).removeprefix(path), int(info.get("size") or 0), mark, _moment(info))


def _moment(info: dict[str, Any]) -> datetime:
    found = next((info[key] for key in ("LastModified", "last_modified", "mtime", "updated") if info.get(key)), 0)
    if isinstance(found, datetime):
        return found
    if isinstance(found, str):
        return datetime.fromisoformat(found)
    return datetime.fromtimestamp(float(found), UTC)
