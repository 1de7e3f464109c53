"""Recordings of all formats as targets."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1] / "readers"))

import made_containers
from engine import Target
from made_bags import START_NS, time_of, writing
from made_recordings import CAMERA, color_image, depth_image
from targets import FRAMES, files_of, read_all

from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.frame import Intrinsics
from cuboid.inputs.readers import open_recording
from cuboid.lab.evaluation.timed_poses import read_poses

# Frames of the cameras that are known, whose images have this size.
LARGE = made_containers.Frames(
    Intrinsics(481.2, 480.0, 319.5, 239.5, 640, 480),
    [color_image(k, (480, 640)) for k in range(3)],
    [depth_image(k, 1000, (480, 640)) for k in range(3)],
    [np.eye(4)] * 3,
)


def container(
    write: Callable[[made_containers.Frames, Path], Path],
    frames: made_containers.Frames = FRAMES,
    *,
    has_poses: bool = False,
) -> Target:
    """Return the target of a recording; a file by itself is opened as such."""

    def opened(folder: Path) -> Path:
        (made,) = folder.iterdir()
        inside = list(made.iterdir()) if made.is_dir() else []
        return inside[0] if len(inside) == 1 and inside[0].is_file() else made

    calls: dict[str, Callable[[Path], object]] = {"read": lambda folder: read_all(opened(folder))}
    if has_poses:
        calls["poses"] = lambda folder: read_poses(opened(folder))
    return Target(lambda folder: write(frames, folder / "recording"), files_of, calls)


def _gravity(folder: Path) -> None:
    recording = open_recording(folder)
    for k in range(len(recording)):
        with suppress(FrameError):
            recording.up_camera(k)


def _bag_with_imu(folder: Path) -> None:
    with writing(folder / "a.bag", "bag") as (make, publish):
        publish("/camera/color/camera_info", make.info(CAMERA, "c", START_NS), START_NS)
        for k in range(4):
            t = time_of(k)
            publish("/camera/color/image_raw", make.image(color_image(k), "rgb8", "c", t), t)
            publish("/camera/depth_registered/image_raw", make.image(depth_image(k, 1000), "16UC1", "c", t), t)
            publish("/imu", make.imu("c", t, (0.0, -9.8, 0.1)), t)


# Packages that the making of a target needs, and that need not be installed.
NEEDS = {
    "record3d-file": "liblzfse",
    "ros-bag bag": "rosbags",
    "ros-bag db3": "rosbags",
    "ros-bag mcap": "rosbags",
    "realsense-bag": "rosbags",
    "gravity": "rosbags",
    "stores": "duckdb",
}
PLAIN = partial(made_containers.plain, distortion=[0.01, 0.001, 0.0, 0.0])
WRITERS = made_containers.LOSSLESS | made_containers.LOSSY | {"plain": PLAIN}
# Recordings whose poses are read as a trajectory too.
POSED = ("plain", "tum", "7-scenes", "uw-rgbd-scenes-v2")
CONTAINERS: dict[str, Target] = {
    **{
        name: container(write, LARGE if name == "icl-nuim" else FRAMES, has_poses=name in POSED)
        for name, write in WRITERS.items()
    },
    "bonn": container(made_containers.bonn, LARGE),
    "gravity": Target(_bag_with_imu, files_of, {"up": _gravity}),
}
