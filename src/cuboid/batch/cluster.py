"""The workers: a local cluster, or an existing scheduler. Dask handles the queue, retries and dead workers."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import dask
from distributed import CancelledError, Client, KilledWorker, LocalCluster, Nanny, Status

from cuboid import __version__
from cuboid.core.errors import InputError
from cuboid.core.threads import POOLS, cores

# A recording of 640x480 needs 0.4 GB; an open bag file and a long map need a few times that.
MEMORY_LIMIT = "4GiB"

# Number of killed workers after which a recording is set aside.
ATTEMPTS = 3

# Number of retries of a task after a random failure, for example of the network.
RETRIES = 2

# Maximum number of starts of a worker whose process is killed during start-up.
STARTS = 20

CONNECT_S = 20

# Module that keeps a local worker from writing to the terminal. Only workers may load it.
SILENT = "cuboid.batch.silent"

# States of a nanny that starts no worker any more.
ENDING = (Status.closing, Status.closed, Status.closing_gracefully, Status.failed)


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
    attempts: int = ATTEMPTS

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
            return LocalCluster(
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
            # The nanny of a lost worker is restarting it; by default Dask would give up both after 15 s.
            "distributed.deploy.lost-worker-timeout": "1000 days",
            "distributed.worker.preload": [SILENT, *dask.config.get("distributed.worker.preload")],
            "distributed.nanny.pre-spawn-environ": {**dict.fromkeys(POOLS, "1"), "MALLOC_TRIM_THRESHOLD_": "65536"},
        }


class RetryingNanny(Nanny):
    """A nanny that restarts a killed worker, also one that is killed during start-up.

    After `STARTS` failures in a row, it ends the scheduler: without workers, its client would wait for ever.
    """

    async def instantiate(self) -> Status:
        """Start the worker's process."""
        for _ in range(STARTS):
            status = await super().instantiate()
            if status == Status.running or self.status in ENDING:
                return status
        if self.status == Status.running:
            await self.scheduler.terminate()
        return status


def _refuse_other_versions(client: Client) -> None:
    others = {version for version in client.run(_version).values() if version != __version__}
    if others:
        raise InputError(f"the workers have version {', '.join(sorted(others))} of cuboid, and this is {__version__}")


def _version() -> str:
    return __version__
