"""Recordings in the containers and folders of other programs, as `readers` tests make them, for the fuzzer."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1] / "readers"))

import test_azure_kinect
import test_dataset_folders as folders
import test_open3d
import test_phones as phones
import test_realsense_bag
from engine import Target
from made_bags import make_bag
from targets import files_of, read_all


def _recording(make: Callable[[Path], object]) -> Target:
    def write(folder: Path) -> None:
        make(folder / "recording")

    return Target(write, files_of, {"read": lambda folder: read_all(folder)})


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
    "ros1": Target(lambda folder: make_bag(folder / "a.bag", "ros1"), files_of, {"read": read_all}),
}
