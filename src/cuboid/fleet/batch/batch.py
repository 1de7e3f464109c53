"""The loop over recordings: it finds which are done already, and processes the rest with Dask."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from distributed import Client, Future, KilledWorker, as_completed

from cuboid.fleet.batch.cluster import RETRIES
from cuboid.fleet.batch.sources import BatchSource
from cuboid.fleet.batch.task import Ended, Task, give_up, identify, track
from cuboid.fleet.store.compact import compact
from cuboid.fleet.store.files import key_of, store_files
from cuboid.fleet.store.folder import StoreFolder
from cuboid.fleet.store.rows import RunHead
from cuboid.fleet.store.schema import DONE, FAILED, SET_ASIDE
from cuboid.ground.core.errors import CuboidError
from cuboid.ground.version import __version__

# Number of recordings after which the store merges their files: reading so many small files takes one or two seconds.
GATHER_EVERY = 512

# Number of recordings that a worker identifies per task: one task per recording would cost more than the work.
LOOK_AT = 16


@dataclass(frozen=True, slots=True)
class Order:
    """The settings of a batch.

    Attributes
    ----------
    store : str
        URL of the store.
    settings : dict
        ``reading``: options of `cuboid.open_recording`; ``tracker``: its configuration; ``relations``: whether they are
        found; ``text_model``: file of the model that embeds the objects; the others are fields of `TrackOptions`.
    tables_only : bool
    retry : bool
        Whether recordings that failed, or were set aside, are tried again.
    version : str
        Results of another version count as not done.
    """

    store: str
    settings: dict[str, Any]
    tables_only: bool = False
    retry: bool = False
    version: str = __version__


@dataclass(frozen=True, slots=True)
class Plan:
    """The state of a batch at its start.

    Attributes
    ----------
    tasks : tuple of Task
        Recordings to process.
    done : int
        Number of recordings that were done before.
    failed : int
        Number of recordings that failed before, and are not tried again.
    broken : dict of BatchSource to str
        Recordings that cannot be listed, with the reason.
    """

    tasks: tuple[Task, ...]
    done: int
    failed: int
    broken: dict[BatchSource, str] = field(default_factory=dict)


def plan(client: Client, sources: Iterable[BatchSource], order: Order) -> Plan:
    """Return the recordings to process; the workers look at the files.

    Raises
    ------
    InputError
        The store cannot be read.
    distributed.KilledWorker, distributed.CancelledError
        No worker survives a task, or none is left; `Workers.connected` explains them.
    """
    sources = list(sources)
    some = [sources[k : k + LOOK_AT] for k in range(0, len(sources), LOOK_AT)]
    futures = client.map(identify, some, settings=order.settings, version=order.version, pure=False)
    heads = [head for heads in client.gather(futures) for head in heads]
    stored_keys = store_files(StoreFolder(order.store), every_key=True).keys
    tasks: list[Task] = []
    broken: dict[BatchSource, str] = {}
    done = failed = 0
    for source, head in zip(sources, heads, strict=True):
        if isinstance(head, str):
            broken[source] = head
        elif key_of(head.run, DONE) in stored_keys:
            done += 1
        elif key_of(head.run, FAILED) in stored_keys and not order.retry:
            failed += 1
        else:
            tasks.append(Task(source, head, order.settings, order.store, order.tables_only))
    return Plan(tuple(tasks), done, failed, broken)


def carry_out(client: Client, planned: Plan, order: Order, ended: Callable[[Ended], None]) -> None:
    """Process the planned recordings, and gather the files of the store.

    Parameters
    ----------
    client : distributed.Client
    planned : Plan
    order : Order
    ended : callable
        Called with the outcome of each recording when it ends.

    Raises
    ------
    distributed.CancelledError
        The scheduler is gone, or no worker is left; `Workers.connected` explains it.
    OutputError
        The store cannot be written.
    """
    place = StoreFolder(order.store)
    for count, one in enumerate(_results(client, planned, place), start=1):
        ended(one)
        if count % GATHER_EVERY == 0:
            compact(place)
    compact(place)


def _results(client: Client, planned: Plan, place: StoreFolder) -> Iterator[Ended]:
    """Iterate over the outcomes of the recordings."""
    of_key = {f"track-{task.head.run}": task for task in planned.tasks}
    futures = client.map(track, planned.tasks, key=list(of_key), pure=False, retries=RETRIES)
    waiting = as_completed(futures)
    del futures
    for future in waiting:
        yield _result(future, of_key[str(future.key)].head, place)


def _result(future: Future[Ended], head: RunHead, place: StoreFolder) -> Ended:
    """Return the outcome of one recording.

    A result is lost if the worker that holds it dies; Dask then runs the task again, and `Future.result` waits for it.
    """
    try:
        ended: Ended = future.result()
    except Exception as error:
        # The scheduler is lost, or the store cannot be written: neither is a fault of the recording.
        if future.status != "error" or isinstance(error, CuboidError):
            raise
        return give_up(head, place, *_reason(error))
    return ended


def _reason(error: Exception) -> tuple[str, str]:
    """Return state and reason of a recording whose task failed."""
    if isinstance(error, KilledWorker):
        return SET_ASIDE, f"killed its worker {error.allowed_failures + 1} times: too much memory, or a crash"
    return FAILED, f"a fault of the program: {type(error).__name__}: {error}"
