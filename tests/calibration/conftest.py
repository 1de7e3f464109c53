from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from posed import Posed

from cuboid.ground.core.frame import Frame
from cuboid.inputs.calibration import spread_out
from cuboid.inputs.readers import Recording, open_recording
from cuboid.lab.synthetic import make_scene, render_recording
from cuboid.lab.synthetic.paths import POSE_NOISES


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """A small noisy recording of a table whose pinhole is known exactly."""
    path = tmp_path_factory.mktemp("calibration") / "table"
    render_recording(make_scene("table", 3, frames=60), path, size=(320, 240))
    return open_recording(path)


@pytest.fixture(scope="session")
def posed(recording: Recording) -> Posed:
    """Return a function that gives the frames to compare, with poses as they are or with noise."""
    T = np.array([recording.pose(k) for k in range(len(recording))])
    read = cache(recording.read)

    def frames(noise: str = "none", count: int = 30, depth: float = 1.0) -> list[Frame]:
        noisy = dict(enumerate(POSE_NOISES[noise](T, np.random.default_rng(5))))
        chosen = [replace(read(k), T_world_camera=noisy[k]) for k in spread_out(noisy, count)]
        return [replace(frame, depth_m=(frame.depth_m * np.float32(depth)).astype(np.float32)) for frame in chosen]

    return frames
