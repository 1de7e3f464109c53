"""One batch at a time on a store."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import fsspec
import pytest

from cuboid.fleet.batch import claim
from cuboid.fleet.batch.claim import LOCK, claimed
from cuboid.fleet.store.folder import StoreFolder
from cuboid.ground.core.errors import OutputError


@pytest.fixture(params=["folder", "object store"])
def place(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[StoreFolder]:
    monkeypatch.setattr(claim, "LOCK_POLL_S", 0.01)
    monkeypatch.setattr(claim, "RENEW_S", 0.01)
    yield StoreFolder(str(tmp_path / "store") if request.param == "folder" else "memory://fleet/store")
    fsspec.filesystem("memory").store.clear()


def never() -> None:
    raise AssertionError("nobody else holds the store")


def test_a_second_batch_says_that_it_waits_and_goes_on_after_the_first(place: StoreFolder) -> None:
    said, done = threading.Event(), threading.Event()

    def second() -> None:
        with claimed(StoreFolder(place.url), said.set):
            done.set()

    with claimed(place, never):
        thread = threading.Thread(target=second)
        thread.start()
        assert said.wait(20)
        assert not done.wait(0.1)
    assert done.wait(20)
    thread.join()
    with claimed(place, never):
        pass


def test_a_batch_that_did_nothing_leaves_no_folder(tmp_path: Path) -> None:
    with claimed(StoreFolder(str(tmp_path / "store")), never):
        assert (tmp_path / "store" / LOCK).is_file()
    assert list(tmp_path.iterdir()) == []
    with claimed(StoreFolder(str(tmp_path / "store")), never):
        (tmp_path / "store" / "runs").mkdir()
    assert (tmp_path / "store" / "runs").is_dir()


def test_the_lock_of_a_killed_batch_ends(tmp_path: Path) -> None:
    script = (
        "import os, sys; from cuboid.fleet.batch.claim import claimed\n"
        "from cuboid.fleet.store.folder import StoreFolder\n"
        "with claimed(StoreFolder(sys.argv[1]), print): os._exit(9)"
    )
    store = tmp_path / "store"
    assert subprocess.run([sys.executable, "-c", script, str(store)], check=False, timeout=60).returncode == 9
    with claimed(StoreFolder(str(store)), never):
        pass


def test_on_an_object_store_a_lock_that_nobody_renews_expires(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(claim, "LOCK_POLL_S", 0.01)
    monkeypatch.setattr(claim, "EXPIRE_S", 0.05)
    place = StoreFolder("memory://fleet/killed")
    assert place.create(LOCK, b"of a batch that was killed")
    waited: list[int] = []
    with claimed(place, lambda: waited.append(1)):
        assert waited == [1]
        assert place.read(LOCK) != b"of a batch that was killed"
    with pytest.raises(FileNotFoundError):
        place.read(LOCK)


def test_a_store_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    enter: Callable[[], object] = claimed(StoreFolder(str(tmp_path / "file" / "store")), never).__enter__
    with pytest.raises(OutputError, match="cannot be written"):
        enter()
