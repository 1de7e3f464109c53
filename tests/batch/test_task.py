"""A task: what a worker does with one recording, alone."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

import pytest

import cuboid.pipeline.run
from batches import content, recordings
from cuboid.batch.sources import Source
from cuboid.batch.task import Task, head_of, track
from cuboid.cli import main
from cuboid.cli.batch import add_arguments, settings_from
from cuboid.core.frame import Frame
from cuboid.core.results import FrameResult
from fakes import FakeTracker


@pytest.fixture
def task(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Task:
    monkeypatch.setattr(cuboid.pipeline.run, "_tracker", FakeTracker)
    source = Source("rec-00", str(recordings(tmp_path / "source", 1) / "rec-00"))
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    settings = settings_from(parser.parse_args([source.url, "--output", "unused"]))
    return Task(source, head_of(source, settings, "1"), settings, str(tmp_path / "store"), tables_only=False)


class Unasked(FakeTracker):
    """Is not asked."""

    def update(self, frame: Frame, anchor: int = 0) -> FrameResult:
        raise AssertionError("tracked again")


def test_what_is_whole_is_not_tracked_again_though_its_worker_died(
    task: Task, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = track(task)
    (results,) = tmp_path.glob("store/results/rec-00/*")
    files = {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in results.iterdir()}
    rows = content(tmp_path / "store")
    monkeypatch.setattr(cuboid.pipeline.run, "_tracker", Unasked)
    assert track(task) == first
    assert {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in results.iterdir()} == files
    assert content(tmp_path / "store") == rows


def test_results_appear_when_they_are_whole(task: Task, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[str] = []

    class Watched(FakeTracker):
        def update(self, frame: Frame, anchor: int = 0) -> FrameResult:
            seen.extend(path.name for path in tmp_path.glob("store/results/rec-00/*"))
            return super().update(frame, anchor)

    monkeypatch.setattr(cuboid.pipeline.run, "_tracker", Watched)
    track(task)
    assert seen
    assert all(name.startswith(".") and name.endswith(".partial") for name in seen)
    (left,) = tmp_path.glob("store/results/rec-00/*")
    assert left.name == task.head.run


def test_what_killed_tasks_left_goes_after_a_day(
    task: Task, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    track(task)
    folder = tmp_path / "store" / "results" / "rec-00"
    old, young = folder / ".run.01234567.partial", folder / ".run.89abcdef.partial"
    for left in (old, young):
        left.mkdir()
        (left / "tracks.csv").write_text("half a li")
    os.utime(old, (1_700_000_000, 1_700_000_000))
    assert main(["store", "compact", str(tmp_path / "store")]) == 0
    assert "1 leftovers removed" in capsys.readouterr().out
    assert not old.exists()
    assert young.exists()
    assert (folder / task.head.run / "report.html").is_file()
