"""A batch on a scheduler that exists: Dask's own command lines, in processes of their own."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from batches import LIMIT_S, content, paint, recordings, run, states, surroundings


@contextmanager
def dask(*words: object) -> Iterator[subprocess.Popen[bytes]]:
    """One of Dask's commands, which is ended at the end, with what it started."""
    environment = surroundings() | {
        "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "2",
        "DASK_DISTRIBUTED__SCHEDULER__WORKER_SATURATION": "1.0",
    }
    command = [sys.executable, "-m", "dask", *map(str, words)]
    quiet = subprocess.DEVNULL
    with subprocess.Popen(command, env=environment, stdout=quiet, stderr=quiet) as process:
        try:
            yield process
        finally:
            process.terminate()
            process.wait(LIMIT_S)


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Of a scheduler with two workers."""
    folder = tmp_path_factory.mktemp("dask")
    file = folder / "scheduler.json"
    here = ("--host", "127.0.0.1", "--scheduler-file", file)
    worker = ("worker", "--scheduler-file", file, "--nworkers", 2, "--nthreads", 1, "--memory-limit", "2GiB")
    with dask("scheduler", *here, "--port", 0, "--no-dashboard") as scheduler:
        until = time.monotonic() + LIMIT_S
        while not file.is_file():
            assert scheduler.poll() is None, "the scheduler ended"
            assert time.monotonic() < until, "no scheduler came up"
            time.sleep(0.1)
        with dask(*worker, "--no-dashboard", "--local-directory", folder):
            yield json.loads(file.read_text())["address"]


def test_it_gives_what_workers_of_its_own_give_and_sets_aside_what_kills(address: str, tmp_path: Path) -> None:
    source = recordings(tmp_path / "source", 3)
    paint(source / "rec-01", 255)  # kills its worker
    store = tmp_path / "store"
    done = run("batch", source, "--output", store, "--scheduler", address)
    assert done.returncode == 3, done.stderr
    assert "2 done, 1 set aside" in done.stdout, done.stdout + done.stderr
    assert states(store)["rec-01"] == ("set aside", "killed its worker 3 times: too much memory, or a crash")
    again = run("batch", source, "--output", store, "--scheduler", address, "--limit", 3, "--dry-run")
    assert "3 to do" in again.stdout, again.stderr
    own = tmp_path / "own"
    assert run("batch", source, "--output", own, "--workers", 1).returncode == 3
    assert content(store) == content(own)
