"""Scans of ScanNet in one file (Dai et al., CVPR 2017; its SensReader defines the format).

Expected: a ``.sens`` file of version 4: the header with both cameras, then for each frame its pose (camera to world),
two times in microseconds, and its color (JPEG or PNG) and depth (zlib or raw, 16-bit).

Color and depth are of one place and of two cameras' images: depth is registered to color.
"""

from __future__ import annotations

import os
import struct
import zlib
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array, UInt8Array
from cuboid.ground.core.errors import FrameError, InputError
from cuboid.inputs.readers.depth_camera import DepthCamera
from cuboid.inputs.readers.images import COLOR_FLAGS, decode_bytes, head_of, image_span
from cuboid.inputs.readers.posetext import pose_from_matrix
from cuboid.inputs.readers.reader import READERS, Calibration, FrameEntry, Listing, Reader

SENS_VERSION = 4
# The sensor's name is no longer than this.
MAX_NAME_BYTES = 1 << 12
_MATRICES = struct.Struct("<64f")  # intrinsics and extrinsics of color, then of depth, 4x4 each
_FORMS = struct.Struct("<iiIIIIfQ")  # both compressions, both sizes, units of depth a metre, number of frames
_FRAME = struct.Struct("<16fQQQQ")  # pose, both times, both lengths
RAW, ZLIB = 0, 1
IMAGE_FILES = (1, 2)  # color as PNG, as JPEG


def recognises(path: Path) -> bool:
    """Tell whether this is a .sens file of the known version."""
    return path.suffix == ".sens" and head_of(path, 4) == struct.pack("<I", SENS_VERSION)


def read(path: Path) -> Listing:
    """List the frames by their lengths; a file that was cut short has those that are whole."""
    try:
        with path.open("rb") as file:
            return _listing(path, file)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from None
    except struct.error:
        raise InputError(f"{path}: ends within its header") from None


def _listing(path: Path, file: BinaryIO) -> Listing:
    end = path.stat().st_size
    _, name_bytes = struct.unpack("<IQ", file.read(12))
    if name_bytes > MAX_NAME_BYTES:
        raise InputError(f"{path}: is damaged: the sensor's name has {name_bytes} bytes")
    file.seek(name_bytes, os.SEEK_CUR)
    matrices = np.array(_MATRICES.unpack(file.read(_MATRICES.size))).reshape(4, 4, 4)
    color_form, depth_form, *sizes, units, count = _FORMS.unpack(file.read(_FORMS.size))
    size, depth_size = (sizes[0], sizes[1]), (sizes[2], sizes[3])
    if color_form not in IMAGE_FILES or depth_form not in (RAW, ZLIB):
        raise InputError(f"{path}: color is stored as {color_form}, depth as {depth_form}; expected 1 or 2, and 0 or 1")
    if not (np.isfinite(units) and units > 0):
        raise InputError(f"{path}: is damaged: depth has {units} units a metre")
    heads: list[tuple[int, Any]] = []
    while len(heads) < count:
        data = file.read(_FRAME.size)
        if len(data) < _FRAME.size:
            break
        head = _FRAME.unpack(data)
        at = file.tell()
        if at + head[18] + head[19] > end:
            break
        heads.append((at, head))
        file.seek(at + head[18] + head[19])
    if not heads:
        raise InputError(f"{path}: holds no whole frame")
    times = np.array([head[16] for _, head in heads], np.float64) * 1e-6
    has_times = len(times) > 1 and bool((np.diff(times) > 0).all())
    frames = [
        FrameEntry(
            color=partial(_color, path, k, at, head[18]),
            depth=partial(_depth, path, k, at + head[18], head[19], depth_size, depth_form),
            timestamp_s=float(times[k]) if has_times else None,
            pose=partial(_pose, head[:16], k),
        )
        for k, (at, head) in enumerate(heads)
    ]
    return Listing(frames, float(units), _calibration(path, matrices, size, depth_size), (path.parent,))


def _calibration(path: Path, matrices: Float64Array, size: tuple[int, int], depth_size: tuple[int, int]) -> Calibration:
    K, D = matrices[0], matrices[2]
    cameras = [tuple(float(one[r, c]) for r, c in ((0, 0), (1, 1), (0, 2), (1, 2))) for one in (K, D)]
    if not np.isfinite(cameras).all() or min(cameras[0][:2] + cameras[1][:2]) <= 0:
        raise InputError(f"{path}: is damaged: its cameras have no focal length above 0")
    (fx, fy, cx, cy), (dfx, dfy, dcx, dcy) = cameras
    camera = DepthCamera(dfx, dfy, dcx, dcy, depth_size, np.eye(4))
    return Calibration(fx, fy, cx, cy, size, "the file's header", depth_camera=camera)


def _color(path: Path, k: int, offset: int, length: int) -> UInt8Array:
    name = f"color image of frame {k}"
    return np.asarray(decode_bytes(image_span(path, offset, length, name), name, COLOR_FLAGS), np.uint8)


def _depth(path: Path, k: int, offset: int, length: int, size: tuple[int, int], form: int) -> npt.NDArray[np.uint16]:
    name, expected = f"depth image of frame {k}", 2 * size[0] * size[1]
    data = image_span(path, offset, length, name)
    if form == ZLIB:
        try:
            data = zlib.decompressobj().decompress(data, expected)
        except zlib.error as error:
            raise FrameError(f"{name} cannot be decoded: {error}") from None
    if len(data) != expected:
        raise FrameError(f"{name} has {len(data)} bytes, expected {size[0]}x{size[1]} of 16 bits")
    return np.frombuffer(data, "<u2").astype(np.uint16).reshape(size[1], size[0])


def _pose(values: tuple[float, ...], k: int) -> Float64Array:
    return pose_from_matrix(np.array(values, np.float64).reshape(4, 4), f"frame {k}")


READERS.register("scannet-sens")(Reader("a .sens file of ScanNet", recognises, read, files=(".sens",)))
