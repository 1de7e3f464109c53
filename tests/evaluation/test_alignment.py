from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_truth import cube, truth_document, write_csv, write_folder, write_truth

from cuboid.ground.core.errors import InputError
from cuboid.ground.geometry import se3
from cuboid.ground.geometry.box import Box
from cuboid.lab.evaluation import evaluate
from cuboid.lab.evaluation.alignment import mean_motion
from cuboid.results.files import PoseRow

TURN = se3.compose([0.5, 0.5, -0.5, 0.5], [3.0, -2.0, 1.0])


def camera(k: int) -> np.ndarray:
    """Return a pose of a camera that moves straight on and does not turn."""
    return se3.compose([1, 0, 0, 0], [0.1 * k, 0.0, 1.0])


def write_poses(path: Path, T_world: np.ndarray, frames: int) -> None:
    rows = (PoseRow(k / 30.0, T_world @ camera(k)) for k in range(frames))
    path.write_text("".join(f"{row.line()}\n" for row in rows))


def made(folder: Path, poses: str) -> tuple[Path, Path]:
    """Write a result in a world of its own, where the object lies elsewhere, and the truth."""
    result, recording = folder / "result", folder / "recording"
    result.mkdir()
    recording.mkdir()
    box = cube(0.3)
    elsewhere = Box(se3.transform(TURN, box.center), box.size, TURN[:3, :3] @ box.rotation)
    write_folder(result, elsewhere, range(10), read=10, poses=poses)
    write_poses(result / "trajectory.txt", TURN, 10)
    write_poses(recording / "true_trajectory.txt", np.eye(4), 10)
    write_truth(recording, truth_document([box]))
    return result, recording


def test_a_result_with_estimated_poses_is_judged_in_the_world_of_the_truth(tmp_path: Path) -> None:
    result, recording = made(tmp_path, "estimated")
    found = evaluate(result, recording)
    assert found.map.at[1].mean_iou == pytest.approx(1.0, abs=1e-4)
    assert found.identity.hota.hota == pytest.approx(1.0)


def test_given_poses_are_trusted_unless_a_trajectory_is_named(tmp_path: Path) -> None:
    result, recording = made(tmp_path, "given")
    assert evaluate(result, recording).map.at[0].found == 0
    moved = evaluate(result, recording, trajectory=recording / "true_trajectory.txt")
    assert moved.map.at[1].found == 1


def test_trajectories_without_a_common_time_and_results_without_one_are_refused(tmp_path: Path) -> None:
    result, recording = made(tmp_path, "estimated")
    (recording / "true_trajectory.txt").write_text("99.0 0 0 0 0 0 0 1\n")
    with pytest.raises(InputError, match="has no pose at any time of"):
        evaluate(result, recording)
    table = write_csv(tmp_path, [])
    with pytest.raises(InputError, match="has no trajectory to compare with"):
        evaluate(table, recording, trajectory=recording / "true_trajectory.txt")


@given(st.integers(0, 2**32 - 1), st.integers(1, 20))
def test_any_motion_between_worlds_is_found_from_any_poses(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    T_a_b, *poses = (se3.compose(rng.normal(size=4), rng.normal(size=3)) for _ in range(count + 1))
    in_b = np.array(poses)
    np.testing.assert_allclose(mean_motion(T_a_b @ in_b, in_b), T_a_b, atol=1e-9)
