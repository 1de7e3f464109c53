"""Exports of the app Polycam for the iPhone, its "raw data".

Expected tree::

    scan/                              <- the recording; or its keyframes/
      keyframes/
        images/12345678.jpg            8-bit color
        depth/12345678.png             16-bit, 256x192, millimetres
        confidence/12345678.png        0 is low: no reading; may be absent
        cameras/12345678.json          fx, fy, cx, cy, width, height, t_00 ... t_23 (camera to world) [, timestamp]
        corrected_cameras/...          the same after optimisation, and corrected_images/; used if present

The files use ARKit's camera axes (x right, y up, z back), which are converted to x right, y down, z forward. The focal
length changes slightly with the focus; the median is used, and frames far from it are skipped.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from cuboid.ground.arrays import Float64Array, UInt8Array
from cuboid.ground.core.errors import FrameError, InputError
from cuboid.inputs.readers.depth_camera import check_number
from cuboid.inputs.readers.documents import read_object
from cuboid.inputs.readers.image_folder import images_in
from cuboid.inputs.readers.images import decode_color
from cuboid.inputs.readers.phone import (
    SAME_FOCAL,
    T_OPENGL_OPENCV,
    UP_WORLD,
    confident_depth,
    depth_size_of,
    phone_cameras,
    shrink_factor,
    shrunk,
)
from cuboid.inputs.readers.posetext import pose_from_matrix
from cuboid.inputs.readers.reader import READERS, FrameEntry, Listing, Reader

DEPTH_UNITS_PER_METRE = 1000.0
KEYFRAMES = "keyframes"
_CAMERA = ("fx", "fy", "cx", "cy", "width", "height")


def recognises(path: Path) -> bool:
    """Tell whether the folder, or its keyframes/, holds images, depth and cameras."""
    return all((_keyframes(path) / name).is_dir() for name in ("images", "depth", "cameras"))


def _keyframes(path: Path) -> Path:
    return path / KEYFRAMES if (path / KEYFRAMES).is_dir() else path


def read(path: Path) -> Listing:
    """List the frames; raise InputError if no camera can be read."""
    folder = _keyframes(path)
    corrected = "corrected_" if (folder / "corrected_cameras").is_dir() else ""
    colors = {file.stem: file for file in images_in(folder / f"{corrected}images")}
    depths = {file.stem: file for file in images_in(folder / "depth")}
    names = sorted(colors.keys() | depths.keys(), key=lambda name: (len(name), name))
    cameras, faults = _cameras(folder / f"{corrected}cameras", names)
    K = {name: float(np.median([one[name] for one in cameras.values()])) for name in _CAMERA}
    size = (int(K["width"]), int(K["height"]))
    for name, one in cameras.items():
        if abs(one["fx"] / K["fx"] - 1) > SAME_FOCAL or (one["width"], one["height"]) != size:
            faults[name] = f"the camera of {name} differs from the others: fx {one['fx']:.0f}, median {K['fx']:.0f}"
    depth_size = depth_size_of((depths[name] for name in sorted(depths)), folder)
    factor, numbers = shrink_factor(size), (K["fx"], K["fy"], K["cx"], K["cy"])
    frames = [
        FrameEntry(
            color=partial(_color, colors[name], factor) if name in colors else None,
            depth=partial(confident_depth, depths[name], folder / "confidence" / f"{name}.png", 1)
            if name in depths
            else None,
            timestamp_s=cameras[name]["timestamp"] if name in cameras and "timestamp" in cameras[name] else None,
            pose=partial(_pose, cameras.get(name, {}), name, faults.get(name, "")),
            fault=faults.get(name),
        )
        for name in names
    ]
    calibration = phone_cameras(numbers, size, depth_size, "cameras/")
    return Listing(frames, DEPTH_UNITS_PER_METRE, calibration, up_world=UP_WORLD)


def _cameras(folder: Path, names: list[str]) -> tuple[dict[str, dict[str, float]], dict[str, str]]:
    """Return the frames' cameras, and the reasons of missing ones; raise InputError if there are none."""
    cameras: dict[str, dict[str, float]] = {}
    faults: dict[str, str] = {}
    for name in names:
        try:
            cameras[name] = _camera(folder / f"{name}.json")
        except InputError as error:
            faults[name] = str(error)
    if not cameras:
        first = next(iter(faults.values()), "there are no images")
        raise InputError(f"{folder}: no camera of a frame can be read; {first}")
    return cameras, faults


def _camera(path: Path) -> dict[str, float]:
    """Return the numbers of one camera; raise InputError if one is missing."""
    document = read_object(path)
    for name in _CAMERA:
        check_number(name, document.get(name), str(path))
    transform = [f"t_{row}{column}" for row in range(3) for column in range(4)]
    for name in transform:
        check_number("cx", document.get(name), str(path), f"{name}, as ")  # any finite number
    times = ["timestamp"] if isinstance(document.get("timestamp"), (int, float)) else []
    return {name: float(document[name]) for name in (*_CAMERA, *transform, *times)}


def _color(file: Path, factor: int) -> UInt8Array:
    return shrunk(decode_color(file, f"images/{file.name}"), factor)


def _pose(camera: dict[str, float], name: str, fault: str) -> Float64Array:
    if not camera:
        raise FrameError(fault)
    rows = [[camera[f"t_{row}{column}"] for column in range(4)] for row in range(3)]
    return pose_from_matrix([*rows, [0.0, 0.0, 0.0, 1.0]], f"cameras/{name}.json") @ T_OPENGL_OPENCV


READERS.register("polycam")(Reader("keyframes/ with images/, depth/, cameras/", recognises, read))
