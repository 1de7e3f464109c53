"""Whole runs over made recordings with one fault each: the fault is named, with the call that helps."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import cuboid
from cuboid import open_recording
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.frame import Frame
from cuboid.ground.geometry.se3 import inverse, quat_wxyz_from_rotation
from cuboid.inputs.calibration.pose_fit import pose_fit
from cuboid.lab.synthetic import make_scene, render_recording
from cuboid.method.poses.sources import CorrectedPoses
from cuboid.results.files import RunReport
from cuboid.runs.pipeline.options import ResultOptions, TrackOptions
from cuboid.runs.pipeline.run import track_recording
from cuboid.runs.tracking.diagnosis import RunFacts, diagnose
from made_scenes import CAMERA, cast, look_at, upright, write_plain

FRAMES = 24


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("diagnosis") / "table"
    render_recording(make_scene("table", 3, frames=FRAMES), path, size=(320, 240))
    return path


def report_of(path: Path, output: Path, poses: str | None = None, **options: Any) -> RunReport:
    recording = open_recording(path, **options)
    outcome = track_recording(recording, output, TrackOptions(poses=poses), results=ResultOptions(page=False))
    assert json.loads((output / "run.json").read_text())["warnings"] == list(outcome.report.warnings)
    return outcome.report


def changed(good: Path, folder: Path, change: Callable[[Path], None]) -> Path:
    shutil.copytree(good, folder)
    change(folder)
    return folder


def test_a_good_recording_has_no_warnings(good: Path, tmp_path: Path) -> None:
    assert report_of(good, tmp_path / "out").warnings == ()


def test_a_focal_length_of_no_camera_is_named_in_a_short_run(good: Path, tmp_path: Path) -> None:
    short = tmp_path / "short"
    (short / "color").mkdir(parents=True)
    shutil.copytree(good, short, dirs_exist_ok=True)
    for folder in ("color", "depth"):
        for image in sorted((short / folder).iterdir())[6:]:
            image.unlink()
    warnings = report_of(short, tmp_path / "out", "estimated", intrinsics=(900.0, 900.0, 160.0, 120.0)).warnings
    assert any("means a field of view of 20 degrees along 320 pixels" in line for line in warnings)


def test_depth_that_is_the_same_in_all_pixels_is_named() -> None:
    tracker = cuboid.Tracker(CAMERA)
    for k in range(3):
        color, depth_m = np.zeros((240, 320, 3), np.uint8), np.full((240, 320), 1.5, np.float32)
        tracker.update(Frame(k, k / 30, color, depth_m, look_at([0.1 * k, -1.2, 0.8], [0, 0, 0.05])))
    assert "same depth in all their pixels (1.5 m)" in tracker.warnings[0]


def test_frames_without_a_reading_of_depth_are_named() -> None:
    tracker = cuboid.Tracker(CAMERA, poses="given")
    color = np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8)
    for k in range(20):  # one negative value marks pixels without a reading
        tracker.update(Frame(k, k / 30, color, np.full(color.shape[:2], -1.5, np.float32), np.eye(4)))
    (warning,) = tracker.warnings
    assert warning.startswith("20 of 20 frames have no reading of depth and were not used")


@pytest.mark.parametrize("factor", [10.0, 0.1])
def test_a_depth_scale_off_by_ten_is_named_with_the_right_one(good: Path, tmp_path: Path, factor: float) -> None:
    units = open_recording(good).depth_units_per_metre
    warnings = report_of(good, tmp_path / "out", depth_scale=units / factor).warnings
    assert warnings[0].startswith(f"the depth scale of {units / factor:g} units per metre is wrong")
    assert warnings[0].endswith(f"run again with --depth-scale {units:g}")


def test_metres_taken_for_millimetres_are_refused_with_the_right_scale(good: Path, tmp_path: Path) -> None:
    units = open_recording(good).depth_units_per_metre
    with pytest.raises(InputError, match=rf"check --depth-scale \(at {units:g} it is [0-9.]+ to [0-9.]+ m\)"):
        report_of(good, tmp_path / "out", depth_scale=units / 1000)


def _as_read(names: str) -> Callable[[np.ndarray], np.ndarray]:
    """Return how a pose reads whose file is in conventions: what `--pose-convention` undoes."""

    def spoilt(T: np.ndarray) -> np.ndarray:
        T = T.copy()
        if "opengl" in names:
            T = T @ np.diag([1.0, -1.0, -1.0, 1.0])
        if "inverse" in names:
            T = inverse(T)
        if "mm" in names:
            T[:3, 3] *= 1000.0
        if "cm" in names:
            T[:3, 3] *= 100.0
        return T

    return spoilt


def _write_poses(folder: Path, names: str) -> None:
    """Write the poses of a recording in these conventions."""
    recording, spoilt, lines = open_recording(folder), _as_read(names), []
    for k in range(len(recording)):
        T = spoilt(recording.pose(k))
        w, x, y, z = quat_wxyz_from_rotation(T[:3, :3])
        quat = [w, x, y, z] if "wxyz" in names else [x, y, z, w]
        lines.append(" ".join(map(str, [k, *T[:3, 3], *quat])))
    (folder / "poses.txt").write_text("\n".join(lines))


@pytest.fixture(scope="module")
def frames(good: Path) -> list[Frame]:
    recording = open_recording(good)
    return [recording.read(k) for k in range(len(recording))]


@pytest.mark.parametrize(
    "names", ["inverse", "opengl", "mm", "cm", "wxyz", "inverse,opengl", "mm,opengl", "wxyz,inverse"]
)
def test_poses_in_another_convention_are_named_with_the_option_that_mends_them(
    good: Path, frames: list[Frame], tmp_path: Path, names: str
) -> None:
    bad = changed(good, tmp_path / "bad", lambda folder: _write_poses(folder, names))
    recording, read, mended = open_recording(good), open_recording(bad), open_recording(bad, pose_convention=names)
    assert not all(np.allclose(read.pose(k), recording.pose(k), atol=1e-6) for k in range(FRAMES))
    for k in range(FRAMES):
        assert mended.pose(k) == pytest.approx(recording.pose(k), abs=1e-6)

    fit = pose_fit(frames.__getitem__, recording.intrinsics, {k: read.pose(k) for k in range(FRAMES)})
    (warning,) = diagnose(RunFacts(FRAMES, FRAMES, 0, 0, 1, 1.0, 1.0, 1000.0, fit, True, 1, 1, 1))
    assert warning.startswith("the given poses are ")
    assert warning.endswith(f"run again with --pose-convention {names}")
    poses = CorrectedPoses(recording.intrinsics)
    for k, frame in enumerate(frames):
        posed = poses.locate(replace(frame, T_world_camera=read.pose(k)))
        np.testing.assert_array_equal(posed.T_world_camera, read.pose(k), "a wrong convention is never corrected")
    assert poses.warnings() == ()


@pytest.mark.parametrize("names", ["inverse", "mm,opengl"])
def test_a_run_names_the_convention_and_with_it_has_no_warnings(good: Path, tmp_path: Path, names: str) -> None:
    bad = changed(good, tmp_path / "bad", lambda folder: _write_poses(folder, names))
    (warning,) = report_of(bad, tmp_path / "given", poses="given").warnings
    assert warning.endswith(f"run again with --pose-convention {names}")
    if names == "inverse":
        assert report_of(bad, tmp_path / "corrected", poses="corrected").warnings == (warning,)
        given, corrected = ((tmp_path / poses / "trajectory.txt").read_bytes() for poses in ("given", "corrected"))
        assert given == corrected
    assert report_of(bad, tmp_path / "mended", pose_convention=names).warnings == ()


def test_a_pose_convention_that_is_none_is_refused(good: Path) -> None:
    with pytest.raises(InputError, match=r"a pose convention is one of wxyz, xyzw, .*, got 'ros'"):
        open_recording(good, pose_convention="ros")
    with pytest.raises(InputError, match="poses are mm or cm, not both"):
        open_recording(good, pose_convention="mm,cm")


def _empty(folder: Path) -> None:
    for file in (folder / "depth").iterdir():
        depth = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        kept = np.zeros_like(depth)
        kept[100:140, 140:180] = depth[100:140, 140:180]
        cv2.imwrite(str(file), kept)


def test_depth_that_is_nearly_empty_is_named(good: Path, tmp_path: Path) -> None:
    warnings = report_of(changed(good, tmp_path / "bad", _empty), tmp_path / "out").warnings
    assert warnings[0].startswith("depth has few readings: 2 % of the pixels")


def test_a_wall_alone_has_no_object_and_says_why(tmp_path: Path) -> None:
    folder = tmp_path / "wall"
    wall = [upright((0.0, 3.0), (20.0, 0.2, 20.0), z=-10.0)]
    rng, frames = np.random.default_rng(1), []
    for k in range(24):
        T = look_at((0.02 * k, 1.0, 1.5), (0.02 * k, 3.0, 1.5))
        depth, _ = cast(wall, T)
        noisy = np.where(depth > 0, depth + rng.normal(size=depth.shape) * 0.002, 0).astype(np.float32)
        frames.append(Frame(k, k / 30, rng.integers(0, 255, (240, 320, 3), np.uint8), noisy, T))
    write_plain(folder, CAMERA, frames)
    warnings = report_of(folder, tmp_path / "out").warnings
    assert len(warnings) == 1
    assert warnings[0].startswith("no object found")


def test_images_left_out_are_among_the_warnings(good: Path, tmp_path: Path) -> None:
    def add(folder: Path) -> None:
        (folder / "color" / "preview.png").write_bytes(b"no image")

    warnings = report_of(changed(good, tmp_path / "bad", add), tmp_path / "out").warnings
    assert warnings == ("1 image left out, whose name does not fit those of the others: color/preview.png",)
