"""Paths of files in archives or at URLs, without unpacking or downloading everything.

`located` makes such a path from the user's argument. It supports the operations of a folder's path (joining, listing,
opening for reading); each operation is passed to the store that contains the file: an archive (`archives`), or a server
(`transports`).
"""

from __future__ import annotations

import errno
import os
import re
import shutil
import stat
from collections import OrderedDict
from collections.abc import Iterator
from pathlib import Path, PurePath
from typing import Any, BinaryIO

from cuboid.ground.core.paths import PathLike
from cuboid.ground.formats import cache
from cuboid.ground.formats.stores import FileStore

URL = re.compile(r"([a-z][a-z0-9+.-]+):/+(?=[^/])")
# Scheme, and host or bucket.
SERVER_PARTS = 2
# Archives by the ending of their names; .r3d is what the app Record3D makes.
ZIP_ENDINGS, TAR_ENDINGS = (".zip", ".r3d"), (".tar",)
ARCHIVE_ENDINGS = ZIP_ENDINGS + TAR_ENDINGS
# Archives without random access.
PACKED_ENDINGS = (".tar.gz", ".tgz", ".tar.bz2", ".tar.xz", ".tar.zst", ".7z", ".rar")


# Bytes that are copied at a time.
COPY_BYTES = 1 << 20
# Number of archives and servers that stay open; others are opened again on request.
STORES_OPEN = 16
_stores: OrderedDict[str, FileStore] = OrderedDict()


class StoredPath(type(Path())):  # type: ignore[misc]
    """A path in an archive or behind a URL.

    A path outside of all stores, such as an archive's neighbour, is a path of the file system.
    """

    def __str__(self) -> str:
        return URL.sub(r"\1://", super().__str__(), count=1)

    @property
    def parent(self) -> StoredPath:
        """The folder that holds this; of a server itself."""
        is_server = len(self.parts) == SERVER_PARTS and URL.match(PurePath.__str__(self))
        return self if is_server else super().parent

    @property
    def suffix(self) -> str:
        """The ending of the name; of a URL without its query."""
        if URL.match(PurePath.__str__(self)):
            return PurePath(self.name.partition("?")[0]).suffix
        return str(super().suffix)

    def _store(self) -> FileStore | None:
        return next((store for one in (self, *self.parents) if (store := _store_at(one)) is not None), None)

    def outside(self) -> BinaryIO:
        """Open an archive itself as a file."""
        store = self.parent._store()
        return open(PurePath.__str__(self), "rb") if store is None else store.open(self)

    def stat(self, *, follow_symlinks: bool = True) -> os.stat_result:
        """Return mode and size; all else is 0."""
        store = self._store()
        if store is None:
            return os.stat(PurePath.__str__(self), follow_symlinks=follow_symlinks)
        found = store.entry(self)
        kind = stat.S_IFDIR if found.is_folder else stat.S_IFREG
        return os.stat_result((kind | 0o444, 0, 0, 1, 0, 0, found.size, 0, 0, 0))

    def _is(self, *kinds: int) -> bool:
        try:
            return stat.S_IFMT(self.stat().st_mode) in kinds
        except (FileNotFoundError, NotADirectoryError):
            return False

    def exists(self, *, follow_symlinks: bool = True) -> bool:
        """Tell whether the path exists."""
        return self._is(stat.S_IFREG, stat.S_IFDIR)

    def is_file(self, *, follow_symlinks: bool = True) -> bool:
        """Tell whether it is a file."""
        return self._is(stat.S_IFREG)

    def is_dir(self, *, follow_symlinks: bool = True) -> bool:
        """Tell whether it is a folder."""
        return self._is(stat.S_IFDIR)

    def names(self) -> list[str]:
        """Return the names in a folder, in no order."""
        store = self._store()
        return os.listdir(PurePath.__str__(self)) if store is None else store.names(self)

    def iterdir(self) -> Iterator[StoredPath]:
        """Iterate over what is in a folder."""
        return (self / name for name in self.names())

    def open(self, mode: str = "r", *args: Any, **more: Any) -> Any:
        """Open for reading, as bytes."""
        if mode != "rb":
            raise OSError(errno.EROFS, "can only be read, as bytes", str(self))
        store = self._store()
        return open(PurePath.__str__(self), mode) if store is None else store.open(self)


def _store_at(path: StoredPath) -> FileStore | None:
    """Return the store whose root is this path, or None."""
    key = PurePath.__str__(path)
    if key in _stores:
        _stores.move_to_end(key)
    elif path.suffix.lower() in ARCHIVE_ENDINGS and _is_file_outside(path):
        _enter(path)
    elif URL.match(key) and len(path.parts) == SERVER_PARTS:
        from cuboid.ground.formats.transports import ServerStore

        _keep(key, ServerStore(path.parts[0].rstrip(":"), str(path)))
    return _stores.get(key)


def _is_file_outside(path: StoredPath) -> bool:
    store = path.parent._store()
    try:
        return os.path.isfile(PurePath.__str__(path)) if store is None else not store.entry(path).is_folder
    except (FileNotFoundError, NotADirectoryError):
        return False


def _keep(key: str, store: FileStore) -> None:
    _stores[key] = store
    if len(_stores) > STORES_OPEN:
        _stores.popitem(last=False)


def located(path: PathLike) -> Path:
    """Return the path for a user's argument: a file, a folder, an archive (as a folder), a path in one, or a URL.

    Raises
    ------
    OSError
        An archive cannot be read, or there is nothing that reads such URLs; `strerror` says why.
    """
    text = os.fspath(path)
    if isinstance(path, StoredPath):
        return path
    # a link is not resolved: its neighbours are those of the link
    whole: Path = StoredPath(text) if URL.match(text) else Path(os.path.abspath(text))
    if isinstance(whole, StoredPath):
        _stores.pop(PurePath.__str__(StoredPath(*whole.parts[:SERVER_PARTS])), None)  # it may have changed
    if whole.name.partition("?")[0].lower().endswith(PACKED_ENDINGS):
        raise OSError(errno.EINVAL, "it is packed as a whole; .zip and .tar are read without being unpacked", text)
    for part in (*reversed(whole.parents), whole):
        if part.suffix.lower() in ARCHIVE_ENDINGS:
            _stores.pop(PurePath.__str__(part), None)  # it may have changed
            if _store_at(StoredPath(part)) is not None:
                whole = StoredPath(whole)
    return whole


def is_there(path: PathLike) -> bool:
    """Tell whether a path from a user or a result exists and can be read."""
    try:
        return located(path).exists()
    except OSError:
        return False


def _enter(archive: StoredPath) -> None:
    """Open an archive as a folder."""
    from cuboid.ground.formats.archives import TarStore, ZipStore

    kind = ZipStore if archive.suffix.lower() in ZIP_ENDINGS else TarStore
    _keep(PurePath.__str__(archive), kind(archive, archive.outside()))


def local_file(path: Path) -> Path:
    """Return a local path with the contents of a file; files in a store are copied.

    Raises
    ------
    OSError
        It cannot be read, or is larger than the cache may be.
    """
    if not isinstance(path, StoredPath):
        return path
    with path.open("rb") as source:
        if isinstance(name := getattr(source, "name", None), str | Path):  # already a file in the cache
            return Path(name)
        return cache.CACHE.file(path, path.stat().st_size, lambda file: shutil.copyfileobj(source, file, COPY_BYTES))
