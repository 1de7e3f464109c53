"""Whoever is killed, and whenever: the tables are those of a run in which nobody was."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import time
from pathlib import Path

import psutil

from batches import LIMIT_S, call, content, recordings, run, states, surroundings
from cuboid.fleet.batch.claim import claimed
from cuboid.fleet.store.folder import StoreFolder

# More with CUBOID_CHAOS=200.
COUNT = int(os.environ.get("CUBOID_CHAOS", "6"))
FRAMES, FRAME_S = 10, 0.06
CLIENT_KILLS = 1


def workers_of(client: psutil.Process) -> list[psutil.Process]:
    """The processes of a client that track: those with a thread that does."""
    found = []
    for child in client.children(recursive=True):
        try:
            if "spawn_main" in " ".join(child.cmdline()):
                found.append(child)
        except psutil.Error:
            continue
    return found


def harass(process: subprocess.Popen[str], rng: random.Random, seconds: float) -> int:
    """Kill a worker every second, for a time from the first worker on or until the batch is done; how many."""
    client, killed = psutil.Process(process.pid), 0
    while process.poll() is None and not workers_of(client):
        time.sleep(0.1)
    until_s = time.monotonic() + seconds
    while process.poll() is None and time.monotonic() < until_s:
        time.sleep(rng.uniform(0.5, 1.5))
        victims = workers_of(client) if process.poll() is None else []
        if victims:
            rng.choice(victims).kill()
            killed += 1
    return killed


def test_killed_workers_and_clients_lose_nothing_and_double_nothing(tmp_path: Path) -> None:
    source = recordings(tmp_path / "source", COUNT, FRAMES)
    quiet = run("batch", source, "--output", tmp_path / "quiet", "--workers", 2)
    assert quiet.returncode == 0, quiet.stderr
    rng, killed = random.Random(5), 0
    words = call("batch", source, "--output", tmp_path / "chaos", "--workers", 2, "--attempts", 50)
    for attempt in range(CLIENT_KILLS + 1):
        process = subprocess.Popen(
            words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=surroundings(FRAME_S)
        )
        last = attempt == CLIENT_KILLS
        killed += harass(process, rng, 8 if last else rng.uniform(3, 6))
        if not last:
            children = psutil.Process(process.pid).children(recursive=True) if process.poll() is None else []
            process.send_signal(signal.SIGKILL)
            _, alive = psutil.wait_procs(children, timeout=LIMIT_S)
            assert not alive, "workers end when their client is gone"
            process.communicate()
            continue
        try:
            _, said = process.communicate(timeout=LIMIT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            raise
        assert process.returncode == 0, said
    assert killed >= 3
    assert {state for state, _ in states(tmp_path / "chaos").values()} == {"done"}
    assert content(tmp_path / "chaos") == content(tmp_path / "quiet")
    # What a killed task left is hidden, and called partial, until the store is compacted.
    whole = [p for p in tmp_path.glob("chaos/results/*/*/*.*") if not (p.name + p.parent.name).count(".partial")]
    results = sorted(path.relative_to(tmp_path / "chaos") for path in whole)
    assert results == sorted(path.relative_to(tmp_path / "quiet") for path in tmp_path.glob("quiet/results/*/*/*.*"))
    for path in results:
        if path.name in ("objects.json", "tracks.csv", "map.ply"):
            assert (tmp_path / "chaos" / path).read_bytes() == (tmp_path / "quiet" / path).read_bytes()


def test_two_batches_on_one_store_do_all_once(tmp_path: Path) -> None:
    source = recordings(tmp_path / "source", 4, 4)
    words = call("batch", source, "--output", tmp_path / "store", "--workers", 1)
    both = [
        subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=surroundings())
        for _ in range(2)
    ]
    told = [process.communicate(timeout=LIMIT_S) for process in both]
    assert [process.returncode for process in both] == [0, 0], told
    assert sorted(out.split(";")[0] for out, _ in told) == ["4 done", "nothing to do"]
    assert [state for state, _ in states(tmp_path / "store").values()] == ["done"] * 4


def test_a_second_batch_says_that_it_waits(tmp_path: Path) -> None:
    source = recordings(tmp_path / "source", 1, 4)
    words = call("batch", source, "--output", tmp_path / "store", "--workers", 1)
    with claimed(StoreFolder(str(tmp_path / "store")), lambda: None):
        second = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=surroundings())
        assert second.stderr is not None
        line = second.stderr.readline()
        assert line == f"cuboid: {tmp_path / 'store'}: another batch is working on this store; waiting until it ends\n"
    out, _ = second.communicate(timeout=LIMIT_S)
    assert (second.returncode, out.split(";")[0]) == (0, "1 done")
