"""The workers: a local cluster, or an existing scheduler. Dask handles the queue, retries and dead workers."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import dask
from distributed import CancelledError, Client, KilledWorker, LocalCluster, Nanny, SchedulerPlugin, Status

from cuboid.ground.core.errors import InputError
from cuboid.ground.core.threads import POOLS, cores
from cuboid.ground.version import __version__

# A recording of 640x480 needs 0.4 GB; an open bag file and a long map need a few times that.
MEMORY_LIMIT = "4GiB"

# Number of killed workers after which a recording is set aside.
MAX_KILLED_WORKERS = 3

# Number of retries of a task after a random failure, for example of the network.
RETRIES = 2

# A worker may be started this many times more than one task may kill it, if no task ends between.
STARTS = 20

CONNECT_S = 20.0

# States of a nanny that starts no worker anymore.
ENDING = (Status.closing, Status.closed, Status.closing_gracefully, Status.failed)

# Dask's setting with the time for a connection.
CONNECT_SETTING = "distributed.comm.timeouts.connect"

# Dask's setting with the largest number of starts of a worker between two ends of tasks.
STARTS_SETTING = "cuboid.worker-starts"

# Module that keeps a local worker from writing to the terminal. Only workers may load it.
SILENT = "cuboid.fleet.batch.silent"


@dataclass(frozen=True, slots=True)
class Workers:
    """The settings of the workers.

    Attributes
    ----------
    scheduler : str or None
        Address of an existing scheduler; None starts workers on this machine.
    count : int or None
        Number of workers on this machine; None: one per core.
    memory_limit : str
        Memory limit of a worker on this machine, and thus of a task: a worker above it is killed.
    attempts : int
        Number of local workers that a recording may kill.
    """

    scheduler: str | None = None
    count: int | None = None
    memory_limit: str = MEMORY_LIMIT
    attempts: int = MAX_KILLED_WORKERS

    @contextmanager
    def connected(self) -> Iterator[Client]:
        """Yield a client of the scheduler.

        Raises
        ------
        InputError
            No scheduler answers at the address, its workers have another version, or, later, no worker survives a
            task or the scheduler is lost. Recordings that are done are in the store.
        """
        try:
            with self._connected() as client:
                yield client
        except KilledWorker:
            raise InputError(
                "the workers were killed: too little memory (--memory-limit), or no room for their files"
            ) from None
        except CancelledError:
            raise InputError(
                "the scheduler was lost, or no worker can be started: too little memory (--memory-limit)? "
                "What is done is in the store, and the same call goes on from there"
            ) from None

    @contextmanager
    def _connected(self) -> Iterator[Client]:
        with dask.config.set(self._settings()):
            if self.scheduler is None:
                with self._local() as cluster, Client(cluster) as client:
                    yield client
                return
            try:
                client = Client(self.scheduler, timeout=CONNECT_S)
            except (OSError, ValueError) as error:
                raise InputError(f"{self.scheduler}: no scheduler answers: {error}") from None
            with client:
                _refuse_other_versions(client)
                yield client

    def _local(self) -> LocalCluster:
        try:
            cluster = LocalCluster(
                n_workers=self.count or cores(),
                worker_class=RetryingNanny,
                threads_per_worker=1,
                memory_limit=self.memory_limit,
                dashboard_address="127.0.0.1:0",
                scheduler_sync_interval="1 minute",  # used by notebook displays, default every second
                silence_logs=logging.CRITICAL,
            )
        except (RuntimeError, OSError) as error:  # no free port, no process, or no space for the workers' files
            raise InputError(f"workers cannot be started: {error.__cause__ or error}") from error
        scheduler = cluster.scheduler
        assert scheduler is not None
        scheduler.add_plugin(_Restarts(cluster))
        return cluster

    def _settings(self) -> dict[str, object]:
        """Return Dask's settings: one core and one task per worker, no stored data, and a hard memory limit."""
        return {
            "distributed.scheduler.allowed-failures": self.attempts - 1,
            "distributed.scheduler.worker-saturation": 1.0,
            "distributed.worker.memory.target": False,
            "distributed.worker.memory.spill": False,
            "distributed.worker.memory.pause": False,
            "distributed.worker.memory.terminate": 0.95,
            # Dask repeats these many times per second; tasks here take seconds and exchange no data.
            "distributed.worker.profile.enabled": False,
            "distributed.worker.memory.monitor-interval": "250ms",
            "distributed.admin.tick.interval": "500ms",
            "distributed.admin.system-monitor.interval": "5s",
            "distributed.scheduler.active-memory-manager.start": False,
            "distributed.scheduler.work-stealing-interval": "1s",
            CONNECT_SETTING: dask.config.get(CONNECT_SETTING),  # restored at the end
            STARTS_SETTING: STARTS + self.attempts,
            # The nanny of a lost worker is restarting it; by default Dask would give up both after 15 s.
            "distributed.deploy.lost-worker-timeout": "1000 days",
            "distributed.worker.preload": [SILENT, *dask.config.get("distributed.worker.preload")],
            "distributed.nanny.pre-spawn-environ": {**dict.fromkeys(POOLS, "1"), "MALLOC_TRIM_THRESHOLD_": "65536"},
        }


class RetryingNanny(Nanny):
    """A nanny that restarts a killed worker, also one that is killed during start-up.

    Dask would begin the next start of such a worker before the last one has ended, and could then wait for ever. After
    too many starts without the end of any task, the nanny ends the scheduler: no client waits for a worker.

    Attributes
    ----------
    starts : int
        Number of starts since a task ended.
    """

    starts = 0
    _starting = False

    async def instantiate(self) -> Status:
        """Start the worker's process."""
        most = dask.config.get(STARTS_SETTING)
        self._starting = True
        try:
            while True:
                self.starts += 1
                status = await super().instantiate()
                if status == Status.running or self.starts >= most or self.status in ENDING:
                    break
        finally:
            self._starting = False
        if self.starts >= most and self.status == Status.running:
            # The end of the cluster looks for the ended scheduler for this time.
            dask.config.set({CONNECT_SETTING: "1s"})
            await self.scheduler.terminate()
        return status

    async def _on_worker_exit(self, exitcode: int) -> None:
        if not self._starting:
            await super()._on_worker_exit(exitcode)


class _Restarts(SchedulerPlugin):
    """Resets the number of starts of all nannies when a task ends."""

    def __init__(self, cluster: LocalCluster) -> None:
        self._cluster = cluster

    def transition(self, key: object, start: str, finish: str, *_: object, **__: object) -> None:
        """Note the end of a task."""
        if finish in ("memory", "erred"):
            for nanny in self._cluster.workers.values():
                nanny.starts = 0


def _refuse_other_versions(client: Client) -> None:
    others = {version for version in client.run(_version).values() if version != __version__}
    if others:
        raise InputError(f"the workers have version {', '.join(sorted(others))} of cuboid, and this is {__version__}")


def _version() -> str:
    return __version__
