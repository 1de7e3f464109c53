"""A batch: what is done, what is not, and why."""

from __future__ import annotations

import json
import os
import shutil
import signal
import time
from pathlib import Path

import dask
import pytest

from batches import paint, recordings, run, settings_of, states, surroundings
from cuboid.cli import main
from cuboid.fleet.batch import cluster
from cuboid.fleet.batch.batch import Order, carry_out, plan
from cuboid.fleet.batch.cluster import Workers
from cuboid.fleet.batch.sources import BatchSource
from cuboid.fleet.batch.task import Ended
from cuboid.fleet.store.query import Tables
from cuboid.ground.core.errors import InputError


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten recordings of which six are broken, each in a way of its own."""
    folder = recordings(tmp_path_factory.mktemp("source"), 10)
    (folder / "rec-00" / "camera.json").unlink()
    for file in (folder / "rec-01" / "color").iterdir():
        file.write_bytes(b"\x89PNG")
    shutil.rmtree(folder / "rec-02" / "depth")
    (folder / "rec-03" / "poses.txt").write_text("what is this\n")
    paint(folder / "rec-04", 255)  # kills its worker
    paint(folder / "rec-05", 254)  # a fault of the program
    return folder


@pytest.fixture(scope="module")
def store(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("store") / "store"
    planned = run("batch", source, "--output", folder, "--workers", 2, "--dry-run")
    assert "10 to do, 0 done, 0 failed before" in planned.stdout, planned.stderr
    assert not folder.exists()
    done = run("batch", source, "--output", folder, "--workers", 2)
    assert done.returncode == 3, done.stderr
    assert "4 done, 5 failed, 1 set aside" in done.stdout, done.stderr + done.stdout
    assert "Traceback" not in done.stderr
    return folder


def test_what_is_broken_is_in_runs_with_its_reason_and_the_rest_is_done(store: Path) -> None:
    found = states(store)
    assert {name for name, (state, _) in found.items() if state == "done"} == {f"rec-{k:02d}" for k in range(6, 10)}
    reasons = {name: reason for name, (_, reason) in found.items() if reason is not None}
    assert all(reason.isprintable() and len(reason) < 300 for reason in reasons.values())
    assert "camera" in reasons["rec-00"]
    assert "none of its 6 frames can be used" in reasons["rec-01"]
    assert "rec-02" in reasons["rec-02"]
    assert "poses.txt" in reasons["rec-03"]
    assert found["rec-04"] == ("set aside", "killed its worker 3 times: too much memory, or a crash")
    assert found["rec-05"] == ("failed", "a fault of the program: ZeroDivisionError: a fault of ours")
    page = (store / "index.html").read_text()
    assert "killed its worker 3 times" in page
    assert "rec-06" in page


def test_what_is_done_is_not_done_again_and_what_changed_is(store: Path, source: Path, tmp_path: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in store.glob("results/*/*/*")}
    again = run("batch", source, "--output", store, "--workers", 1)
    assert again.stdout.startswith("nothing to do; 4 done before"), again.stderr
    assert {path: path.stat().st_mtime_ns for path in store.glob("results/*/*/*")} == before
    shutil.copytree(store, tmp_path / "store")
    shutil.copytree(source, tmp_path / "source")  # a copy is another recording
    other = run("batch", tmp_path / "source", "--output", tmp_path / "store", "--workers", 1, "--limit", 3, "--dry-run")
    assert "10 to do, 0 done" in other.stdout


def test_json_says_what_would_be_done_and_what_was_done(store: Path, source: Path) -> None:
    words = ("batch", source, "--output", store, "--workers", 1, "--json")
    before = {"done_before": 4, "failed_before": 6, "not_listed": []}
    assert json.loads(run(*words, "--dry-run").stdout) == {"to_do": [], **before}
    done = json.loads(run(*words).stdout)
    assert {name: done[name] for name in before} == before
    assert (done["store"], done["done"], done["failed"], done["set_aside"]) == (str(store), 0, 0, 0)


def test_workers_without_memory_for_anything_are_told_in_a_line(
    source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cluster, "STARTS", 1)
    words = ("batch", source, "--output", tmp_path / "store", "--workers", 1, "--memory-limit", "100MiB")
    assert main([*map(str, words)]) == 2
    _, err = capfd.readouterr()
    assert "too little memory (--memory-limit)" in err.splitlines()[-1]
    assert "Traceback" not in err
    assert not (tmp_path / "store").exists()


def test_a_batch_ends_when_no_worker_can_be_started(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    no_worker = tmp_path / "no worker"
    for name, value in surroundings().items():
        monkeypatch.setenv(name, value)
    monkeypatch.setenv("CUBOID_TEST_NO_WORKER", str(no_worker))
    monkeypatch.setattr(cluster, "STARTS", 2)
    settings = {"distributed.worker.preload": ["dying_workers"]}

    def last_task() -> None:
        no_worker.touch()
        os._exit(1)

    ends = pytest.raises(InputError, match=r"no worker can be started.*--memory-limit")
    with dask.config.set(settings), ends, Workers(count=1).connected() as client:
        client.submit(last_task).result()


def test_the_tables_say_what_the_folders_say(store: Path) -> None:
    tables = Tables(str(store))
    (one,) = tables.rows("select * from runs where recording = 'rec-07'")
    assert (one["frames_read"], one["frames_used"], one["objects"], one["sightings"]) == (6, 6, 1, 5)
    assert (store / one["results"] / "report.html").is_file()
    (thing,) = tables.rows("select * from objects where recording = 'rec-07'")
    assert [round(thing[side], 3) for side in ("longest_m", "middle_m", "shortest_m")] == [0.3, 0.2, 0.1]
    assert thing["merged_labels"] == [3, 4]
    assert thing["picture"].startswith(b"\xff\xd8")
    assert tables.rows("select distinct day::text as day from sightings") == [{"day": "2023-11-14"}]
    assert list(store.glob("*/day=*/part-*")) == [], "a batch gathers its parts"


def test_a_result_that_dies_with_its_worker_is_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = recordings(tmp_path / "source", 2)
    sources = [BatchSource(path.name, str(path)) for path in sorted(folder.iterdir())]
    store = str(tmp_path / "store")
    order = Order(store, settings_of(folder))
    for name, value in surroundings().items():
        monkeypatch.setenv(name, value)
    ended: list[str] = []
    with dask.config.set({"distributed.worker.preload": ["quick_workers"]}), Workers(count=1).connected() as client:
        planned = plan(client, sources, order)

        def kill_the_worker(one: Ended) -> None:
            """Kill the worker that has the result of the other recording, and wait until the client knows."""
            ended.append(one.state)
            if len(ended) > 1:
                return
            (key,) = {f"track-{task.head.run}" for task in planned.tasks} - {f"track-{one.head.run}"}
            other = client.futures[key]
            while other.status != "finished":
                time.sleep(0.01)
            for pid in client.run(os.getpid).values():
                os.kill(pid, signal.SIGKILL)
            while other.status == "finished":
                time.sleep(0.01)

        carry_out(client, planned, order, kill_the_worker)
    assert ended == ["done", "done"]
    assert {state for state, _ in states(store).values()} == {"done"}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("nowhere", "--output", "STORE"), "nowhere does not exist"),
        (("SOURCE", "--output", "what://ever"), "what://ever: cannot be opened"),
        (("SOURCE", "--output", "STORE", "--scheduler", "tcp://127.0.0.1:9"), "no scheduler answers"),
        (("SOURCE", "--output", "STORE", "--memory-limit", "much"), "expected a size such as 4GiB"),
        (("SOURCE", "--output", "STORE", "--set", "voxels=3"), "unknown setting 'voxels'"),
    ],
)
def test_a_wrong_call_is_one_line(
    words: tuple[str, ...],
    said: str,
    source: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(cluster, "CONNECT_S", 0.5)
    named = {"SOURCE": source, "STORE": tmp_path / "store"}
    assert main(["batch", *(str(named.get(word, word)) for word in words)]) == 2
    _, err = capsys.readouterr()
    assert said in err
    assert err.count("\n") == 1
