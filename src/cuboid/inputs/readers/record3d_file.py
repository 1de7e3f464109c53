"""Recordings of the app Record3D: a file .r3d, which is a zip archive, or its unpacked folder.

Expected tree::

    2024-05-01--10-00-00.r3d    <- the recording; or the folder that it was unpacked into
      metadata                  JSON: w, h, dw, dh, K (9 numbers, column by column), poses, frameTimestamps, fps
      rgbd/0.jpg                8-bit color
      rgbd/0.depth              metres, dw x dh 32-bit floats, LZFSE
      rgbd/0.conf               0, 1 or 2 a pixel, LZFSE: depth of 0 is no reading; may be absent

All else is as in the app's export ("EXR + JPG sequence", `record3d`).
"""

from __future__ import annotations

import re
import struct
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cuboid.ground.arrays import Float32Array
from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.core.extras import missing
from cuboid.ground.formats.reading import UnreadableError, names_in, read_bytes
from cuboid.inputs.readers.depth_camera import check_number
from cuboid.inputs.readers.documents import read_object
from cuboid.inputs.readers.images import MAX_PIXELS
from cuboid.inputs.readers.phone import UP_WORLD, phone_cameras
from cuboid.inputs.readers.reader import READERS, Listing, Reader, has_file
from cuboid.inputs.readers.record3d import color_camera, frame_entry

METADATA, FRAMES = "metadata", "rgbd"
FILE = re.compile(r"(\d+)\.(jpg|depth)")
DEPTH_FILE = re.compile(r"\d+\.depth")
MIN_CONFIDENCE = 1
# First four bytes of LZFSE blocks; the unpacked size follows.
_STORED, _LZVN, _FSE, _END = b"bvx-", b"bvxn", b"bvx2", b"bvx$"
_FSE_HEADER = struct.Struct("<4sIQQQ")
_LOW_20 = (1 << 20) - 1


def recognises(path: Path) -> bool:
    """Tell whether the folder, or archive, holds metadata, and rgbd with files N.depth."""
    return (path / METADATA).is_file() and has_file(path / FRAMES, DEPTH_FILE)


def read(path: Path) -> Listing:
    """List the frames; InputError where the metadata have another form or liblzfse is not installed."""
    _require_liblzfse(path)
    metadata = read_object(path / METADATA)
    K, size = color_camera(metadata, str(path / METADATA))
    for name in ("dw", "dh"):
        check_number(name, metadata.get(name), str(path / METADATA))
    depth_size = (int(metadata["dw"]), int(metadata["dh"]))
    if depth_size[0] * depth_size[1] > MAX_PIXELS:
        raise InputError(f"{path / METADATA}: depth of {depth_size[0]}x{depth_size[1]} is no image of a phone")
    files: dict[int, dict[str, Path]] = {}
    for name in names_in(path / FRAMES):
        if match := FILE.fullmatch(name):
            files.setdefault(int(match[1]), {})[match[2]] = path / FRAMES / name
    frames = []
    for number in sorted(files):
        depth = files[number].get("depth")
        source = None if depth is None else partial(_depth, depth, depth_size)
        frames.append(frame_entry(number, metadata, METADATA, files[number].get("jpg"), source, size))
    return Listing(frames, 1.0, phone_cameras(K, size, depth_size, METADATA), (path,), up_world=UP_WORLD)


def _depth(file: Path, size: tuple[int, int]) -> Float32Array:
    """Return depth in metres, 0 where there is no reading or the confidence is low."""
    width, height = size
    depth_m = np.frombuffer(_unpacked(file, 4 * width * height), "<f4").astype(np.float32).reshape(height, width)
    confidence = file.with_suffix(".conf")
    if confidence.is_file():
        sure = np.frombuffer(_unpacked(confidence, width * height), np.uint8).reshape(height, width)
        depth_m = np.where(sure >= MIN_CONFIDENCE, depth_m, np.float32(0))
    return depth_m


def _unpacked(file: Path, size: int) -> bytes:
    """Return the unpacked contents of an LZFSE file; raise FrameError unless they have this size."""
    import liblzfse

    name = f"{FRAMES}/{file.name}"
    try:
        data = read_bytes(file, 2 * size + (1 << 16))
    except UnreadableError as error:
        raise FrameError(f"{name} {error.reason}") from None
    made = packed_size(data)
    if made != size:
        raise FrameError(f"{name} is damaged: it makes {made} bytes of depth or confidence, expected {size}")
    try:
        found: Any = liblzfse.decompress(data)
    except liblzfse.error:
        raise FrameError(f"{name} is damaged: it cannot be unpacked") from None
    if len(found) != size:
        raise FrameError(f"{name} is damaged: it makes {len(found)} bytes, expected {size}")
    return bytes(found)


def packed_size(data: bytes) -> int:
    """Return the unpacked size of LZFSE blocks, from their headers; 0 if they are invalid or do not end.

    It is checked first, because the library allocates as much memory as damaged data claim.
    """
    at = made = 0
    while data[at : at + 4] != _END:
        kind, header = data[at : at + 4], data[at : at + _FSE_HEADER.size].ljust(_FSE_HEADER.size, b"\0")
        _, raw, first, second, third = _FSE_HEADER.unpack(header)
        if kind == _STORED:
            at += 8 + raw
        elif kind == _LZVN:
            at += 12 + (first & 0xFFFFFFFF)
        elif kind == _FSE and third & 0xFFFFFFFF:  # bytes of literals, of matches, and of the header
            at += ((first >> 20) & _LOW_20) + ((second >> 40) & _LOW_20) + (third & 0xFFFFFFFF)
        else:
            return 0
        made += raw
    return made


def _require_liblzfse(path: Path) -> None:
    try:
        import liblzfse  # noqa: F401 - only to tell that it is there
    except ImportError:
        raise InputError(missing(f"{path}: depth packed with LZFSE", "pyliblzfse", "phone")) from None


READERS.register("record3d-file")(Reader("an .r3d file of Record3D", recognises, read, files=(".r3d",)))
