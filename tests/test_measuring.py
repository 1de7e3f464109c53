from __future__ import annotations

import subprocess
import sys

import pytest

from cuboid.cli.tables import detector_lines
from cuboid.runs.tracking.measuring import WARM_UP_FRAMES, DetectorCost, FrameLog


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
        "from cuboid.runs.tracking.measuring import peak_memory_mb\n"
        "before = peak_memory_mb()\n"
        "block = b'x' * (200 << 20)\n"
        "del block\n"
        "print(before, peak_memory_mb())"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    before, after = map(float, done.stdout.split())
    assert 150 < after - before < 250


def times_with_detector(every: int, detector_ms: float) -> dict[str, list[float]]:
    """Frames of 20 ms without the detector; the warm-up is slow."""
    own = [detector_ms if i % every == 0 else 0.0 for i in range(100)]
    frame = [20.0 + took_ms + (500.0 if i < WARM_UP_FRAMES else 0.0) for i, took_ms in enumerate(own)]
    return {"frame": frame, "detector": own}


def test_the_cost_of_a_detector_is_measured_and_a_rate_within_the_budget_is_named() -> None:
    times = times_with_detector(every=3, detector_ms=40.0)
    cost = DetectorCost.of(times["frame"], times["detector"])
    assert cost is not None
    assert (cost.detector_ms, cost.median_ratio, cost.every) == (40.0, 1.0, 4)
    assert cost.mean_ratio == pytest.approx(1 + 40 / 3 / 20)
    (line,) = detector_lines(times)
    assert line == (
        "detector: 40.0 ms; with it a frame takes 1.67 times as long on average, 1.00 times on median; "
        "--detector-every 4 keeps the average within 1.5"
    )
    within = times_with_detector(every=cost.every, detector_ms=40.0)
    again = DetectorCost.of(within["frame"], within["detector"])
    assert again is not None
    assert again.mean_ratio <= 1.52  # the rate is that of endless frames: 90 are not a multiple of 4
    assert "keeps" not in detector_lines(times_with_detector(every=3, detector_ms=14.0))[0]


def test_a_run_without_a_detector_has_no_cost_of_one() -> None:
    assert detector_lines({"frame": [20.0] * 30}) == []
    assert detector_lines({"frame": []}) == []
    assert detector_lines({"frame": [20.0] * 30, "detector": [0.0] * 30}) == []
