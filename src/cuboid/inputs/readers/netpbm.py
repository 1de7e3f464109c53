"""Binary Netpbm images: grey (PGM, 8 or 16 bits) and color (PPM, 8 bits)."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cuboid.ground.core.errors import FrameError
from cuboid.inputs.readers.images import MAX_PIXELS, image_bytes

CHANNELS = {b"P5": 1, b"P6": 3}
# Blanks and comments separate the words of the header; one blank follows the last word.
_BLANK = rb"(?:\s|#[^\n]*\n)+"
HEADER = re.compile(rb"(P[56])" + _BLANK + rb"(\d{1,9})" + _BLANK + rb"(\d{1,9})" + _BLANK + rb"(\d{1,5})\s")
# Maximum length of a header with comments.
MAX_HEADER_BYTES = 4096


def read_netpbm(path: Path, name: str) -> npt.NDArray[Any]:
    """Return the image of a file: (H, W) of uint8 or uint16, or (H, W, 3) uint8 RGB.

    Parameters
    ----------
    path : Path
    name : str
        The image's name in messages.

    Raises
    ------
    FrameError
        If the file is missing, too large, no such image, or cut short.
    """
    return parse_netpbm(image_bytes(path, name), name)


def parse_netpbm(data: bytes, name: str) -> npt.NDArray[Any]:
    """Return the image in the bytes of a file; raises as `read_netpbm` does."""
    header = HEADER.match(data[:MAX_HEADER_BYTES])
    if header is None:
        raise FrameError(f"{name} is neither a binary PGM nor a PPM ({len(data)} bytes)")
    channels, width, height, largest = CHANNELS[header[1]], *(int(header[k]) for k in (2, 3, 4))
    if not 0 < width * height <= MAX_PIXELS or not 0 < largest < 1 << 16:
        raise FrameError(f"{name} is {width}x{height} up to {largest}, no image of a camera")
    kind = np.dtype(">u2" if largest > 255 else "u1")  # big-endian
    expected = width * height * channels * kind.itemsize
    if len(data) - header.end() < expected:
        raise FrameError(f"{name} is truncated ({len(data)} bytes, expected {header.end() + expected})")
    pixels = np.frombuffer(data, kind, width * height * channels, header.end()).astype(kind.newbyteorder("="))
    return pixels.reshape((height, width) if channels == 1 else (height, width, channels))
