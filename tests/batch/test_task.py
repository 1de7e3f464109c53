"""A task: what a worker does with one recording, alone."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import cuboid.runs.pipeline.run
from batches import content, recordings, settings_of
from cuboid.cli import main
from cuboid.fleet.batch.sources import BatchSource
from cuboid.fleet.batch.task import Task, head_of, track
from cuboid.ground.core.frame import Frame
from cuboid.ground.core.results import FrameResult
from fakes import FakeTracker
from made_shapes import finished, frames, write_frames
from made_text_models import made_text_model


@pytest.fixture
def task(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Task:
    monkeypatch.setattr(cuboid.runs.pipeline.run, "_tracker", FakeTracker)
    source = BatchSource("rec-00", str(recordings(tmp_path / "source", 1) / "rec-00"))
    settings = settings_of(source.url)
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
    monkeypatch.setattr(cuboid.runs.pipeline.run, "_tracker", Unasked)
    assert track(task) == first
    assert {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in results.iterdir()} == files
    assert content(tmp_path / "store") == rows


def test_results_appear_when_they_are_whole(task: Task, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[str] = []

    class Watched(FakeTracker):
        def update(self, frame: Frame, anchor: int = 0) -> FrameResult:
            seen.extend(path.name for path in tmp_path.glob("store/results/rec-00/*"))
            return super().update(frame, anchor)

    monkeypatch.setattr(cuboid.runs.pipeline.run, "_tracker", Watched)
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


def test_vectors_of_an_image_text_model_stand_in_the_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("tokenizers")
    source = BatchSource("made", str(tmp_path / "made"))
    write_frames(tmp_path / "made", frames())
    model = made_text_model(tmp_path / "model")
    settings = settings_of(source.url, "--text-model", model)
    assert "text_model" not in settings_of(source.url)
    store = str(tmp_path / "store")

    def made(recording: object, output: Path, *_: object, **__: object) -> None:
        """Results whose objects are known: what tracking finds is another test's."""
        finished(output, tmp_path / "again")

    monkeypatch.setattr(cuboid.runs.pipeline.run, "track_recording", lambda *given, **options: made(*given, **options))
    monkeypatch.setattr("cuboid.results.files.pending.new_folder", plain_folder)
    track(Task(source, head_of(source, settings, "1"), settings, store, tables_only=False))
    assert main(["find", store, "--text", "red", "--text-model", str(model), "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["objects"]
    assert [row["label"] for row in rows] == [2, 1]
    assert list(tmp_path.glob("store/results/made/*/embeddings.npz"))


@contextmanager
def plain_folder(path: Path, **_: object) -> Iterator[Path]:
    """The folder itself, which the results make."""
    yield path
