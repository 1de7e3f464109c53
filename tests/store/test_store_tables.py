"""The files of a store: whatever happens while they are gathered, each row is there once."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pyarrow.dataset as ds
import pytest
from made_stores import put_run, run_of, thing

from cuboid.fleet.store.compact import compact
from cuboid.fleet.store.folder import StoreFolder
from cuboid.fleet.store.query import Tables
from cuboid.fleet.store.rows import ReadAs, RunHead, tables_of
from cuboid.fleet.store.schema import FAILED, TABLES
from cuboid.ground.core.errors import InputError
from cuboid.results.files import Results
from made_results import FRAMES, INTRINSICS, write_results


def rows(url: str) -> dict[str, list[dict[str, Any]]]:
    tables = Tables(url)
    return {name: tables.rows(f"select * from {name} order by all") for name in TABLES}


def filled(folder: Path, runs: int = 4) -> StoreFolder:
    place = StoreFolder(str(folder))
    for k in range(runs):
        put_run(place, k, [thing(1), thing(2, longest_m=0.2 + k)])
    put_run(place, 90, [], state=FAILED, reason="no frames")
    return place


def test_gathering_keeps_every_row(tmp_path: Path) -> None:
    place = filled(tmp_path)
    before = rows(place.url)
    assert len(before["objects"]) == 8
    done = compact(place)
    assert (done.runs, done.files_before, done.files_after) == (5, 17, 12)
    assert rows(place.url) == before
    put_run(place, 7, [thing(1)])  # on a day that has a gathered file
    assert compact(place).runs == 1
    assert len(rows(place.url)["objects"]) == 9
    assert not list(tmp_path.glob("*/*/part-*"))
    others = ds.dataset(tmp_path / "objects", partitioning="hive").to_table()  # what pandas, Spark and so on see
    assert others.num_rows == 9
    assert others.column("day").unique().to_pylist() == ["2026-03-01", "2026-03-02", "2026-03-03"]


def test_killed_at_any_step_of_gathering(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Killed(BaseException):
        pass

    start = filled(tmp_path / "start", 1)
    compact(start)
    put_run(start, 5, [thing(1)])
    put_run(start, 6, [thing(3)])
    before = rows(start.url)
    for step in range(100):
        place, left = StoreFolder(str(shutil.copytree(start.url, tmp_path / str(step)))), [step]

        def deadly(what: Any, left: list[int] = left) -> Any:
            def step_or_die(*args: Any, **options: Any) -> Any:
                left[0] -= 1
                if left[0] < 0:
                    raise Killed
                return what(*args, **options)

            return step_or_die

        with monkeypatch.context() as patched:
            for name in ("put", "create"):
                patched.setattr(StoreFolder, name, deadly(getattr(StoreFolder, name)))
            patched.setattr(type(place.fs), "rm_file", deadly(type(place.fs).rm_file))
            try:
                compact(place)
            except Killed:
                pass
            else:
                break
        assert rows(place.url) == before, step
        compact(place)
        assert rows(place.url) == before, step
    assert step > 12


def test_of_two_that_gather_at_once_one_wins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place, before = filled(tmp_path), rows(str(tmp_path))
    create = StoreFolder.create

    def too_late(self: StoreFolder, name: str, content: bytes) -> bool:
        monkeypatch.setattr(StoreFolder, "create", create)
        put_run(place, 8, [thing(1)])  # so that the other one gathers more
        assert compact(StoreFolder(self.url)).runs == 6
        return create(self, name, content)

    monkeypatch.setattr(StoreFolder, "create", too_late)
    assert compact(place).runs == 0
    after = rows(place.url)
    assert len(after["objects"]) == len(before["objects"]) + 1
    assert {row["run"] for row in after["runs"]} == {row["run"] for row in before["runs"]} | {run_of(8)}


def test_a_part_that_comes_again_counts_once(tmp_path: Path) -> None:
    place = filled(tmp_path)
    compact(place)
    put_run(place, 2, [thing(1), thing(2, longest_m=2.2)])  # a worker that everybody took for dead
    assert len(rows(place.url)["objects"]) == 8
    compact(place)
    assert not list(tmp_path.glob("*/*/part-*"))


def test_what_was_not_finished_does_not_count(tmp_path: Path) -> None:
    place = filled(tmp_path)
    part = put_run(place, 5, [thing(1)])
    place.remove([part.names()["runs"]])
    assert len(rows(place.url)["objects"]) == 8


def test_no_store_and_a_broken_one_are_one_line(tmp_path: Path, refused: Callable[..., str]) -> None:
    with pytest.raises(InputError, match="expected a store that 'cuboid batch' wrote"):
        Tables(str(tmp_path))
    with pytest.raises(InputError, match="nowhere: does not exist"):
        Tables(str(tmp_path / "nowhere"))
    place = filled(tmp_path / "store")
    compact(place)
    next(tmp_path.glob("store/_manifests/*.json")).write_text('{"format": "cuboid-store", "version": 9}')
    assert "version" in refused("find", place.url)


def test_things_that_depth_does_not_read_are_told_from_volumes(tmp_path: Path) -> None:
    folder = write_results(tmp_path / "results")
    file = folder / "objects.json"
    document = json.loads(file.read_text())
    flat = document["objects"][1]
    flat["kind"] = "flat"
    file.write_text(json.dumps(document))
    head = RunHead("run", "recording", "source", "0.2.0", "{}", datetime(2026, 1, 1, tzinfo=UTC), 1)
    tables = tables_of(head, Results(folder), ReadAs("plain", FRAMES, INTRINSICS, has_poses=True), {}, None)
    kinds = {row["label"]: row["kind"] for row in tables["objects"].to_pylist()}
    assert kinds == {label: "flat" if label == flat["label"] else "volume" for label in (1, 2, 3)}
