"""Expansion of the user's arguments (folders, globs, lists, URLs) to recordings."""

from __future__ import annotations

import glob
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import fsspec

from cuboid.fleet.store.folder import is_remote, refusals
from cuboid.ground.core.errors import InputError, one_line
from cuboid.ground.formats.reading import real_path
from cuboid.ground.formats.stored import ARCHIVE_ENDINGS, located
from cuboid.inputs.readers import READERS
from cuboid.inputs.readers.locate import FOLDER_LEVELS

WILD = frozenset("*?[")
LIST_ENDINGS = (".txt", ".list")


@dataclass(frozen=True, slots=True, order=True)
class BatchSource:
    """A recording, or an entry that should be one.

    Attributes
    ----------
    name : str
        Name for users: the path below the argument.
    url : str
        Absolute path, or URL.
    """

    name: str
    url: str


def expand(words: Iterable[str]) -> list[BatchSource]:
    """Return the recordings that the arguments stand for, each once, sorted by name.

    A folder that is not a recording stands for the recordings in it, up to two folders deeper. Each of its entries
    without a recording is a source as well, so that a broken one is reported. A folder without any recording is a
    source too if there are other arguments, as from the shell's ``recordings/*``. Each folder, and each file of a kind
    that may be a recording, that matches a glob is a recording; so is each line of a list file (`.txt`), and each URL.

    Parameters
    ----------
    words : iterable of str

    Raises
    ------
    InputError
        An argument names nothing, the only argument is a folder without recordings, or two recordings have one name.
    """
    words = list(words)
    found = {source.url: source for word in words for source in _expand(word, alone=len(words) == 1)}
    by_name: dict[str, BatchSource] = {}
    for source in sorted(found.values()):
        other = by_name.setdefault(source.name, source)
        if other != source:
            raise InputError(
                f"{other.url} and {source.url} are both called '{source.name}'; name the folder that holds both"
            )
    return list(by_name.values())


def _expand(word: str, *, alone: bool) -> list[BatchSource]:
    if is_remote(word):
        return _remote(word)
    if word.endswith(LIST_ENDINGS) and os.path.isfile(word):
        return _listed(Path(word))
    path = os.path.abspath(word.removeprefix("file://"))
    if not os.path.exists(path):
        if not WILD & set(path):
            raise InputError(f"{word} does not exist")
        matches = sorted(glob.glob(path, recursive=True))
        return _beneath(_fixed(path), [one for one in matches if os.path.isdir(one) or _may_be_recording(one)], word)
    if not os.path.isdir(path) or _recognised(path):
        return [BatchSource(os.path.basename(path), path)]
    if not alone and not _deeper(path, FOLDER_LEVELS):
        return [BatchSource(os.path.basename(path), path)]
    start = path if alone else os.path.dirname(path)
    return [BatchSource(os.path.relpath(one, start), one) for one in _inside(path)]


def _inside(folder: str) -> list[str]:
    """Return the recordings in a folder; an entry without any recording is returned itself."""
    entries = [entry for entry in sorted(os.scandir(folder), key=lambda entry: entry.name) if _counts(entry)]
    if not entries:
        raise InputError(f"{folder} holds no recordings")
    return [one for entry in entries for one in (_deeper(entry.path, FOLDER_LEVELS - 1) or [entry.path])]


def _deeper(path: str, levels: int) -> list[str]:
    if _recognised(path):
        return [path]
    if levels == 0 or not os.path.isdir(path):
        return []
    entries = sorted(entry.path for entry in os.scandir(path) if _counts(entry))
    return [one for entry in entries for one in _deeper(entry, levels - 1)]


def _counts(entry: os.DirEntry[str]) -> bool:
    """Tell whether an entry of a folder may be a recording: a folder, or a file of a kind that may be one."""
    return not entry.name.startswith(".") and (entry.is_dir() or _may_be_recording(entry.name))


def _may_be_recording(name: str) -> bool:
    """Tell whether a file with this name is of a kind that may be a recording."""
    return name.endswith((*ARCHIVE_ENDINGS, *(ending for _, reader in READERS.items() for ending in reader.files)))


def _recognised(path: str) -> bool:
    try:
        return any(reader.recognises(located(path)) for _, reader in READERS.items())
    except (InputError, OSError):  # unreadable: opening it later reports the reason
        return False


def _listed(path: Path) -> list[BatchSource]:
    """Return the recordings of a list file, one per line; relative paths start at the list's folder."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read as a list: {error}") from None
    words = [line.strip() for line in lines if line.strip() and not line.lstrip().startswith("#")]
    if not words:
        raise InputError(f"{path}: expected a recording a line, found none")
    urls = [word if is_remote(word) else str(real_path(path.parent / word)) for word in words]
    start = os.path.commonpath(urls) if len(urls) > 1 and not any(map(is_remote, urls)) else ""
    return [BatchSource(os.path.relpath(url, start) if start else _base(url), url) for url in urls]


def _remote(url: str) -> list[BatchSource]:
    if not WILD & set(url):
        return [BatchSource(_base(url), url.rstrip("/"))]
    try:
        with refusals(url, "listed"):
            fs, path = fsspec.core.url_to_fs(url, use_listings_cache=False)
            matches = fs.glob(path, detail=True)
    except (OSError, ImportError, TypeError) as error:
        raise InputError(f"{url}: cannot be listed: {one_line(str(error))}") from None
    found = [name for name, about in sorted(matches.items()) if about["type"] != "file" or _may_be_recording(name)]
    return [
        BatchSource(source.name, str(fs.unstrip_protocol(source.url))) for source in _beneath(_fixed(path), found, url)
    ]


def _beneath(fixed: str, found: list[str], word: str) -> list[BatchSource]:
    if not found:
        raise InputError(f"{word}: no folder and no file of a recording matches")
    return [BatchSource(os.path.relpath(path.rstrip("/"), fixed), path.rstrip("/")) for path in found]


def _fixed(path: str) -> str:
    """Return the folder before the first path part with a wildcard."""
    parts = path.split("/")
    first = next(i for i, part in enumerate(parts) if WILD & set(part))
    return "/".join(parts[:first]) or "/"


def _base(url: str) -> str:
    return url.rstrip("/").rsplit("/", 1)[-1]
