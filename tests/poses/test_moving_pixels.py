"""Camera poses from a video in which something large moves."""

from __future__ import annotations

import numpy as np
from posed_pictures import CAMERA, SCENE, ate_m, camera_path, picture

from cuboid.ground.geometry.box import Box
from cuboid.method.poses.estimator import PoseEstimator
from made_scenes import upright

FRAMES = 90
PATH = camera_path(FRAMES, 30.0)


def column(index: int) -> list[Box]:
    """A column that crosses the view between the camera and the boxes in the middle third of the frames."""
    passed = (index - FRAMES / 3) / (FRAMES / 3)
    if not 0.0 <= passed <= 1.0:
        return []
    T = PATH[index]
    place = T[:3, 3] + T[:3, 2] + (1.2 - 2.4 * passed) * T[:3, 0]
    return [upright((float(place[0]), float(place[1])), (0.35, 0.35, 1.8), 0.3)]


def estimated(*, crossed: bool) -> tuple[PoseEstimator, list[np.ndarray | None]]:
    estimator = PoseEstimator(CAMERA)
    poses = []
    for index, T in enumerate(PATH):
        boxes = SCENE + (column(index) if crossed else [])
        poses.append(estimator.update(picture(T, index, boxes=boxes)).T_world_camera)
    return estimator, poses


def error_m(poses: list[np.ndarray | None]) -> float:
    found = [(T, true) for T, true in zip(poses, PATH, strict=True) if T is not None]
    return ate_m([T for T, _ in found], [true for _, true in found])


def test_poses_stay_as_true_while_a_column_crosses_a_third_of_the_view() -> None:
    still, alone = estimated(crossed=False)
    crossed, poses = estimated(crossed=True)
    assert all(T is not None for T in [*alone, *poses])
    assert still.left_out.frames == 0
    assert still.left_out.warnings() == ()
    assert crossed.left_out.frames >= 15
    assert "of their pixels were left out of the camera poses" in crossed.left_out.warnings()[0]
    assert error_m(poses) <= 1.3 * error_m(alone) + 0.0005
