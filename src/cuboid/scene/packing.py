"""Arrays as bytes and back, exactly: bit for bit, with the order in memory that sums depend on."""

from __future__ import annotations

import json
import zlib
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from cuboid.errors import InputError
from cuboid.kernels.cubes import BLOCK_ROWS, ROW

# Images of at least so many pixels a side are kept as PNG, compressed so far.
SMALLEST_IMAGE, PNG_COMPRESSION = 48, 3
PNG = b"\x89PNG"

AnyArray = npt.NDArray[Any]


class DamagedError(InputError):
    """Bytes of a scene file are not what was written."""


def deflated(data: bytes) -> bytes:
    """Return bytes compressed: runs and frequent bytes, which is what sorted bytes of numbers have."""
    packer = zlib.compressobj(1, zlib.DEFLATED, zlib.MAX_WBITS, 9, zlib.Z_RLE)
    return packer.compress(data) + packer.flush()


def inflated(data: bytes, check_sum: int, what: str) -> bytes:
    """Return what was compressed.

    Raises
    ------
    DamagedError
        The bytes are not those that were written.
    """
    if zlib.crc32(data) != check_sum:
        raise DamagedError(f"{what} is damaged: its check sum is wrong")
    try:
        return zlib.decompress(data)
    except zlib.error as error:
        raise DamagedError(f"{what} is damaged: {error}") from None


def check_sum(data: bytes) -> int:
    """Return the check sum that stands beside bytes in the file: their CRC-32."""
    return zlib.crc32(data)


def form_of(array: AnyArray) -> str:
    """Return what an array is besides its bytes: type, shape, and strides where its items do not lie in order."""
    form: list[Any] = [array.dtype.str, list(array.shape)]
    if not array.flags.c_contiguous:
        form.append(list(array.strides))
    return json.dumps(form)


def from_form(form: str, plain: AnyArray) -> AnyArray:
    """Return an array of a form with the items of another one; they lie in memory as they did."""
    dtype, shape, *strides = json.loads(form)
    if not strides:
        return plain
    steps = tuple(strides[0])
    size = plain.itemsize + sum((n - 1) * step for n, step in zip(shape, steps, strict=True))
    array: AnyArray = np.ndarray(tuple(shape), np.dtype(dtype), np.zeros(size, np.uint8), strides=steps)
    array[...] = plain
    return array


def from_bytes(form: str, data: bytes) -> AnyArray:
    """Return the array of a form and of bytes in C order."""
    dtype, shape, *_ = json.loads(form)
    return from_form(form, np.frombuffer(data, np.dtype(dtype)).reshape(shape).copy())


def packed(array: AnyArray) -> bytes:
    """Return an array's bytes, the first of each row first, compressed; images as PNG."""
    if array.ndim == 2 and array.dtype in (np.uint8, np.uint16) and min(array.shape) >= SMALLEST_IMAGE:
        done, data = cv2.imencode(".png", array, [cv2.IMWRITE_PNG_COMPRESSION, PNG_COMPRESSION])
        if done:
            return data.tobytes()
    return deflated(_planes(array))


def unpacked(data: bytes, check: int, form: str, what: str) -> AnyArray:
    """Return the array of bytes from `packed`, in C order."""
    dtype, shape, *_ = json.loads(form)
    if data.startswith(PNG):
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if check_sum(data) == check else None
        if image is None:
            raise DamagedError(f"{what} is damaged: its check sum is wrong")
        return image.reshape(shape).astype(dtype, copy=False)
    return from_planes(inflated(data, check, what), np.dtype(dtype), tuple(shape))


def packed_block(rows: AnyArray) -> bytes:
    """Return rows of the map (N,) compressed; as they are where that is no shorter."""
    data = deflated(_planes(rows))
    return data if len(data) < rows.nbytes else rows.tobytes()


def unpacked_block(data: bytes, check: int, rows: int, what: str) -> AnyArray:
    """Return the rows (N,) of bytes from `packed_block`, or as they are.

    Parameters
    ----------
    data : bytes
    check : int
        Their check sum.
    rows : int
        How many these are.
    what : str
        Name of the block in messages.
    """
    size = rows * ROW.itemsize
    if len(data) == size:
        if check_sum(data) != check:
            raise DamagedError(f"{what} is damaged: its check sum is wrong")
        return np.frombuffer(data, ROW)
    plain = inflated(data, check, what)
    if len(plain) != size or not 0 < rows <= BLOCK_ROWS:
        raise DamagedError(f"{what} is damaged: {len(plain)} bytes are not {rows} rows")
    return from_planes(plain, ROW, (rows,))


def _planes(array: AnyArray) -> bytes:
    """Return the bytes of an array's rows: all first ones, then all second ones; numbers alike have runs there."""
    if array.size == 0:
        return b""
    rows = np.ascontiguousarray(array).reshape(len(array) if array.ndim else 1, -1).view(np.uint8)
    return np.ascontiguousarray(rows.T).tobytes()


def from_planes(data: bytes, dtype: np.dtype[Any], shape: tuple[int, ...]) -> AnyArray:
    """Return the array whose rows' first bytes come first, then all second ones, and so on."""
    if not data:
        return np.zeros(shape, dtype)
    rows = np.frombuffer(data, np.uint8).reshape(-1, shape[0] if shape else 1)
    return np.ascontiguousarray(rows.T).view(dtype).reshape(shape)
