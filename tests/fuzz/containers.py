"""Recordings in the containers and folders of other programs, as `readers` tests make them, for the fuzzer."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1] / "readers"))

import made_containers
import numpy as np
import test_azure_kinect
import test_benchmark_folders as benchmarks
import test_dataset_folders as folders
import test_open3d
import test_phones as phones
import test_realsense_bag
from engine import Target
from made_bags import START_NS, make_bag, time_of, writing
from made_recordings import CAMERA, color_image, depth_image
from targets import files_of, read_all

from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.frame import Intrinsics
from cuboid.inputs.readers import open_recording


def _recording(make: Callable[[Path], object]) -> Target:
    def write(folder: Path) -> None:
        make(folder / "recording")

    return Target(write, files_of, {"read": lambda folder: read_all(folder)})


FRAMES = made_containers.Frames(
    Intrinsics(**CAMERA),  # type: ignore[arg-type]
    [color_image(k) for k in range(4)],
    [depth_image(k, 1000) for k in range(4)],
    [np.eye(4)] * 4,
)


def _written(name: str) -> Target:
    write = (made_containers.LOSSLESS | made_containers.LOSSY)[name]

    def make(folder: Path) -> None:
        made = write(FRAMES, folder / "made")
        if name in ("plain zip", "plain tar"):
            shutil.rmtree(folder / "made" / "scan")
        del made

    def read(folder: Path) -> None:
        read_all(next((folder / "made").glob("*.zip"), next((folder / "made").glob("*.tar"), folder)))

    return Target(make, files_of, {"read": read})


def _in_small(make: Callable[[Path], object], name: str) -> Target:
    """A benchmark in the layout that its own test makes."""
    return Target(lambda folder: make(folder / name), files_of, {"read": read_all})


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
    "ros1": "rosbags",
    "mcap": "rosbags",
    "db3": "rosbags",
    "realsense": "rosbags",
    "gravity": "rosbags",
    "stores": "duckdb",
}

CONTAINERS: dict[str, Target] = {
    "replica": Target(folders.make_replica, files_of, {"read": read_all}),
    "scannet": _recording(folders.make_scannet),
    "sens": Target(lambda folder: folders.make_sens(folder / "scene.sens"), files_of, {"read": read_all}),
    "bop": _recording(folders.make_bop),
    "nerfstudio": _recording(folders.make_nerf),
    "open3d": _recording(test_open3d.make),
    "stray-scanner": _recording(phones.make_stray),
    "polycam": _recording(phones.make_polycam),
    "azure-kinect": Target(lambda folder: test_azure_kinect.make(folder / "k.mkv"), files_of, {"read": read_all}),
    "realsense": Target(lambda folder: test_realsense_bag.make_sdk_bag(folder / "d.bag"), files_of, {"read": read_all}),
    "ros1": Target(lambda folder: make_bag(folder / "a.bag", "bag"), files_of, {"read": read_all}),
    "icl-nuim": _in_small(benchmarks.make_icl, "icl"),
    "bonn": _in_small(benchmarks.make_bonn, "rgbd_bonn_x"),
    "sun3d": _in_small(benchmarks.make_sun3d, "scene"),
    "3rscan": _in_small(benchmarks.make_3rscan, "scan"),
    "arkitscenes": _in_small(benchmarks.make_arkitscenes, "41048190"),
    "infinitam": _in_small(benchmarks.make_infinitam, "teddy"),
    "record3d": _written("record3d"),
    "record3d-file": _written("record3d-file"),
    "zip": _written("plain zip"),
    "tar": _written("plain tar"),
    "mcap": _written("ros-bag mcap"),
    "db3": _written("ros-bag db3"),
    "gravity": Target(_bag_with_imu, files_of, {"up": _gravity}),
}
