"""Progress on a terminal and without one, and how far compiling is."""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np
import pytest
from rich.console import Console

from cuboid.cli import progress as module
from cuboid.cli.progress import COMPILING, CompileCount, about_left, progress
from cuboid.ground.compiling import compiled, compiletime
from cuboid.ground.core.results import FrameResult
from cuboid.runs.pipeline import ahead
from fakes import INTRINSICS, FakeRecording, FakeTracker


@dataclass
class FakeKernel:
    name: str
    cached: bool = False
    size: int = 100


def listed(monkeypatch: pytest.MonkeyPatch, kernels: list[FakeKernel]) -> None:
    """Let these be all kernels of tracking."""
    monkeypatch.setattr(compiled, "KERNELS", {kernel.name: kernel for kernel in kernels})
    monkeypatch.setattr(ahead, "listed", lambda: [(kernel.name, []) for kernel in kernels])
    monkeypatch.setattr(ahead, "useful_helpers", lambda processes: 0)
    monkeypatch.setattr(ahead, "listed_kernels", lambda: kernels)


def results(count: int) -> list[FrameResult]:
    tracker, recording = FakeTracker(INTRINSICS), FakeRecording(count)
    return [tracker.update(recording.read(i)) for i in range(count)]


def test_the_bar_shows_frames_rate_and_objects() -> None:
    screen = io.StringIO()
    with progress(Console(file=screen, force_terminal=True, width=120)) as bar:
        bar.start(4)
        for result in results(3):
            bar.frame(result)
        bar.skipped(3, "bad")
    shown = screen.getvalue()
    assert "4/4" in shown
    assert "frames/s, 1 object" in shown
    assert COMPILING not in shown


def test_compiling_is_counted_on_the_terminal_and_in_lines(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    kernels = [FakeKernel(str(k)) for k in range(4)]
    listed(monkeypatch, kernels)
    screen = io.StringIO()
    for bar in (progress(Console(file=screen, force_terminal=True, width=120)), progress()):
        with bar as shown:
            shown.start(4)
            kernels[0].cached = False
            compiletime.begin()
            kernels[0].cached = True  # by this process or another
            compiletime.end()
            compiletime.begin()
            compiletime.end()
    assert f"{COMPILING} 1 of 4" in screen.getvalue()
    assert f"{COMPILING} 2 of 4" in screen.getvalue()
    assert f"cuboid: {COMPILING} 1 of 4" in capsys.readouterr().err


def test_no_total_is_given_while_most_kernels_are_compiled_already(monkeypatch: pytest.MonkeyPatch) -> None:
    listed(monkeypatch, [FakeKernel(str(k), cached=k > 0) for k in range(4)])
    count = CompileCount()
    assert count.text() == ""
    compiletime.begin()
    try:
        assert count.text() == COMPILING
    finally:
        compiletime.end()


def test_a_first_run_tells_at_once_what_it_compiles_how_long_and_how_to_avoid_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    kernels = [FakeKernel(str(k)) for k in range(4)]
    listed(monkeypatch, kernels)
    with progress():
        compiletime.begin()
        compiletime.end()
    first = capsys.readouterr().err.splitlines()[0]
    assert "the first run compiles Cuboid's kernels, once: about 90 s" in first
    assert "pip install --no-deps --no-build-isolation ." in first
    for kernel in kernels[:3]:  # most are there: a few seconds
        kernel.cached = True
    with progress():
        compiletime.begin()
        compiletime.end()
    assert "first run" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("spent_s", "left", "words"),
    [
        (4.0, 9.0, ""),
        (10.0, 1.1, ", about 15 s left"),
        (30.0, 3.0, ", about 90 s left"),
        (60.0, 2.0, ", about 2 min left"),
    ],
)
def test_the_time_left_is_told_once_it_can_be_estimated(spent_s: float, left: float, words: str) -> None:
    assert about_left(spent_s, left) == words


def test_without_a_terminal_a_line_now_and_then(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = iter(np.arange(0.0, 1000.0, 1.5))
    monkeypatch.setattr(module.time, "perf_counter", lambda: next(clock))
    with progress() as lines:
        lines.start(30)
        for result in results(30):
            lines.frame(result)
    printed = capsys.readouterr().err.splitlines()
    assert 3 <= len(printed) <= 10
    assert all(line.startswith("cuboid: ") and "of 30 frames" in line for line in printed)
