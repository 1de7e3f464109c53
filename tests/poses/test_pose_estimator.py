from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from posed_pictures import CAMERA, ate_m, black, camera_path, picture

from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.frame import Frame
from cuboid.ground.geometry import se3
from cuboid.method.poses import PoseEstimate, PoseEstimator
from cuboid.method.poses.alignment import Alignment, Prior, Reference, align
from cuboid.method.poses.pyramid import Level

PATH = camera_path(60, 90.0)


def numbered(frame: Frame, index: int) -> Frame:
    return Frame(index, index / 30.0, frame.color, frame.depth_m)


@pytest.fixture(scope="module")
def pictures() -> list[Frame]:
    return [picture(T, k) for k, T in enumerate(PATH)]


def follow(frames: list[Frame]) -> tuple[PoseEstimator, list[PoseEstimate]]:
    estimator = PoseEstimator(CAMERA)
    return estimator, [estimator.update(numbered(frame, k)) for k, frame in enumerate(frames)]


def error_m(found: dict[int, np.ndarray], true: dict[int, np.ndarray]) -> float:
    assert found
    return ate_m(list(found.values()), [true[k] for k in found])


def test_the_way_of_the_camera_is_found(pictures: list[Frame]) -> None:
    estimator, estimates = follow(pictures)
    assert all(e.T_world_camera is not None for e in estimates)
    np.testing.assert_array_equal(estimates[0].T_world_camera, np.eye(4))
    assert 4 < len(estimator.keyframes) < 30
    assert sum(e.is_keyframe for e in estimates) == len(estimator.keyframes)
    trajectory = estimator.trajectory()
    assert list(trajectory) == list(range(60))
    assert error_m(trajectory, dict(enumerate(PATH))) < 0.006
    # the covariance is that of millimetres, in all directions
    deviation = np.sqrt(np.array([e.covariance for e in estimates[1:]]).diagonal(axis1=1, axis2=2))
    assert deviation.min() > 0
    assert deviation[:, :3].max() < 0.03


def test_a_fast_camera_is_followed(pictures: list[Frame]) -> None:
    every = range(0, 60, 4)  # 6 degrees, 19 cm from one to the next
    estimator = PoseEstimator(CAMERA)
    estimates = [estimator.update(pictures[k]) for k in every]
    assert all(e.T_world_camera is not None for e in estimates)
    assert error_m(estimator.trajectory(), dict(enumerate(PATH))) < 0.01


def test_in_doubt_the_search_begins_at_places_that_differ(
    pictures: list[Frame], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a motion to go by, where the camera is expected is where it was: one start, not two that agree."""
    starts = []

    def noting(reference: Reference, levels: Sequence[Level], T: np.ndarray, prior: Prior) -> Alignment:
        starts.append(T)
        return align(reference, levels, T, prior)

    estimator = PoseEstimator(CAMERA)
    estimator.update(pictures[0])
    monkeypatch.setattr("cuboid.method.poses.estimator.align", noting)
    monkeypatch.setattr("cuboid.method.poses.estimator.SURE_FIT", 1.1)
    assert estimator.update(pictures[4]).T_world_camera is not None
    assert len(starts) == 2
    np.testing.assert_allclose(starts[0], np.eye(4))
    assert se3.angle(starts[1]) > np.radians(4)


def test_the_same_input_gives_the_same_bytes(pictures: list[Frame]) -> None:
    one, two = (follow(pictures[:25])[0].trajectory() for _ in range(2))
    assert np.array(list(one.values())).tobytes() == np.array(list(two.values())).tobytes()


def test_times_that_make_no_sense_do_no_harm(pictures: list[Frame]) -> None:
    estimator = PoseEstimator(CAMERA)
    times = [0.0, 5.0, 5.0, 4.0, -7.0, 1e9, 1e9, 1e9, 2.0, 3.0]
    estimates = [
        estimator.update(Frame(k, time_s, pictures[k].color, pictures[k].depth_m)) for k, time_s in enumerate(times)
    ]
    assert all(e.T_world_camera is not None for e in estimates)


def test_a_covered_lens_is_lost_and_found_again(pictures: list[Frame]) -> None:
    frames = [*pictures[:30], *(black(k) for k in range(5)), *pictures[34:50]]
    estimator, estimates = follow(frames)
    lost = [e.frame for e in estimates if e.T_world_camera is None]
    assert lost[:5] == [30, 31, 32, 33, 34]
    assert len(lost) <= 8
    assert all(estimates[k].covariance is None and estimates[k].keyframe == -1 for k in lost)
    true = dict(enumerate([*PATH[:30], *[np.eye(4)] * 5, *PATH[34:50]]))
    assert error_m(estimator.trajectory(), true) < 0.01


def test_a_camera_set_down_elsewhere_is_known_again(pictures: list[Frame]) -> None:
    frames = [*pictures[:40], *pictures[4:10]]
    _estimator, estimates = follow(frames)
    online = {e.frame: e.T_world_camera for e in estimates if e.T_world_camera is not None}
    assert 45 in online
    assert error_m(online, dict(enumerate([*PATH[:40], *PATH[4:10]]))) < 0.01
    assert not any(e.is_keyframe for e in estimates[40:])


def test_a_place_never_seen_is_joined_when_the_way_leads_back(pictures: list[Frame]) -> None:
    """Lost far away, the camera maps on by itself, and all gets poses once it is back on known ground."""
    back = [pictures[k] for k in range(44, 4, -1)]
    covered = [black(k) for k in range(29)]
    frames = [*pictures[:6], *covered, *back]
    estimator, estimates = follow(frames)
    true = dict(enumerate([*PATH[:6], *[np.eye(4)] * 29, *[PATH[k] for k in range(44, 4, -1)]]))
    assert all(e.T_world_camera is None for e in estimates[6:40])
    assert estimates[-1].T_world_camera is not None
    trajectory = estimator.trajectory()
    assert len(trajectory) > 6 + 35
    assert {k.submap for k in estimator.keyframes} == {0}
    assert error_m(trajectory, true) < 0.02


def test_keyframes_agree_with_the_poses_given_out(pictures: list[Frame]) -> None:
    estimator, estimates = follow(pictures[:40])
    trajectory = estimator.trajectory()
    for keyframe in estimator.keyframes:
        np.testing.assert_allclose(trajectory[keyframe.frame], keyframe.T_world_camera, atol=1e-9)
    last = estimates[-1]
    assert last.keyframe in range(len(estimator.keyframes))
    assert last.T_world_camera is not None
    np.testing.assert_allclose(se3.inverse(last.T_world_camera) @ trajectory[39], np.eye(4), atol=1e-9)


def test_a_start_in_the_dark_waits_for_light(pictures: list[Frame]) -> None:
    _, estimates = follow([black(0), black(1), *pictures[:3]])
    assert [e.T_world_camera is None for e in estimates] == [True, True, False, False, False]
    assert estimates[2].is_keyframe


def test_a_frame_of_another_size_is_refused() -> None:
    small = Frame(7, 0.0, np.zeros((120, 160, 3), np.uint8), np.zeros((120, 160), np.float32))
    with pytest.raises(FrameError, match="frame 7 is 160 x 120 pixels, expected 320 x 240"):
        PoseEstimator(CAMERA).update(small)
