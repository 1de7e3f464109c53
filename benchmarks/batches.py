"""How `cuboid batch` scales: recordings a minute with one worker and with more, and what is not tracking.

python benchmarks/batches.py --work DIR [--recordings 200] [--frames 40] [--size 160 120] [--workers 1 2] [--json]

So many recordings are copies of twenty made ones. Of a worker's time, "tracking" is opening the recording, the run
itself with its files and its page; "tables" is the rest of a task; "waiting" is when it had none (the scheduler, and
the end of the batch).

On a machine that others use the clock tells nothing, and processor times do. "beside" is what workers take outside of
tasks, "gathering" what the client takes to put the store's files together, "dask" what client and scheduler take else,
all as shares of the tasks' time; the first and the last run by the clock, and are larger where the machine is slow.
"of n times one" by the clock is the rate over n times that of one worker; by processor it is what follows where n
workers have n cores and nothing else: one worker's time (its client and scheduler run on another core then) over that
of n workers with client and scheduler among them.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import time
from collections.abc import Callable
from pathlib import Path
from pkgutil import resolve_name
from typing import Any
from unittest.mock import patch

from distributed import Client, Worker, WorkerPlugin

from cuboid.fleet.batch.batch import Order, carry_out, plan
from cuboid.fleet.batch.cluster import Workers
from cuboid.fleet.batch.sources import expand
from cuboid.fleet.store.compact import compact
from cuboid.fleet.store.folder import StoreFolder
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.threads import limit_threads
from scenes import MadeScene, made
from suite import Settings
from tables import dump, show

DISTINCT = 20
TRACKING = (
    "cuboid.inputs.recordings.opening.open_recording",
    "cuboid.runs.pipeline.run.track_recording",
    "cuboid.runs.tracking.saving.write_page",
)
HEADER = (
    "workers",
    "recordings",
    "seconds",
    "a minute",
    "of n times one",
    "the same by cpu",
    "task cpu s",
    "tables % cpu",
    "gathering % cpu",
    "beside % cpu",
    "dask % cpu",
    "waiting %",
)


class Clocks(WorkerPlugin):
    """Lets a worker add up its time in tasks, and within them in tracking."""

    def setup(self, worker: Worker) -> None:
        """Begin, for as long as the worker lives."""
        from cuboid.fleet.batch import task

        self.sums = {"task": [0.0, 0.0], "tracking": [0.0, 0.0]}
        for name in TRACKING:
            patch(name, self._timed("tracking", resolve_name(name))).start()
        patch("cuboid.fleet.batch.task._tracked", self._timed("task", task._tracked)).start()
        worker.cuboid_clocks = self.sums

    def _timed(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*args: Any, **options: Any) -> Any:
            begun_s, cpu_s = time.perf_counter(), time.thread_time()
            try:
                return function(*args, **options)
            finally:
                self.sums[name][0] += time.perf_counter() - begun_s
                self.sums[name][1] += time.thread_time() - cpu_s

        return timed


def sources(work: Path, count: int, frames: int, size: tuple[int, int]) -> Path:
    """Return a folder of so many recordings."""
    folder = work / f"sources-{count}-{frames}-{size[0]}x{size[1]}"
    for k in range(count):
        target = folder / f"rec-{k:04d}"
        if not target.exists():
            case = made(MadeScene("table", 1 + k % DISTINCT, frames, size=size), work)
            shutil.copytree(case.recording, target, copy_function=os.link)
    return folder


def measure(folder: Path, work: Path, workers: int) -> dict[str, Any]:
    """Track all with so many workers; return the times."""
    store = work / f"store-{workers}"
    shutil.rmtree(store, ignore_errors=True)
    settings = Settings("given", 1, 1, None, TrackerConfig()).document()
    order = Order(str(store), settings)
    with Workers(count=workers).connected() as client:
        client.wait_for_workers(workers)
        client.register_plugin(Clocks())
        _warm(client, folder, work, settings)
        before, beside_s = _clocks(client), _workers_cpu_s(client)
        begun_s, dask_s = time.perf_counter(), time.process_time()
        planned = plan(client, expand([str(folder)]), order)
        gathering_s: list[float] = []
        with patch("cuboid.fleet.batch.batch.compact", _timed_compact(gathering_s)):
            carry_out(client, planned, order, lambda one: None)
        seconds = time.perf_counter() - begun_s
        dask_s = time.process_time() - dask_s
        after, beside_s = _clocks(client), _workers_cpu_s(client) - beside_s
    (task_s, task_cpu_s), (tracking_s, tracking_cpu_s) = (
        [after[name][k] - before[name][k] for k in (0, 1)] for name in ("task", "tracking")
    )
    return {
        "workers": workers,
        "recordings": len(planned.tasks),
        "seconds": seconds,
        "per_minute": 60 * len(planned.tasks) / seconds,
        "tables": (task_s - tracking_s) / task_s,
        "tables_cpu": (task_cpu_s - tracking_cpu_s) / task_cpu_s,
        "waiting": 1 - task_s / (workers * seconds),
        "task_cpu_s": task_cpu_s,
        "beside_cpu": (beside_s - task_cpu_s) / task_cpu_s,
        "gathering_cpu": sum(gathering_s) / task_cpu_s,
        "dask_cpu": (dask_s - sum(gathering_s)) / task_cpu_s,
    }


def _timed_compact(seconds: list[float]) -> Callable[[StoreFolder], Any]:
    """Return what gathers files, and notes its processor time, that of the threads it has others start included."""

    def timed(place: StoreFolder) -> Any:
        begun_s = time.process_time()
        try:
            return compact(place)
        finally:
            seconds.append(time.process_time() - begun_s)

    return timed


def _workers_cpu_s(client: Client) -> float:
    """Return what all workers' processes have used."""
    return sum(client.run(time.process_time).values())


def by_processor(one: dict[str, Any], many: dict[str, Any]) -> float:
    """Return the rate of n workers on n cores over n times that of one, as processor times tell it."""
    alone = one["task_cpu_s"] * (1 + one["beside_cpu"]) / one["recordings"]
    summed_counts = (
        many["task_cpu_s"] * (1 + many["beside_cpu"] + many["gathering_cpu"] + many["dask_cpu"]) / many["recordings"]
    )
    return float(alone / summed_counts)


def _warm(client: Client, folder: Path, work: Path, settings: dict[str, Any]) -> None:
    """Let each worker load its kernels, which is no part of what is measured."""
    from cuboid.fleet.batch.task import Task, track

    store = work / "store-warm"
    shutil.rmtree(store, ignore_errors=True)
    (one,) = plan(client, expand([str(folder / "rec-0000")]), Order(str(store), settings)).tasks
    for worker in client.scheduler_info(n_workers=-1)["workers"]:
        task = Task(one.source, one.head, one.settings, str(store) + worker.rsplit(":", 1)[-1], True)
        client.submit(track, task, workers=[worker], pure=False).result()
    for left in work.glob("store-warm*"):
        shutil.rmtree(left)


def _clocks(client: Client) -> dict[str, tuple[float, float]]:
    """Return the sums of all workers."""
    all_sums = client.run(lambda dask_worker: dask_worker.cuboid_clocks).values()
    return {name: tuple(sum(sums[name][k] for sums in all_sums) for k in (0, 1)) for name in ("task", "tracking")}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, required=True, metavar="DIR", help="keeps recordings and stores")
    parser.add_argument("--recordings", type=int, default=200, metavar="N")
    parser.add_argument("--frames", type=int, default=40, metavar="N")
    parser.add_argument("--size", type=int, nargs=2, default=(160, 120), metavar=("W", "H"))
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2], metavar="N")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    limit_threads(1)
    folder = sources(args.work.resolve(), args.recordings, args.frames, tuple(args.size))
    found = [measure(folder, args.work.resolve(), workers) for workers in args.workers]
    if args.json:
        dump(found)
        return 0
    one = found[0]["per_minute"] / found[0]["workers"]
    lines = [
        [
            *(row[name] for name in ("workers", "recordings", "seconds", "per_minute")),
            row["per_minute"] / (one * row["workers"]),
            by_processor(found[0], row),
            row["task_cpu_s"] / row["recordings"],
            *(100 * row[name] for name in ("tables_cpu", "gathering_cpu", "beside_cpu", "dask_cpu", "waiting")),
        ]
        for row in found
    ]
    show(f"Recordings of {args.frames} frames, {args.size[0]} x {args.size[1]}", HEADER, lines)
    return 0


if __name__ == "__main__":
    sys.exit(main())
