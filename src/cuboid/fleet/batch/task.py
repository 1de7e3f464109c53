"""The task of a worker for one recording: identify the run, fetch, track, and write rows and files to the store."""

from __future__ import annotations

import hashlib
import os
import shutil
import stat
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import fsspec
import msgspec

from cuboid.fleet.batch.sources import BatchSource
from cuboid.fleet.store.files import Part, key_of
from cuboid.fleet.store.folder import RESULTS, StoreFolder, is_remote, refusals
from cuboid.fleet.store.rows import ReadAs, RunHead, day_of, failure, recorded, settings_text, tables_of
from cuboid.fleet.store.schema import DONE, FAILED, RUNS, TABLES
from cuboid.ground.core.errors import InputError, MissingExtraError, one_line
from cuboid.ground.formats.folder import RUN

if TYPE_CHECKING:
    import pyarrow as pa

    from cuboid.inputs.readers import Recording
    from cuboid.results.files import Results
    from cuboid.results.views.report.pictures import Picture


# Names in object stores for the digest, or else the modification time, of a file.
MARKS = ("ETag", "etag", "md5Hash", "content_md5", "generation", "LastModified", "last_modified", "mtime", "updated")


@dataclass(frozen=True, slots=True)
class _File:
    name: str
    size: int
    mark: str
    modified: datetime


def head_of(source: BatchSource, settings: dict[str, Any], version: str) -> RunHead:
    """Return the identity of a run; it lists the recording's files without opening them.

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


@dataclass(frozen=True, slots=True)
class Task:
    """A recording to track.

    Attributes
    ----------
    source : BatchSource
    head : RunHead
    settings : dict
        As of `Order`.
    store : str
        URL of the store.
    tables_only : bool
        Whether the result files are left out.
    """

    source: BatchSource
    head: RunHead
    settings: dict[str, Any]
    store: str
    tables_only: bool


@dataclass(frozen=True, slots=True)
class Ended:
    """The outcome of a recording.

    Attributes
    ----------
    head : RunHead
    state : str
        State as in the column of `runs`.
    reason : str or None
    frames, objects : int
    """

    head: RunHead
    state: str
    reason: str | None = None
    frames: int = 0
    objects: int = 0


def identify(sources: list[BatchSource], settings: dict[str, Any], version: str) -> list[RunHead | str]:
    """Return the identity of each source's run, or one line with the reason why it is unknown."""
    return [_identified(source, settings, version) for source in sources]


def _identified(source: BatchSource, settings: dict[str, Any], version: str) -> RunHead | str:
    try:
        return head_of(source, settings, version)
    except InputError as error:
        return str(error)


def track(task: Task) -> Ended:
    """Track a recording and write the complete result, or nothing, into the store.

    A fault of the recording is a result too; random failures (a network, a full disk) are raised, and Dask tries again.
    """
    from cuboid.ground.core.threads import limit_threads

    limit_threads(1)
    place = StoreFolder(task.store)
    with tempfile.TemporaryDirectory(prefix="cuboid-", dir=_scratch()) as scratch, _fetched(task, scratch) as path:
        try:
            return _tracked(task, place, path, Path(scratch) / "out")
        except (InputError, MissingExtraError) as error:
            return give_up(task.head, place, FAILED, _named(str(error), path, task.source))


def give_up(head: RunHead, place: StoreFolder, state: str, reason: str) -> Ended:
    """Write to the store that a recording failed or was set aside, with the reason."""
    reason = one_line(reason)
    part = Part(key_of(head.run, state), day_of(head.newest))
    place.put_table(part.names()[RUNS], failure(head, state, reason), TABLES[RUNS].group_rows)
    return Ended(head, state, reason)


def _tracked(task: Task, place: StoreFolder, path: Path, scratch: Path) -> Ended:
    from cuboid.ground.core.config import TrackerConfig
    from cuboid.results.files import Results
    from cuboid.results.files.pending import new_folder
    from cuboid.results.views.report import pictures_of
    from cuboid.runs.pipeline.opening import open_recording
    from cuboid.runs.pipeline.options import ResultOptions, TrackOptions
    from cuboid.runs.pipeline.run import track_recording
    from cuboid.runs.tracking.saving import write_page

    settings = dict(task.settings)
    recording = open_recording(path, **settings.pop("reading"))
    text_model = settings.pop("text_model", None)
    relations, furniture = settings.pop("relations", False), settings.pop("furniture", True)
    wanted = ResultOptions(force=True, page=False, relations=relations, furniture=furniture)
    options = TrackOptions(config=TrackerConfig.from_dict(settings.pop("tracker")), **settings)
    local = None if task.tables_only else place.local
    folder = scratch if local is None else local / _name(task)
    # An existing folder in the store is complete. Dask may repeat a task that a worker had finished before it died.
    if folder.is_dir():
        results = Results(folder)
        tables = _tables(task, recording, results, pictures_of(results, recording.read), text_model)
    else:
        with new_folder(folder, force=False, replaces="") as working:
            track_recording(recording, working, options, results=wanted)
            results = Results(working)  # shared by page and tables, so that files are read once
            pictures = pictures_of(results, recording.read) if task.tables_only else write_page(results, recording.read)
            tables = _tables(task, recording, results, pictures, text_model)
            _refuse_changed(task)
    if local is None and not task.tables_only:
        place.put_folder(folder, _name(task), last=RUN)
    names = Part(key_of(task.head.run, DONE), day_of(recorded(task.head, results))).names()
    for table in sorted(names, key=lambda table: table == RUNS):  # `runs` last: it marks all as complete
        place.put_table(names[table], tables[table], TABLES[table].group_rows)
    return Ended(task.head, DONE, None, results.report.frames_used, len(results.found.objects))


def _name(task: Task) -> str:
    """Return the folder of the result files in the store."""
    return f"{RESULTS}/{task.head.recording}/{task.head.run}"


def _tables(
    task: Task, recording: Recording, results: Results, pictures: Mapping[int, Picture], text_model: str | None
) -> dict[str, pa.Table]:
    read_as = ReadAs(recording.format, len(recording), recording.intrinsics, recording.has_poses)
    from cuboid.results.views.report import pictures_of
    from cuboid.results.views.report.pictures import last_sightings

    embeddings = None if text_model is None else results.embed(text_model)
    folder = None if task.tables_only else _name(task)
    last = pictures_of(results, recording.read, last_sightings, results.gone)
    return tables_of(task.head, results, read_as, pictures, folder, embeddings, last)


def _refuse_changed(task: Task) -> None:
    """Raise InputError if the recording has changed since the task was made."""
    if head_of(task.source, task.settings, task.head.version).run != task.head.run:
        raise InputError(f"{task.source.url}: changed while it was tracked; the next batch takes it as it is then")


@contextmanager
def _fetched(task: Task, scratch: str) -> Iterator[Path]:
    """Yield the recording as local files."""
    if not is_remote(task.source.url):
        yield Path(task.source.url)
        return
    with refusals(task.source.url, "read"):
        fs, path = fsspec.core.url_to_fs(task.source.url, use_listings_cache=False)
        here = Path(scratch) / "recording" / os.path.basename(path)
        here.parent.mkdir()
        fs.get(path, str(here), recursive=fs.isdir(path))
    try:
        yield here
    finally:
        shutil.rmtree(here.parent, ignore_errors=True)


def _scratch() -> str | None:
    """Return the worker's folder, which Dask removes even if the worker is killed; None outside a worker."""
    from distributed import get_worker

    try:
        return str(get_worker().local_directory)
    except ValueError:  # called outside a worker
        return None


def _named(message: str, path: Path, source: BatchSource) -> str:
    """Return a message with the recording's own name instead of its local copy's."""
    return message.replace(str(path), source.url)
