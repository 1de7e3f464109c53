from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from posed_pictures import CAMERA, picture

from cuboid import Tracker, open_recording
from cuboid.cli import main
from cuboid.ground.core.frame import Frame
from cuboid.ground.core.pose_stream import PoseStream
from cuboid.ground.geometry import se3
from cuboid.inputs.readers.recording import PoseClock
from cuboid.lab.synthetic.paths import POSE_NOISES
from cuboid.method.poses import synchronised
from cuboid.method.poses.clock import PoseOffset, misfit_of, pose_offset_of, scale_misfit, smoothed
from cuboid.method.poses.motions import found_motions, levels_of_frames, telling_frames
from cuboid.method.poses.synchronised import SynchronisedPoses
from made_scenes import look_at
from made_table import write_table

FRAMES = 150
TIMES_S = np.arange(FRAMES) / 30.0


def hand(time_s: float) -> np.ndarray:
    """T_world_camera of a hand that sways: 0.2 m/s, 20 degrees/s."""
    turn = np.radians(-100.0 + 12.0 * np.sin(1.1 * time_s) + 3.0 * np.sin(4.0 * time_s))
    eye = (1.8 * np.cos(turn), 1.8 * np.sin(turn), 1.1 + 0.05 * np.sin(3.1 * time_s))
    return look_at(eye, (0.1 + 0.1 * np.sin(2.3 * time_s), 0.3, 0.25 + 0.05 * np.sin(3.7 * time_s)))


def poses_at(times_s: np.ndarray) -> np.ndarray:
    return np.array([hand(float(time_s)) for time_s in times_s])


@cache
def shown(index: int) -> Frame:
    return picture(hand(float(TIMES_S[index])), index)


def found(poses: np.ndarray) -> PoseOffset | None:
    triples = telling_frames(TIMES_S, poses)
    motions = found_motions(levels_of_frames(shown, CAMERA), range(FRAMES), TIMES_S, poses, triples)
    return pose_offset_of(TIMES_S, poses, motions)


@pytest.mark.parametrize("late_ms", [-80.0, 15.0])
def test_the_offset_of_a_clock_is_found_with_its_interval(late_ms: float) -> None:
    """A pose with a stamp that is late by a time is the true pose of that time before its stamp."""
    offset = found(poses_at(TIMES_S - 1e-3 * late_ms))
    assert offset is not None
    assert offset.doubt == ""
    assert 1e3 * offset.offset_s == pytest.approx(-late_ms, abs=3.0)
    assert abs(1e3 * offset.offset_s + late_ms) < 1e3 * 2.0 * offset.error_s + 1.0
    assert offset.after_m < 0.5 * offset.before_m


def noisy(deviation_m: float, deviation_rad: float) -> np.ndarray:
    rng = np.random.default_rng(3)
    motions = rng.normal(size=(FRAMES, 6)) * np.repeat([deviation_m, deviation_rad], 3)
    return np.array([T @ se3.exp(motion) for T, motion in zip(poses_at(TIMES_S), motions, strict=True)])


@pytest.mark.parametrize("fault", ["none", "5 mm", "half a degree", "drift", "jumps"])
def test_poses_with_true_times_get_no_offset(fault: str) -> None:
    exact = poses_at(TIMES_S)
    if fault in POSE_NOISES:
        poses = POSE_NOISES[fault](exact, np.random.default_rng(5))
    else:
        poses = {"none": exact, "5 mm": noisy(0.005, 0.0), "half a degree": noisy(0.0, np.radians(0.5))}[fault]
    offset = found(poses)
    assert offset is not None
    assert offset.doubt


def test_a_camera_that_stands_still_or_moves_evenly_tells_no_offset() -> None:
    still = np.array([hand(0.0)] * FRAMES)
    assert telling_frames(TIMES_S, still) == []
    assert pose_offset_of(TIMES_S, still, []) is None


def test_smoothing_keeps_a_path_and_averages_noise_alike_at_all_times() -> None:
    """Between two samples linear interpolation would have half the variance of noise that it has at a sample."""
    at_s = np.linspace(1.0, 4.0, 601)
    exact, smooth = poses_at(at_s), smoothed(TIMES_S, poses_at(TIMES_S), at_s, 0.04)
    assert np.abs(smooth - exact).max() < 1e-3
    rng, samples = np.random.default_rng(0), poses_at(TIMES_S)
    errors = []
    for _ in range(20):
        shaken = samples.copy()
        shaken[:, :3, 3] += rng.normal(0.0, 0.01, (FRAMES, 3))
        errors.append(smoothed(TIMES_S, shaken, at_s, 0.04)[:, :3, 3] - smooth[:, :3, 3])
    phase = np.floor((at_s * 30.0 % 1.0) * 4.0).astype(int) % 4
    variance = [np.square(np.array(errors)[:, phase == k]).mean() for k in range(4)]
    assert max(variance) < 1.2 * min(variance)


def test_poses_between_two_of_a_stream_are_interpolated_and_a_gap_is_named() -> None:
    times_s = np.array([0.0, 0.05, 0.5])
    poses = [np.eye(4), se3.exp((0.1, 0.0, 0.0, 0.0, 0.0, 0.2)), np.eye(4)]
    stream = PoseStream("poses.txt", times_s, poses)
    middle = stream.at(0.025)
    assert se3.angle(middle) == pytest.approx(0.1)
    assert middle[:3, 3] == pytest.approx(0.5 * poses[1][:3, 3])
    with pytest.raises(Exception, match=r"no camera pose at 0\.250 s: the nearest in poses\.txt is 0\.200 s away"):
        stream.at(0.25)


def test_poses_that_fit_worse_than_the_images_are_named_with_the_shake_of_their_rotations() -> None:
    def warning(poses: np.ndarray) -> str | None:
        motions = found_motions(
            levels_of_frames(shown, CAMERA), range(FRAMES), TIMES_S, poses, telling_frames(TIMES_S, poses, places=9)
        )
        return misfit_of(poses, motions)

    exact = poses_at(TIMES_S)
    assert warning(exact) is None
    assert warning(noisy(0.001, 0.0)) is None
    assert "shake" not in (warning(POSE_NOISES["drift"](exact, np.random.default_rng(5))) or "")
    named = warning(noisy(0.0, np.radians(0.5)))
    assert named is not None
    assert re.fullmatch(
        r"the given poses fit frames a moment apart worse than poses from the images: \d\d % of the points agree, "
        r"instead of \d\d %; their rotations shake by 0\.[456] degrees; try --poses corrected or estimated",
        named,
    )


def test_a_depth_scale_that_differs_from_the_poses_is_named_also_beside_drift() -> None:
    for poses in (poses_at(TIMES_S), POSE_NOISES["drift"](poses_at(TIMES_S), np.random.default_rng(5))):
        right = found(poses)
        assert right is not None
        assert scale_misfit(right) is None
        larger = poses.copy()
        larger[:, :3, 3] *= 1.1
        wrong = found(larger)
        assert wrong is not None
        assert wrong.scale == pytest.approx(right.scale / 1.1, abs=0.01)
        assert "differ in scale: frames a moment apart show 0.9" in (scale_misfit(wrong) or "")


def test_the_offset_is_found_or_given_or_off_when_a_recording_is_opened(tmp_path: Path) -> None:
    """Loop and command read the same frames: the recording has the offset, whoever reads it."""
    path = write_table(tmp_path / "table", 6)
    as_given = open_recording(path, pose_offset="off")
    moved = open_recording(path, pose_offset=-10.0)
    assert open_recording(path).warnings == as_given.warnings == ()
    assert moved.warnings == ("-10 ms are added to the times of the given poses (--pose-offset)",)
    assert moved.pose_clock.settings() == {"pose_offset": {"added_ms": -10.0}}
    assert not np.array_equal(moved.read(2).T_world_camera, as_given.read(2).T_world_camera)
    assert (
        main(["track", str(path), "--output", str(tmp_path / "command"), "--pose-offset", "-10", "--threads", "1"]) == 0
    )
    tracker = Tracker(moved.intrinsics)
    for frame in moved:
        tracker.update(frame)
    tracker.save(tmp_path / "loop", recording=moved)
    for name in ("objects.json", "trajectory.txt", "tracks.csv"):
        assert (tmp_path / "loop" / name).read_bytes() == (tmp_path / "command" / name).read_bytes()
    runs = [json.loads((tmp_path / name / "run.json").read_text()) for name in ("loop", "command")]
    assert [run["config"]["pose_offset"] for run in runs] == [{"added_ms": -10.0}] * 2
    assert all(moved.warnings[0] in run["warnings"] for run in runs)
    tracker.save(tmp_path / "named", recording=moved.with_pose_clock(PoseClock(misfit="the poses do not fit")))
    assert "the poses do not fit" in json.loads((tmp_path / "named" / "run.json").read_text())["warnings"]
    with pytest.raises(ValueError, match="pose_offset must be 'auto', 'off' or at most 10000 milliseconds, got 'on'"):
        open_recording(path, pose_offset="on")


def test_the_clock_of_a_loop_is_found_in_its_first_seconds_and_earlier_frames_follow(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """From then on poses are right to a millimetre, and the motion of each anchor corrects the map before."""
    monkeypatch.setattr(synchronised, "MEASURED_S", 4.8)
    late_s, exact = 0.04, poses_at(TIMES_S)
    given = poses_at(TIMES_S - late_s)
    source, located = SynchronisedPoses(CAMERA), []
    for k in range(FRAMES):
        image = shown(k - k % 3)  # of every third frame the image is kept
        located.append(source.locate(replace(image, index=k, timestamp_s=float(TIMES_S[k]), T_world_camera=given[k])))
    assert source.found is not None
    assert 1e3 * source.added_s == pytest.approx(-40.0, abs=3.0)
    corrected = next(k for k, posed in enumerate(located) if posed.moved)
    assert all(np.array_equal(posed.T_world_camera, T) for posed, T in zip(located[:corrected], given, strict=False))
    assert set(located[corrected].moved) == {posed.anchor for posed in located[:corrected]}
    assert located[corrected].anchor not in located[corrected].moved
    trajectory = source.trajectory()
    assert trajectory is not None
    off_m = np.array([np.linalg.norm(trajectory[k][:3, 3] - exact[k][:3, 3]) for k in range(FRAMES)])
    before_m = np.linalg.norm(given[:, :3, 3] - exact[:, :3, 3], axis=1)
    assert np.median(off_m) < 0.002
    assert np.median(before_m) > 0.005
    for k in range(corrected):
        moved = located[corrected].moved[located[k].anchor] @ given[k]
        assert np.linalg.norm(moved[:3, 3] - exact[k][:3, 3]) < 0.4 * before_m.max()
    assert source.warnings() == (f"the times of the given poses are {source.found.text}; they are corrected",)
