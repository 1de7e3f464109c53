"""Recordings of k4arecorder, of an Azure Kinect or an Orbbec Femto: a Matroska file.

Expected: an ``.mkv`` file with the tracks COLOR (MJPEG, NV12, YUY2 or BGRA) and DEPTH (16-bit, big-endian, millimetres)
and the attachment ``calibration.json``; other tracks and attachments are ignored.

Depth is registered to color with the two cameras of the attachment. The cameras of a mode (which part of the sensor it
shows) are those of the Azure Kinect Sensor SDK.
"""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import UInt8Array
from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.geometry import se3
from cuboid.inputs.readers.depth_camera import DepthCamera
from cuboid.inputs.readers.images import COLOR_FLAGS, decode_bytes, head_of, image_span
from cuboid.inputs.readers.matroska import MAGIC, Block, Matroska, Track, list_matroska
from cuboid.inputs.readers.posetext import pose_from_matrix
from cuboid.inputs.readers.reader import READERS, Calibration, FrameEntry, Listing, Reader
from cuboid.inputs.readers.tum import associate

DEPTH_UNITS_PER_METRE = 1000.0
CALIBRATION = "calibration.json"
MAX_CALIBRATION_BYTES = 1 << 20
# Both cameras are triggered together; a recording may shift one of them by up to half the time between two images.
WITHIN_S = 0.02
# The calibration refers to the whole sensor: width and height of the sensor in each mode, and column and row at which
# the mode's image begins.
DEPTH_MODES = {
    (320, 288): (512, 512, 96, 90),
    (640, 576): (1024, 1024, 192, 180),
    (512, 512): (512, 512, 0, 0),
    (1024, 1024): (1024, 1024, 0, 0),
}
COLOR_MODES = {
    (1280, 720): (1280, 960, 0, 120),
    (1920, 1080): (1920, 1440, 0, 180),
    (2560, 1440): (2560, 1920, 0, 240),
    (3840, 2160): (3840, 2880, 0, 360),
    (2048, 1536): (2048, 1536, 0, 0),
    (4096, 3072): (4096, 3072, 0, 0),
}
PURPOSES = {"color": "CALIBRATION_CameraPurposePhotoVideo", "depth": "CALIBRATION_CameraPurposeDepth"}
# FOURCC codes other than MJPEG: bytes per pixel, and OpenCV's conversion to RGB.
RAW_COLOR = {
    b"NV12": (1.5, cv2.COLOR_YUV2RGB_NV12),
    b"YUY2": (2.0, cv2.COLOR_YUV2RGB_YUYV),
    b"BGRA": (4.0, cv2.COLOR_BGRA2RGB),
}


def recognises(path: Path) -> bool:
    """Tell whether this is a Matroska file with the tracks of a Kinect."""
    head = head_of(path, 1 << 16) if path.suffix.lower() == ".mkv" else b""
    return (head.startswith(MAGIC) and b"K4A_DEPTH_MODE" in head) or (b"DEPTH" in head and b"COLOR" in head)


def read(path: Path) -> Listing:
    """List the frames; raise InputError if color, depth or the calibration is missing."""
    try:
        found = list_matroska(path)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read: {error}") from None
    tracks = {track.name: track for track in found.tracks.values()}
    for name in ("COLOR", "DEPTH"):
        if name not in tracks or not found.blocks.get(tracks[name].number):
            raise InputError(f"{path}: holds no {name.lower()} images; both color and depth must have been recorded")
    color, depth = tracks["COLOR"], tracks["DEPTH"]
    calibration = _calibration(path, found, (color.width, color.height), (depth.width, depth.height))
    return Listing(_entries(path, found, color, depth), DEPTH_UNITS_PER_METRE, calibration)


def _entries(path: Path, found: Matroska, color: Track, depth: Track) -> list[FrameEntry]:
    colors, depths = found.blocks[color.number], found.blocks[depth.number]
    times_s = [block.time_ns * 1e-9 for block in colors]
    steps = np.diff(times_s)
    within_s = max(WITHIN_S, float(np.median(steps)) / 2 if len(steps) else WITHIN_S)
    pairs = associate(times_s, [block.time_ns * 1e-9 for block in depths], within_s)
    fault = f"color without depth: none within {1000 * within_s:.0f} ms"
    return [
        FrameEntry(
            color=partial(_color, path, block, color),
            depth=partial(_depth, path, depths[pairs[k]], depth) if k in pairs else None,
            timestamp_s=times_s[k],
            fault=None if k in pairs else f"{fault} of the color image at {times_s[k]:.3f} s",
        )
        for k, block in enumerate(colors)
    ]


def _color(path: Path, block: Block, track: Track) -> UInt8Array:
    data, what = _data(path, block, "color")
    code = _code(track)
    if code not in RAW_COLOR:
        return np.asarray(decode_bytes(data, what, COLOR_FLAGS), np.uint8)
    each, conversion = RAW_COLOR[code]
    if len(data) < each * track.width * track.height:
        raise FrameError(f"{what} is cut short ({len(data)} bytes)")
    pixels = np.frombuffer(data, np.uint8, int(each * track.width * track.height))
    rows = track.height * 3 // 2 if code == b"NV12" else track.height
    image = pixels.reshape((rows, track.width) if code == b"NV12" else (rows, track.width, -1))
    return np.asarray(cv2.cvtColor(image, conversion), np.uint8)


def _depth(path: Path, block: Block, track: Track) -> npt.NDArray[np.uint16]:
    data, what = _data(path, block, "depth")
    if len(data) != 2 * track.width * track.height:
        raise FrameError(f"{what} has {len(data)} bytes, expected {track.width}x{track.height} of 16 bits")
    return np.frombuffer(data, ">u2").astype(np.uint16).reshape(track.height, track.width)


def _data(path: Path, block: Block, what: str) -> tuple[bytes, str]:
    """Return the bytes of a block and its name in messages."""
    name = f"{what} image at {block.time_ns * 1e-9:.3f} s"
    return image_span(path, block.offset, block.length, name), name


def _code(track: Track) -> bytes:
    """Return the FOURCC of a track, at byte 16 of its Windows header (BITMAPINFOHEADER)."""
    return track.private[16:20] if track.codec == "V_MS/VFW/FOURCC" and len(track.private) >= 20 else b""


def _calibration(path: Path, found: Matroska, color: tuple[int, int], depth: tuple[int, int]) -> Calibration:
    name = next((name for name in found.attachments if name.lower().endswith(CALIBRATION)), None)
    if name is None:
        raise InputError(f"{path}: has no attachment {CALIBRATION}: it was not written by k4arecorder, or is cut short")
    offset, length = found.attachments[name]
    try:
        document: Any = json.loads(image_span(path, offset, min(length, MAX_CALIBRATION_BYTES), name).rstrip(b"\0"))
        cameras = {camera["Purpose"]: camera for camera in document["CalibrationInformation"]["Cameras"]}
        color_K, color_D, T_color = _camera(cameras[PURPOSES["color"]], COLOR_MODES, color)
        depth_K, depth_D, T_depth = _camera(cameras[PURPOSES["depth"]], DEPTH_MODES, depth)
    except (ValueError, KeyError, TypeError, IndexError, FrameError) as error:
        raise InputError(f"{path}: its {CALIBRATION} cannot be used: {type(error).__name__}: {error}") from None
    camera = DepthCamera(*depth_K, depth, T_color @ np.linalg.inv(T_depth), depth_D)
    return Calibration(*color_K, color, f"{CALIBRATION} in the file", color_D, camera)


def _camera(
    camera: dict[str, Any], modes: dict[tuple[int, int], tuple[int, int, int, int]], size: tuple[int, int]
) -> tuple[tuple[float, float, float, float], tuple[float, ...], npt.NDArray[np.float64]]:
    """Return fx, fy, cx, cy in pixels of a mode, the distortion in OpenCV's order, and T_camera_device."""
    if size not in modes:
        raise ValueError(f"no mode has images of {size[0]}x{size[1]}")
    width, height, left, top = modes[size]
    parameters = [float(value) for value in camera["Intrinsics"]["ModelParameters"][:14]]
    if not np.isfinite(parameters).all() or len(parameters) < 14:
        raise ValueError("a camera has no 14 finite parameters")
    cx, cy, fx, fy, k1, k2, k3, k4, k5, k6, _, _, p2, p1 = parameters  # fractions of the whole sensor
    K = (fx * width, fy * height, cx * width - left - 0.5, cy * height - top - 0.5)
    matrix = se3.assembled(np.reshape(camera["Rt"]["Rotation"], (3, 3)), camera["Rt"]["Translation"])
    return K, (k1, k2, p1, p2, k3, k4, k5, k6), pose_from_matrix(matrix, CALIBRATION)


READERS.register("azure-kinect")(Reader("an .mkv of k4arecorder", recognises, read, files=(".mkv",)))
