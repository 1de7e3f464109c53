from __future__ import annotations

import subprocess
import sys

import pytest

from cuboid.tracking.measuring import WARM_UP_FRAMES, FrameLog


def log_of(frames: int) -> FrameLog:
    log = FrameLog()
    for i in range(frames):
        log.use({"frame": 1000.0 if i < WARM_UP_FRAMES else 10.0, "decode": 4.0})
    return log


def test_warm_up_is_left_out_of_a_run_that_is_long_enough() -> None:
    assert log_of(40).timings()["frame"].p95_ms == pytest.approx(10.0)
    assert log_of(2 * WARM_UP_FRAMES - 1).timings()["frame"].median_ms == pytest.approx(1000.0)


def test_a_stage_that_has_nothing_to_do_takes_no_time() -> None:
    log = FrameLog()
    log.use({"frame": 2.0, "a": 1.0})
    log.use({"frame": 3.0, "b": 2.0})
    assert {stage: list(times) for stage, times in log.milliseconds.items()} == {
        "frame": [2.0, 3.0],
        "a": [1.0, 0.0],
        "b": [0.0, 2.0],
    }


def test_a_run_without_frames_has_no_times() -> None:
    log = FrameLog()
    log.skip(3, "bad")
    assert (log.timings(), log.frames_per_second(), log.read) == ({}, 0.0, 1)


def test_peak_memory_counts_what_was_given_back() -> None:
    script = (
        "from cuboid.tracking.measuring import peak_memory_mb\n"
        "before = peak_memory_mb()\n"
        "block = b'x' * (200 << 20)\n"
        "del block\n"
        "print(before, peak_memory_mb())"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    before, after = map(float, done.stdout.split())
    assert 150 < after - before < 250
