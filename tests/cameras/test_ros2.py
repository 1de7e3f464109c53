"""A camera node of ROS 2 and the driver, as two processes that find each other by DDS."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from played import color_image, depth_image

pytest.importorskip("cyclonedds", reason="DDS is not installed: pip install '.[ros2]'")
pytest.importorskip("rosbags", reason="messages are read with rosbags: pip install '.[ros2]'")

import cuboid
from cuboid.ground.core.errors import InputError

HERE = Path(__file__).resolve().parent


@pytest.fixture
def domain() -> int:
    """A domain of DDS that other runs of these tests are not in."""
    return 20 + os.getpid() % 200


@contextmanager
def publisher(domain: int, kind: str = "aligned") -> Iterator[None]:
    node = subprocess.Popen([sys.executable, str(HERE / "publisher.py"), str(domain), kind])
    try:
        yield
    finally:
        node.kill()
        node.wait()


def test_frames_of_another_process_arrive_with_their_depth(domain: int) -> None:
    with publisher(domain), cuboid.open_camera(f"ros2:domain={domain}") as camera:
        assert camera.name == "ROS 2 /cam/color/image_raw"
        frames = list(islice(camera, 4))
    assert (camera.intrinsics.fx, camera.intrinsics.cy, camera.depth_units_per_metre) == (64.0, 24.0, 1000.0)
    for frame in frames:
        k = round((frame.timestamp_s - 100.0) / 0.05) % 200
        np.testing.assert_array_equal(frame.color, color_image(k))
        np.testing.assert_allclose(frame.depth_m, depth_image(k) / 1000.0, atol=1e-6)


@pytest.mark.parametrize(
    ("kind", "options", "part"),
    [
        ("unaligned", "", "/cam/aligned_depth_to_color/image_raw is 32x24, color 64x48: depth must be aligned"),
        ("aligned", ",color=/other", "nobody publishes images on '/other' .color.; there are: /cam/aligned_depth"),
    ],
)
def test_what_does_not_fit_is_one_line(domain: int, kind: str, options: str, part: str) -> None:
    with publisher(domain + 1, kind), pytest.raises(InputError, match=part):
        cuboid.open_camera(f"ros2:domain={domain + 1}{options}")


@pytest.mark.parametrize(
    ("spec", "part"), [("domain=x", "domain must be a whole number"), ("domain=9999", "cannot be")]
)
def test_a_wrong_domain_is_one_line(spec: str, part: str) -> None:
    with pytest.raises(InputError, match=part):
        cuboid.open_camera(f"ros2:{spec}")
