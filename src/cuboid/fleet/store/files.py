"""The valid files of a store at one moment: each row appears once, also during writes and after killed processes.

A finished recording writes a file into each table, `runs` last: files of a run without a file in `runs` are not valid.
`compact` gathers such parts into larger files and lists these in a manifest with the next number. If two processes
compact at the same time, one creates the manifest and the other removes its own files. A part whose run is in a
gathered file is no longer valid, whether or not it has been removed.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Annotated, Literal

import msgspec
import pyarrow as pa

from cuboid.fleet.store.folder import StoreFolder
from cuboid.fleet.store.schema import DONE, RUNS, TABLES
from cuboid.ground.core.errors import InputError
from cuboid.ground.formats.json_validation import checked

MANIFESTS = "_manifests"
# Maximum number of attempts to read a store that is being compacted.
READ_ATTEMPTS = 5
_PART = re.compile(r"(?P<table>\w+)/(?P<day>day=[\d-]{10})/(?P<key>(?:part|fail)-[0-9a-f]{20})\.parquet")
# A gathered file lies in the folder of a table and day: no other files are opened or removed.
_Gathered = Annotated[str, msgspec.Meta(pattern=r"^\w+/day=[\d-]{10}/gathered-[0-9a-f]{20}\.parquet\Z")]
# The columns that identify runs in a file.
_KEYS = pa.schema([TABLES[RUNS].schema.field(name) for name in ("run", "state")])


class Manifest(msgspec.Struct, frozen=True, kw_only=True):
    """The valid gathered files: names within the store, by table."""

    format: Literal["cuboid-store"] = "cuboid-store"
    version: Literal[1] = 1
    files: dict[str, list[_Gathered]] = {}


@dataclass(frozen=True, slots=True)
class Part:
    """The rows of a run in the tables.

    Attributes
    ----------
    key : str
        ``part-`` and the run if it is done, ``fail-`` and the run if it failed; a failed run has only its row in
        `runs`.
    day : str
        Folder of the day within a table.
    """

    key: str
    day: str

    def names(self) -> dict[str, str]:
        """Return the file names of the part, by table."""
        tables = TABLES if self.key.startswith("part-") else (RUNS,)
        return {table: name_of(table, self.day, self.key) for table in tables}


@dataclass(frozen=True, slots=True)
class StoreFiles:
    """The valid files of a store at one moment.

    Attributes
    ----------
    number : int
        Number of the manifest; 0 if nothing was gathered yet.
    gathered : dict of str to list of str
        Gathered files by table.
    parts : tuple of Part
        Parts that are not gathered yet, sorted.
    leftovers : tuple of Part
        Parts that are gathered, but not yet removed.
    keys : frozenset of str
        Keys of all runs, as `Part.key`, if they were requested.
    """

    number: int
    gathered: dict[str, list[str]]
    parts: tuple[Part, ...]
    leftovers: tuple[Part, ...]
    keys: frozenset[str] = field(repr=False)

    @property
    def empty(self) -> bool:
        """Whether there is no run."""
        return not self.files(RUNS)

    def files(self, table: str) -> list[str]:
        """Return the names of the files of a table."""
        return [*self.gathered.get(table, ()), *(part.names()[table] for part in self.parts if table in part.names())]


def name_of(table: str, day: str, key: str) -> str:
    """Return the name of a file of a table."""
    return f"{table}/{day}/{key}.parquet"


def key_of(run: str, state: str) -> str:
    """Return the key of a run."""
    return f"{'part' if state == DONE else 'fail'}-{run}"


def store_files(place: StoreFolder, *, every_key: bool = False) -> StoreFiles:
    """Return the valid files of a store; none if there is no store yet.

    Parameters
    ----------
    place : StoreFolder
    every_key : bool
        Whether to fill `keys`, which requires reading the gathered files.

    Raises
    ------
    InputError
        The store cannot be read, or it is of another version.
    """
    for _ in range(READ_ATTEMPTS):
        try:
            return _files_now(place, every_key)
        except FileNotFoundError as error:  # gathered into another file meanwhile
            missing = error
    raise InputError(f"{place.url}: is damaged: {missing}") from None


def _files_now(place: StoreFolder, every_key: bool) -> StoreFiles:
    found = [match for name in place.names(RUNS) if (match := _PART.fullmatch(name))]  # before the manifest is read
    parts = sorted((Part(match["key"], match["day"]) for match in found), key=lambda part: (part.day, part.key))
    number, manifest = _newest(place)
    gathered: set[str] = set()
    for name in manifest.files.get(RUNS, ()) if parts or every_key else ():
        rows = place.read_table(name, _KEYS)
        pairs = zip(rows["run"].to_pylist(), rows["state"].to_pylist(), strict=True)
        gathered.update(key_of(run, state) for run, state in pairs)
    fresh = tuple(part for part in parts if part.key not in gathered)
    left = tuple(part for part in parts if part.key in gathered)
    return StoreFiles(number, manifest.files, fresh, left, frozenset(gathered | {part.key for part in fresh}))


def manifest_name(number: int) -> str:
    """Return the name of a manifest."""
    return f"{MANIFESTS}/{number:09d}.json"


def manifests(place: StoreFolder) -> list[int]:
    """Return the numbers of all manifests, ascending."""
    stems = (PurePosixPath(name).stem for name in place.names(MANIFESTS))
    return sorted(int(stem) for stem in stems if stem.isdecimal())


def _newest(place: StoreFolder) -> tuple[int, Manifest]:
    """Return the newest manifest and its number; raise FileNotFoundError if it was replaced meanwhile."""
    numbers = manifests(place)
    if not numbers:
        return 0, Manifest()
    name = manifest_name(numbers[-1])
    return numbers[-1], checked(Path(place.path(name)), place.read(name), Manifest)
