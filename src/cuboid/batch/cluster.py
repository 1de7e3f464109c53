"""The workers: a cluster on this machine, or a scheduler that exists. Queue, retries and deaths are Dask's."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import dask
from distributed import Client, LocalCluster, Nanny, Status

from cuboid import __version__
from cuboid.core.errors import InputError
from cuboid.core.threads import POOLS, cores

# A recording of 640x480 takes 0.4 GB; a bag that is kept open, and a long map, a few times that.
MEMORY_LIMIT = "4GiB"

# A recording that killed its worker so often is set aside.
ATTEMPTS = 3

# A task that fails by chance, as a network does, is tried this many times more.
RETRIES = 2

# A worker whose process is killed while it starts is started so often.
STARTS = 20

CONNECT_S = 20


@dataclass(frozen=True, slots=True)
class Workers:
    """Who does the work.

    Attributes
    ----------
    scheduler : str or None
        Address of one that exists; None makes workers on this machine.
    count : int or None
        Workers on this machine; None: one a core.
    memory_limit : str
        Of a worker on this machine, and so of a task: one that takes more is killed.
    attempts : int
        Workers on this machine that a recording may kill.
    """

    scheduler: str | None = None
    count: int | None = None
    memory_limit: str = MEMORY_LIMIT
    attempts: int = ATTEMPTS

    @contextmanager
    def connected(self) -> Iterator[Client]:
        """Give a client of the scheduler.

        Raises
        ------
        InputError
            Nobody answers at the address, or its workers have another version.
        """
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
                scheduler_sync_interval="1 minute",  # what a display in a notebook would ask for each second
                silence_logs=logging.CRITICAL,
            )
        except (RuntimeError, OSError) as error:  # no port, no process, no place for the workers' files
            raise InputError(f"workers cannot be started: {error.__cause__ or error}") from error

    def _settings(self) -> dict[str, object]:
        """Return Dask's settings: a worker has one core and one task, keeps no data, and dies with too much memory."""
        return {
            "distributed.scheduler.allowed-failures": self.attempts - 1,
            "distributed.scheduler.worker-saturation": 1.0,
            "distributed.worker.memory.target": False,
            "distributed.worker.memory.spill": False,
            "distributed.worker.memory.pause": False,
            "distributed.worker.memory.terminate": 0.95,
            # Dask does this many times a second beside the work; tasks here take seconds and pass nothing on.
            "distributed.worker.profile.enabled": False,
            "distributed.worker.memory.monitor-interval": "250ms",
            "distributed.admin.tick.interval": "500ms",
            "distributed.admin.system-monitor.interval": "5s",
            "distributed.scheduler.active-memory-manager.start": False,
            "distributed.scheduler.work-stealing-interval": "1s",
            # A worker that is gone for long is being started again, by its nanny; Dask would give both up after 15 s.
            "distributed.deploy.lost-worker-timeout": "1000 days",
            "distributed.nanny.pre-spawn-environ": {**dict.fromkeys(POOLS, "1"), "MALLOC_TRIM_THRESHOLD_": "65536"},
        }


class RetryingNanny(Nanny):
    """A nanny that retries: it starts a worker again where it is killed, also before it is up."""

    async def instantiate(self) -> Status:
        """Start the worker's process."""
        for _ in range(STARTS - 1):
            if (status := await super().instantiate()) == Status.running:
                return status
        return await super().instantiate()


def _refuse_other_versions(client: Client) -> None:
    others = {version for version in client.run(_version).values() if version != __version__}
    if others:
        raise InputError(f"the workers have version {', '.join(sorted(others))} of cuboid, and this is {__version__}")


def _version() -> str:
    return __version__
