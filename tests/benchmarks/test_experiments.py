from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from ab3dmot import track
from cuboid import open_recording
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.geometry.box import Box
from cuboid.lab.synthetic import make_scene, render_recording
from cuboid.lab.synthetic.paths import POSE_NOISES
from cuboid.method.objects.object_map import ObjectMap
from cuboid.method.proposals import Proposals, make_source
from experiment_poses import Shaken, merging
from experiment_sources import write_cpmc, write_mcg
from memories import KEPT, Features
from observations import observe
from scenes import Case
from tables import markdown

EXPERIMENTS = Path(__file__).resolve().parents[2] / "benchmarks" / "experiments.py"
UP = np.array([0.0, 0.0, 1.0])


def box(x: float, angle: float = 0.0) -> Box:
    c, s = np.cos(angle), np.sin(angle)
    return Box(np.array([x, 0.0, 0.1]), np.array([0.3, 0.2, 0.2]), np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]))


def test_kalman_association_keeps_labels_and_tells_after_three_hits() -> None:
    frames = [[box(0.01 * (k % 2)), box(1.0)] for k in range(4)]
    frames += [[box(0.0), box(1.0), box(2.0)] for _ in range(4)]
    found = list(track(frames, UP))
    assert [[label for label, _ in one] for one in found] == [[1, 2]] * 6 + [[1, 2, 3]] * 2
    assert np.linalg.norm(found[-1][0][1].center - frames[-1][0].center) < 0.02


def test_kalman_association_forgets_after_two_frames_unless_told_otherwise() -> None:
    frames = [[box(0.0)]] * 4 + [[]] * 3 + [[box(0.0)]] * 4
    assert [label for label, _ in list(track(frames, UP))[-1]] == [2]
    assert [label for label, _ in list(track(frames, UP, max_age=100))[-1]] == [1]


def test_a_box_that_is_named_the_other_way_round_is_the_same() -> None:
    swapped = Box(box(0.0).center, np.array([0.2, 0.3, 0.2]), box(0.0, np.pi / 2).rotation)
    found = list(track([[box(0.0)], [swapped], [box(0.0)], [swapped]], UP))
    _, last = found[-1][0]
    np.testing.assert_allclose(last.size, [0.3, 0.2, 0.2], atol=0.01)
    assert abs(last.rotation[0, 0]) > 0.99


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made") / "table"
    render_recording(make_scene("table", 5, frames=12), folder, sensor="clean", size=(128, 96))
    return folder


def test_pose_noise_grows_with_its_level(recording: Path) -> None:
    same, once, twice = (Shaken(recording, "drift", level) for level in (0.0, 1.0, 2.0))
    true = np.array([open_recording(recording).read(k).T_world_camera for k in range(len(same))])
    wrong = POSE_NOISES["drift"](true, np.random.default_rng(5))
    np.testing.assert_allclose(same.poses, true, atol=1e-9)
    np.testing.assert_allclose(once.poses, wrong, atol=1e-9)
    assert twice.error_cm == pytest.approx(2 * once.error_cm, rel=0.01)
    np.testing.assert_array_equal(twice.read(7).T_world_camera, twice.poses[7])


def test_merging_can_be_switched_off_for_a_while() -> None:
    before = ObjectMap._merge
    with merging(allowed=False):
        assert ObjectMap._merge(None, [1, 2]) is None  # type: ignore[arg-type,func-returns-value]
    assert ObjectMap._merge is before


@pytest.mark.parametrize("write", [write_mcg, write_cpmc])
def test_files_in_foreign_layouts_give_back_what_was_written(write: object, tmp_path: Path) -> None:
    boxes = np.array([[3, 5, 20, 30], [0, 0, 64, 48]], np.int32)
    masks = tuple(np.ones((y1 - y0, x1 - x0), np.uint8) for x0, y0, x1, y1 in boxes)
    write(tmp_path / "000000.mat", Proposals(boxes, np.array([0.9, 0.4], np.float32), masks), (48, 64))  # type: ignore[operator]
    frame = Frame(0, 0.0, np.zeros((48, 64, 3), np.uint8), np.zeros((48, 64), np.float32))
    found = make_source(f"precomputed:{tmp_path}")(frame, Intrinsics(50, 50, 32, 24, 64, 48))
    np.testing.assert_array_equal(found.boxes_xyxy, boxes)
    np.testing.assert_allclose(found.scores, [0.9, 0.4], atol=1e-6)


def test_features_vote_for_the_object_that_has_them() -> None:
    rng = np.random.default_rng(0)
    things = [rng.normal(0, 1, (32, 33)).astype(np.float32) for _ in range(3)]
    memory = Features("FPFH", radius=1.0)
    for number, thing in enumerate(things):
        memory.learn(number, None, thing)
    likeness = memory.likeness([things[2] + np.float32(0.01), things[0], rng.normal(5, 1, (32, 33)).astype(np.float32)])
    np.testing.assert_array_equal(likeness, [[0, 0, 1], [1, 0, 0], [0, 0, 0]])
    for _ in range(KEPT // 32):
        memory.learn(0, None, things[1] + np.float32(9))
    assert memory.likeness([things[0]])[0, 0] == 0  # the newest are kept


def test_what_a_frame_shows_is_kept_with_its_labels(recording: Path) -> None:
    seen = observe(Case("table", "table", recording, recording), every=2)
    assert [one.frame for one in seen] == [0, 2, 4, 6, 8, 10]
    last = seen[-1]
    assert last.width == 128
    assert len(last.clusters) >= 3
    for cluster in last.clusters:
        inside = np.abs((cluster.points - cluster.box.center) @ cluster.box.rotation) <= cluster.box.size / 2 + 0.02
        assert inside.all(1).mean() > 0.9
    np.testing.assert_allclose(last.eye, open_recording(recording).read(10).T_world_camera[:3, 3])


def test_a_table_is_markdown() -> None:
    assert markdown(("a", "b"), [("x", 0.5), ("y", None)]) == "| a | b |\n| --- | --- |\n| x | 0.500 |\n| y | - |"


def test_missing_data_is_told_in_one_line(tmp_path: Path) -> None:
    call = [sys.executable, str(EXPERIMENTS), "frames", "--work", str(tmp_path), "--kinds", "table", "--seeds", "1"]
    done = subprocess.run([*call, "--data", str(tmp_path)], capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 2
    assert done.stderr.startswith("experiments: ")
    assert done.stderr.count("\n") == 1
