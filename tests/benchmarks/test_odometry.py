from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from cuboid import open_recording
from cuboid.ground.geometry import se3
from cuboid.lab.synthetic import make_scene, render_recording
from following import Follower
from odometry import compare


def test_a_camera_is_followed_from_frame_to_frame_and_from_keyframe_to_keyframe() -> None:
    way = [se3.exp([0.03 * k, 0, 0, 0, 0.02 * k, 0]) for k in range(12)]
    for keyframes in (False, True):
        references = []

        def align(reference: int, frame: int, T_guess: np.ndarray, seen: list[int] = references) -> np.ndarray | None:
            seen.append(reference)
            return None if frame == 5 else se3.inverse(way[reference]) @ way[frame]

        follower = Follower(align, keyframes)
        found = [follower.add(k) for k in range(12)]
        assert follower.failed == 1
        assert len(set(references)) == (3 if keyframes else 11)
        np.testing.assert_allclose(found[5], found[4])
        if keyframes:  # the frame without an alignment was no keyframe
            np.testing.assert_allclose(found[11], way[11], atol=1e-9)


def test_every_way_is_measured_on_the_same_frames(tmp_path: Path) -> None:
    render_recording(make_scene("table", 3, frames=20), tmp_path / "table", size=(320, 240))
    args = argparse.Namespace(every=1, limit=16, peers_python=None)
    found = compare(open_recording(tmp_path / "table"), args)
    assert list(found) == ["Cuboid", "cv2.Odometry, frame to frame", "cv2.Odometry, frame to keyframe"]
    assert all(row["frames"] == 16 and row["ms_median"] > 0 for row in found.values())
    assert found["Cuboid"]["ate_cm"] < 0.5
    assert found["Cuboid"]["lost"] == 0
