from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cuboid.cli import main
from cuboid.ground.core.errors import InputError, MissingExtraError
from cuboid.ground.geometry import se3
from cuboid.lab.evaluation.timed_poses import TimedPoses, read_poses
from cuboid.lab.evaluation.trajectory import associate, evaluate_trajectory, rigid_fit
from cuboid.lab.evaluation.trajectory_plot import plot
from cuboid.results.files import PoseRow
from fakes import write_recording


def path_of(xyz: np.ndarray, times_s: np.ndarray, turns: np.ndarray | None = None) -> TimedPoses:
    poses = np.array([se3.compose([1, 0, 0, 0], place) for place in xyz])
    if turns is not None:
        poses[:, :3, :3] = [se3.exp([0, 0, 0, *turn])[:3, :3] for turn in turns]
    return TimedPoses(Path("made"), times_s, poses)


def wandering(seed: int, count: int = 60) -> TimedPoses:
    rng = np.random.default_rng(seed)
    steps, turns = rng.normal(0, 0.05, (count, 3)), rng.normal(0, 0.05, (count, 3))
    return path_of(np.cumsum(steps, 0), np.arange(count) / 10.0, np.cumsum(turns, 0))


def moved(poses: TimedPoses, T: np.ndarray) -> TimedPoses:
    return TimedPoses(poses.path, poses.times_s, T @ poses.T_world_camera)


def write_tum(path: Path, poses: TimedPoses) -> Path:
    rows = (PoseRow(t, T) for t, T in zip(poses.times_s, poses.T_world_camera, strict=True))
    path.write_text("".join(f"{row.line()}\n" for row in rows))
    return path


SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])


def test_a_square_with_lifted_corners() -> None:
    # corners lifted by +3, -3, +3, -3 cm: no rigid motion mends that, and the best is none at all
    lifted = SQUARE + np.array([[0, 0, 0.03], [0, 0, -0.03], [0, 0, 0.03], [0, 0, -0.03]])
    times = np.arange(4.0)
    found = evaluate_trajectory(path_of(lifted, times), path_of(SQUARE, times))
    assert found.ate_cm.rmse == pytest.approx(3.0)
    assert found.ate_cm.mean == pytest.approx(3.0)
    assert found.ate_cm.max == pytest.approx(3.0)
    assert found.length_m == pytest.approx(3.0)
    # every side of 1 m is off by 6 cm, and takes one second
    for drift in (found.per_second, found.per_metre):
        assert drift.stretches == 3
        assert drift.translation_cm.median == pytest.approx(6.0)
        assert drift.rotation_deg.max == pytest.approx(0.0, abs=1e-6)


def test_one_wrong_corner_has_known_figures() -> None:
    # along a line, the last of five points 5 cm too far: the mean moves by 1 cm, residuals -1, -1, -1, -1, 4
    line = np.zeros((5, 3))
    line[:, 0] = np.arange(5)
    wrong = line.copy()
    wrong[4, 0] += 0.05
    found = evaluate_trajectory(path_of(wrong, np.arange(5.0)), path_of(line, np.arange(5.0)))
    assert found.ate_cm.mean == pytest.approx(8 / 5)
    assert found.ate_cm.median == pytest.approx(1.0)
    assert found.ate_cm.max == pytest.approx(4.0)
    assert found.ate_cm.rmse == pytest.approx(2.0)
    assert found.per_second.translation_cm.mean == pytest.approx(5 / 4)


def test_a_camera_that_turns_too_far_drifts_by_known_degrees() -> None:
    # 2 m/s along x; the truth does not turn, the estimate turns by 1 degree each second
    times = np.arange(0, 3.01, 0.1)
    xyz = np.stack([2 * times, 0 * times, 0 * times], 1)
    turns = np.radians(np.stack([0 * times, 0 * times, times], 1))
    found = evaluate_trajectory(path_of(xyz, times, turns), path_of(xyz, times))
    assert found.ate_cm.rmse == pytest.approx(0.0, abs=1e-6)
    assert found.per_second.rotation_deg.mean == pytest.approx(1.0)
    assert found.per_metre.rotation_deg.mean == pytest.approx(0.5)


@given(st.integers(0, 2**32 - 1))
def test_rigid_motions_of_either_world_change_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth = wandering(seed)
    noise = np.array([se3.exp(rng.normal(0, 0.01, 6)) for _ in range(len(truth))])
    estimate = TimedPoses(Path("e"), truth.times_s, truth.T_world_camera @ noise)
    before = evaluate_trajectory(estimate, truth)
    A, B = (se3.compose(rng.normal(size=4), rng.normal(0, 3, 3)) for _ in range(2))
    after = evaluate_trajectory(moved(estimate, A), moved(truth, B))
    assert after.ate_cm.rmse == pytest.approx(before.ate_cm.rmse)
    for one, other in ((before.per_second, after.per_second), (before.per_metre, after.per_metre)):
        assert other.translation_cm.rmse == pytest.approx(one.translation_cm.rmse)
        assert other.rotation_deg.rmse == pytest.approx(one.rotation_deg.rmse, abs=1e-6)


@given(st.integers(0, 2**32 - 1), st.integers(3, 30))
def test_the_fit_finds_the_motion_between_equal_points_and_is_never_a_mirror(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    T_a_b, b = se3.compose(rng.normal(size=4), rng.normal(size=3)), rng.normal(size=(count, 3))
    np.testing.assert_allclose(se3.transform(rigid_fit(se3.transform(T_a_b, b), b), b), se3.transform(T_a_b, b))
    assert se3.is_rigid(rigid_fit(rng.normal(size=(count, 3)), b), 1e-9)


def test_each_pose_has_one_partner_the_nearest_within_the_limit() -> None:
    a, b = np.array([0.0, 1.0, 2.0, 3.0]), np.array([0.01, 0.015, 1.019, 2.03, 2.99])
    one, other = associate(a, b, 0.02)
    assert one.tolist() == [0, 1, 3]
    assert other.tolist() == [0, 2, 4]
    # nothing has two partners, and both orders agree
    back, forth = associate(b, a, 0.02)
    assert (back.tolist(), forth.tolist()) == (other.tolist(), one.tolist())


def test_lost_frames_are_seen_in_the_coverage_and_every_third_frame_is_none_of_them() -> None:
    truth = wandering(1, 90)
    part = np.r_[0:30, 60:90]
    lost = TimedPoses(Path("lost"), truth.times_s[part], truth.T_world_camera[part])
    assert evaluate_trajectory(lost, truth).coverage == pytest.approx(60 / 90)
    third = TimedPoses(Path("third"), truth.times_s[::3], truth.T_world_camera[::3])
    found = evaluate_trajectory(third, truth)
    assert (found.coverage, found.pairs) == (pytest.approx(1.0, abs=0.02), 30)


def test_every_form_of_poses_reads_alike(tmp_path: Path) -> None:
    recording = write_recording(tmp_path / "recording", 5)
    (tmp_path / "result").mkdir()
    path = [f"1 0 0 0 {k * 0.01:.3f} 0 0" for k in range(5)]
    (tmp_path / "01.pose").write_text("\n".join(path) + "\n")
    frames = path_of(np.arange(5)[:, None] * [[0.01, 0, 0]], np.arange(5) / 30)
    write_tum(tmp_path / "result" / "trajectory.txt", frames)
    for found in map(read_poses, (recording, tmp_path / "01.pose", tmp_path / "result")):
        np.testing.assert_allclose(found.times_s, frames.times_s, atol=1e-6)
        np.testing.assert_allclose(found.T_world_camera, frames.T_world_camera, atol=1e-6)
    # A frame without a pose keeps the times of the others.
    (tmp_path / "01.pose").write_text("1 0 0 0 0 0 0\nnan 0 0 0 0 0 0\n1 0 0 0 1 0 0\n")
    assert read_poses(tmp_path / "01.pose").times_s.tolist() == [0.0, 2 / 30]


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("a.txt", "1 2 3\n", "a.txt line 1: expected timestamp tx ty tz qx qy qz qw, got '1 2 3'"),
        ("a.txt", "# none\n", "a.txt holds no pose"),
        ("a.pose", "1 0 0 0 0 0\n", "a.pose line 1: expected qw qx qy qz tx ty tz"),
        ("a.pose", "nan 0 0 0 0 0 0\n", "a.pose: holds no camera pose"),
        ("a.txt", "100 0 0 0 0 0 0 1\n101 0 0 0 0 0 0 1\n", "have 0 times in common (within 0.02 s)"),
    ],
)
def test_a_bad_file_is_one_line(
    name: str, text: str, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / name).write_text(text)
    truth = write_tum(tmp_path / "truth.txt", wandering(0))
    assert main(["evaluate", "trajectory", str(tmp_path / name), str(truth)]) == 2
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1


def test_a_folder_that_holds_no_poses_is_said_so(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"is neither a result with trajectory\.txt nor a recording"):
        read_poses(tmp_path)
    with pytest.raises(InputError, match="holds no camera pose"):
        read_poses(write_recording(tmp_path / "bare", 3, poses=False))
    with pytest.raises(InputError, match="does not exist"):
        read_poses(tmp_path / "nowhere")


def test_the_command_prints_writes_and_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    truth = wandering(3)
    noise = np.array([se3.exp([0.01 * (-1) ** k, 0, 0, 0, 0, 0]) for k in range(len(truth))])
    a = write_tum(tmp_path / "a.txt", TimedPoses(truth.path, truth.times_s, truth.T_world_camera @ noise))
    b = write_tum(tmp_path / "b.txt", truth)
    files = {name: tmp_path / name for name in ("p.png", "p.svg", "e.json")}
    for name in ("p.png", "p.svg"):
        assert main(["evaluate", "trajectory", str(a), str(b), "--plot", str(files[name]), "--json", "-"]) == 0
    document = json.loads(capsys.readouterr().out.split("}\n{")[0] + "}")
    assert document["format"] == "cuboid-trajectory-evaluation"
    assert document["ate_cm"]["rmse"] == pytest.approx(1.0, abs=0.05)
    assert main(["evaluate", "trajectory", str(a), str(b), "--json", str(files["e.json"])]) == 0
    out = capsys.readouterr().out
    assert "100.0 % of the truth estimated" in out
    assert json.loads(files["e.json"].read_text()) == document
    picture = cv2.imread(str(files["p.png"]))
    assert (picture != 255).any(axis=2).mean() > 0.01
    assert ElementTree.parse(files["p.svg"]).getroot().tag.endswith("svg")


def test_a_plot_of_another_form_is_refused_before_the_work(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", "trajectory", "no", "no", "--plot", str(tmp_path / "a.pdf")]) == 2
    assert "a plot is written as .png or .svg, not as '.pdf'" in capsys.readouterr().err


def test_a_camera_that_stands_still_can_be_drawn(tmp_path: Path) -> None:
    still = path_of(np.zeros((5, 3)), np.arange(5) / 30)
    found = evaluate_trajectory(still, still)
    assert found.per_metre.translation_cm is None
    plot(found, tmp_path / "still.png")
    assert (tmp_path / "still.png").stat().st_size > 0
    assert found.to_dict()["per_second"] == {"stretches": 0, "translation_cm": None, "rotation_deg": None}


def test_a_plot_is_the_same_bytes_again_and_shows_every_pose(tmp_path: Path) -> None:
    found = evaluate_trajectory(wandering(4), wandering(4))
    for name in ("a.svg", "b.svg"):
        plot(found, tmp_path / name)
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()
    strokes = [path.get("d") or "" for path in ElementTree.parse(tmp_path / "a.svg").getroot().iterfind(".//{*}path")]
    assert max(len(re.findall("[ML]", stroke)) for stroke in strokes) > 60 / 4


def test_a_plot_without_matplotlib_names_its_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingExtraError, match="install the extra 'plot'"):
        plot(evaluate_trajectory(wandering(4), wandering(4)), tmp_path / "a.png")


def test_the_poses_of_scene_01_are_their_own_truth(data_dir: Path) -> None:
    scenes = data_dir / "rgbd-scenes-v2"
    found = evaluate_trajectory(scenes / "pc" / "01.pose", scenes / "imgs" / "scene_01")
    assert (found.pairs, found.coverage) == (888, 1.0)
    assert found.ate_cm.max < 1e-6
