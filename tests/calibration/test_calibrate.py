from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from posed import Posed, scaled

from cuboid.cli import main
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.frame import Frame
from cuboid.ground.geometry import se3
from cuboid.inputs.calibration import calibrate, quick_check, spread_out
from cuboid.inputs.readers import Recording, open_recording
from cuboid.results.files import read_run
from fakes import write_recording


@pytest.mark.parametrize(("factor", "noise"), [(1.08, "none"), (0.92, "jumps"), (0.92, "drift")])
def test_a_wrong_focal_length_is_found_within_one_percent(
    recording: Recording, posed: Posed, factor: float, noise: str
) -> None:
    truth = recording.intrinsics
    found = calibrate(posed(noise), scaled(truth, factor))
    assert found.intrinsics.fx == pytest.approx(truth.fx, rel=0.01)
    assert found.intrinsics.fy / found.intrinsics.fx == pytest.approx(truth.fy / truth.fx)
    assert abs(found.intrinsics.fx / truth.fx - 1) < 4 * found.focal_error
    assert found.depth_scale == 1.0
    if noise != "drift":
        assert found.intrinsics.cx == pytest.approx(truth.cx, abs=1.5)
        assert found.intrinsics.cy == pytest.approx(truth.cy, abs=1.5)
        assert found.gap_after_m < 0.75 * found.gap_before_m


def test_wrong_depth_scale_and_centre_are_found_together(recording: Recording, posed: Posed) -> None:
    truth = recording.intrinsics
    start = replace(scaled(truth, 0.95), cx=truth.cx + 8, cy=truth.cy - 6)
    found = calibrate(posed(depth=1 / 1.07), start)
    assert found.depth_scale == pytest.approx(1.07, rel=0.01)
    assert found.intrinsics.fx == pytest.approx(truth.fx, rel=0.01)
    assert found.intrinsics.cx == pytest.approx(truth.cx, abs=1.0)
    assert found.intrinsics.cy == pytest.approx(truth.cy, abs=1.0)


def test_the_same_frames_give_the_same_bytes(recording: Recording, posed: Posed) -> None:
    start = scaled(recording.intrinsics, 1.05)
    assert calibrate(posed(count=16), start) == calibrate(posed(count=16), start)


def test_only_the_focal_length_is_fitted_where_poses_are_estimated(recording: Recording, posed: Posed) -> None:
    truth = recording.intrinsics
    found = calibrate(posed(), scaled(truth, 1.08), estimated=True)
    assert found.intrinsics.fx == pytest.approx(truth.fx, rel=0.01)
    assert (found.intrinsics.cx, found.intrinsics.cy, found.depth_scale) == (truth.cx, truth.cy, 1.0)
    assert np.isnan(found.depth_scale_error)


def test_a_camera_that_stands_still_tells_nothing(recording: Recording, posed: Posed) -> None:
    still = [replace(frame, T_world_camera=np.eye(4)) for frame in posed(count=8)]
    with pytest.raises(InputError, match="only 0 pairs of 8 frames"):
        calibrate(still, recording.intrinsics)
    assert quick_check(still, recording.intrinsics).focal is None
    assert not quick_check([], recording.intrinsics).wrong


@pytest.mark.parametrize("noise", ["none", "drift", "jumps"])
def test_the_quick_check_tells_wrong_from_right(recording: Recording, posed: Posed, noise: str) -> None:
    frames, truth = posed(noise, count=24), recording.intrinsics
    right = quick_check(frames, truth)
    assert not right.wrong
    assert right.depth_scale is None
    for factor in (0.92, 1.08):
        verdict = quick_check(frames, scaled(truth, factor))
        assert verdict.wrong
        assert verdict.focal == pytest.approx(truth.fx, rel=0.02)
        assert verdict.depth_scale is None, "no other cause is named"


@pytest.mark.parametrize("noise", ["none", "drift", "jumps"])
@pytest.mark.parametrize("depth", [0.7, 0.9, 0.95, 1.05, 1.1, 1.3])
def test_the_quick_check_names_the_depth_scale_and_no_focal_length(
    recording: Recording, posed: Posed, depth: float, noise: str
) -> None:
    verdict = quick_check(posed(noise, count=24, depth=depth), recording.intrinsics)
    assert not verdict.wrong
    assert verdict.depth_scale == pytest.approx(1 / depth, rel=0.01)


def test_the_quick_check_names_both_where_both_are_off(recording: Recording, posed: Posed) -> None:
    verdict = quick_check(posed(count=24, depth=1.08), scaled(recording.intrinsics, 0.93))
    assert verdict.wrong
    assert verdict.focal == pytest.approx(recording.intrinsics.fx, rel=0.01)
    assert verdict.depth_scale == pytest.approx(1 / 1.08, rel=0.01)


@pytest.mark.parametrize("factor", [1.0, 0.7, 1.5])
def test_a_wrong_focal_length_is_named_after_a_second_of_estimated_poses(
    factor: float, recording: Recording, tmp_path: Path
) -> None:
    """The camera turns by a few degrees only, which is too little for the check of longer runs."""
    K = scaled(recording.intrinsics, factor)
    words = ["--limit", "20", "--poses", "estimated", "--intrinsics", f"{K.fx},{K.fy},{K.cx},{K.cy}", "--threads", "1"]
    output = tmp_path / "out"
    assert main(["track", str(recording.path), *words, "--output", str(output)]) == 0
    warnings = [line for line in read_run(output / "run.json").warnings if "focal length" in line]
    if factor == 1.0:
        assert not warnings
    else:
        found = re.search(r"the frames fit together clearly better with (\d+) ± \d+ px", *warnings)
        assert found
        assert float(found[1]) == pytest.approx(recording.intrinsics.fx, rel=0.02)


@pytest.mark.parametrize(("factor", "poses"), [(0.92, "given"), (1.1, "corrected")])
def test_a_run_and_a_calibration_name_the_same_depth_scale(
    factor: float, poses: str, recording: Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """5000 units per metre are true."""
    words = [str(recording.path), "--depth-scale", f"{5000 * factor:g}", "--limit", "40"]
    output = tmp_path / "out"
    assert main(["track", *words, "--poses", poses, "--output", str(output), "--threads", "1"]) == 0
    (warning,) = read_run(output / "run.json").warnings
    assert warning.startswith(f"the depth scale of {5000 * factor:g} units per metre is off: ")
    advised = float(warning.rpartition(" --depth-scale ")[2])
    assert advised == pytest.approx(5000, rel=0.01)
    assert main(["calibrate", *words, "--output", str(tmp_path / "camera.json")]) == 0
    assert "the depth scale is changed" in capsys.readouterr().out
    found = json.loads((tmp_path / "camera.json").read_text())
    assert found["depth_units_per_metre"] == pytest.approx(advised, rel=0.005)
    assert found["fx"] == pytest.approx(recording.intrinsics.fx, rel=0.01)


@pytest.mark.parametrize("command", ["track", "slam"])
def test_a_run_with_a_wrong_focal_length_goes_on_and_says_so(
    command: str, recording: Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    K = recording.intrinsics
    for factor, wrong in ((1.0, False), (1.08, True)):
        output = tmp_path / str(factor)
        start = f"{K.fx * factor},{K.fy * factor},{K.cx},{K.cy}"
        words = [command, str(recording.path), "--intrinsics", start, "--limit", "40", "--threads", "1"]
        words += ["--output", str(output)]
        assert main(words) == 0
        said = [line for line in capsys.readouterr().out.splitlines() if "warning" in line]
        warnings = read_run(output / "run.json").warnings
        assert len(warnings) == len(said) == wrong
        if wrong:
            assert said[0] == f"warning: {warnings[0]}"
            assert f"focal length in use, {K.fx * 1.08:.1f} px, is off" in warnings[0]
            assert "'cuboid calibrate' finds the intrinsics" in warnings[0]


def test_frames_are_chosen_where_the_camera_has_moved() -> None:
    def at(x_m: float) -> np.ndarray:
        return se3.compose([1, 0, 0, 0], [x_m, 0, 0])

    way = {k: at(0.0 if k < 50 else 0.1 * (k - 50)) for k in range(80)}
    assert spread_out(way, 64)[:3] == [0, 51, 52]
    long = spread_out({k: at(0.1 * k) for k in range(1000)}, 64)
    assert len(long) == 64
    assert (np.diff(long) == 1).sum() >= 48
    assert long[-1] > 900
    assert spread_out({}) == []
    assert spread_out({7: np.eye(4)}) == [7]


def test_the_command_writes_a_camera_that_the_readers_take(
    recording: Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truth = recording.intrinsics
    start = f"{truth.fx * 0.93},{truth.fy * 0.93},{truth.cx},{truth.cy}"
    output = tmp_path / "camera.json"
    words = ["calibrate", str(recording.path), "--intrinsics", start, "--output", str(output)]
    assert main(words) == 0
    assert "is unchanged" in capsys.readouterr().out
    found = open_recording(recording.path, intrinsics=output)
    assert found.intrinsics.fx == pytest.approx(truth.fx, rel=0.01)
    assert found.depth_units_per_metre == pytest.approx(5000)
    assert json.loads(output.read_text())["width"] == 320
    assert main(words) == 2
    assert "exists; --force replaces it" in capsys.readouterr().err


def test_estimated_poses_and_unknown_intrinsics(
    recording: Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bare = tmp_path / "bare"
    bare.mkdir()
    for name in ("color", "depth"):
        (bare / name).symlink_to(recording.path / name)
    words = ["calibrate", str(bare), "--output", str(tmp_path / "c.json"), "--depth-scale", "5000", "--limit", "45"]
    assert main([*words, "--json", str(tmp_path / "figures.json")]) == 0
    assert "estimated poses do not determine them" in capsys.readouterr().out
    found = json.loads((tmp_path / "c.json").read_text())
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert figures["after"]["fx"] == pytest.approx(found["fx"], abs=1e-3)
    assert (figures["before"]["width"], figures["center_error_px"]) == (320, [None, None])
    assert found["fx"] == pytest.approx(recording.intrinsics.fx, rel=0.02)
    assert (found["cx"], found["depth_units_per_metre"]) == (159.5, 5000)
    assert main([*words, "--poses", "given", "--force"]) == 2
    assert "has no camera poses; --poses estimated finds them" in capsys.readouterr().err


def test_mistakes_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(write_recording(tmp_path / "recording", 4))
    for words, says in (
        (["--output", str(tmp_path / "camera.txt")], "must be a .json file"),
        (["--output", str(tmp_path / "no" / "camera.json")], "does not exist"),
        (["--output", str(tmp_path / "a.json")], "pairs of"),
        (["--output", str(tmp_path / "a.json"), "--intrinsics", str(tmp_path / "none.json")], "cannot be read"),
    ):
        assert main(["calibrate", path, *words]) == 2
        error = capsys.readouterr().err
        assert says in error
        assert error.count("\n") == 1


def test_scene_01_from_the_published_focal_length(data_dir: Path) -> None:
    path = data_dir / "rgbd-scenes-v2" / "imgs" / "scene_01"
    recording = open_recording(path, intrinsics=(570.3, 570.3, 320.0, 240.0))
    T = {k: pose for k in range(len(recording)) if (pose := recording.pose(k)) is not None}
    frames: list[Frame] = [recording.read(k) for k in spread_out(T)]
    found = calibrate(frames, recording.intrinsics)
    assert found.intrinsics.fx == pytest.approx(534.8, rel=0.02)
    assert found.depth_scale == 1.0
    assert found.gap_after_m < 0.6 * found.gap_before_m
    assert quick_check(frames[::2], recording.intrinsics).wrong
    assert not quick_check(frames[::2], open_recording(path).intrinsics).wrong
