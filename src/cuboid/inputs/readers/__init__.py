"""Readers of recordings. Other packages can add formats (entry points ``cuboid.readers``)."""

from __future__ import annotations

from importlib import import_module

from cuboid.inputs.readers.depth_camera import DepthCamera
from cuboid.inputs.readers.locate import open_recording
from cuboid.inputs.readers.reader import READERS, Calibration, FrameEntry, ImageSource, Listing, Reader
from cuboid.inputs.readers.recording import Recording

__all__ = [
    "READERS",
    "Calibration",
    "DepthCamera",
    "FrameEntry",
    "ImageSource",
    "Listing",
    "Reader",
    "Recording",
    "open_recording",
]

# The modules of the formats: each registers its formats.
_FORMATS = (
    *("arkitscenes", "azure_kinect", "bonn", "bop", "datasets", "icl_nuim", "infinitam", "nerfstudio", "open3d"),
    *("plain", "polycam", "realsense_bag", "record3d", "record3d_file", "ros_bag", "scannet_sens", "stray_scanner"),
    *("sun3d", "tum"),
)
for _name in _FORMATS:
    import_module(f"cuboid.inputs.readers.{_name}")
