from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from cuboid.cli import progress as module
from cuboid.cli.kernels import Kernel
from cuboid.cli.progress import COMPILING, LineProgress, TerminalProgress
from cuboid.results import FrameResult
from fakes import INTRINSICS, FakeRecording, FakeTracker


def results(count: int) -> list[FrameResult]:
    tracker, recording = FakeTracker(INTRINSICS), FakeRecording(count)
    return [tracker.update(recording.read(i)) for i in range(count)]


def test_the_bar_shows_frames_rate_and_objects(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "loaded_kernels", list)
    screen = io.StringIO()
    with TerminalProgress(Console(file=screen, force_terminal=True, width=120)) as bar:
        bar.start(4)
        for result in results(3):
            bar.frame(result)
        bar.skipped(3, "bad")
    shown = screen.getvalue()
    assert "4/4" in shown
    assert "frames/s, 1 object" in shown
    assert COMPILING not in shown


def test_compiling_is_said_where_kernels_are_not_cached(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(module, "loaded_kernels", lambda: [Kernel("k", False, Path())])
    screen = io.StringIO()
    with TerminalProgress(Console(file=screen, force_terminal=True, width=120)) as bar:
        bar.start(4)
    assert COMPILING in screen.getvalue()
    LineProgress().start(4)
    assert COMPILING in capsys.readouterr().err


def test_without_a_terminal_a_line_now_and_then(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(module, "loaded_kernels", list)
    clock = iter(np.arange(0.0, 1000.0, 1.5))
    monkeypatch.setattr(module.time, "perf_counter", lambda: next(clock))
    with LineProgress() as lines:
        lines.start(30)
        for result in results(30):
            lines.frame(result)
    printed = capsys.readouterr().err.splitlines()
    assert 3 <= len(printed) <= 10
    assert all(line.startswith("cuboid: ") and "of 30 frames" in line for line in printed)
