"""Exact conversion between arrays and bytes, bit for bit; it keeps the memory order, which changes float sums."""

from __future__ import annotations

import json
import math
import zlib
from functools import lru_cache
from typing import Annotated, Any, NamedTuple

import cv2
import msgspec
import numpy as np
import numpy.typing as npt
from msgspec import Meta

from cuboid.ground.core.errors import shown
from cuboid.ground.core.limits import MAX_SCENE_VALUE_BYTES
from cuboid.method.heatmap.kernels.cubes import BLOCK_ROWS, ROW
from cuboid.runs.scene.validation import DamagedError

# Minimum side, pixels, of images that are stored as PNG; compression level of these.
SMALLEST_IMAGE, PNG_COMPRESSION = 48, 3
PNG = b"\x89PNG"

# The two or three items of a form from `form_of`.
_Form = list[str | tuple[Annotated[int, Meta(ge=0, lt=2**40)], ...]]

AnyArray = npt.NDArray[Any]


def deflated(data: bytes) -> bytes:
    """Return compressed bytes: the coder uses runs and frequent bytes, as in sorted bytes of numbers."""
    packer = zlib.compressobj(1, zlib.DEFLATED, zlib.MAX_WBITS, 9, zlib.Z_RLE)
    return packer.compress(data) + packer.flush()


def inflated(
    data: bytes, check: int, subject: str, numbers: tuple[int, ...] = (), size: int = MAX_SCENE_VALUE_BYTES
) -> bytes:
    """Return decompressed bytes, after comparing the check sum of the bytes and of the numbers stored with them.

    Raises
    ------
    DamagedError
        The bytes are not those that were written, or more than `size` when decompressed.
    """
    if check_sum(data, numbers) != check:
        raise DamagedError(f"{subject} is damaged: its check sum is wrong")
    try:
        decoder = zlib.decompressobj()
        plain = decoder.decompress(data, size + 1)
        if len(plain) > size:
            raise DamagedError(f"{subject} is damaged: more than {size} bytes")
        if not decoder.eof:
            raise DamagedError(f"{subject} is damaged: its end is missing")
        return plain
    except zlib.error as error:
        raise DamagedError(f"{subject} is damaged: {error}") from None


def check_sum(data: bytes, numbers: tuple[int, ...] = ()) -> int:
    """Return the check sum of bytes in the file: the CRC-32 of the bytes and of the numbers stored with them."""
    return zlib.crc32(np.array(numbers, "<i8").tobytes(), zlib.crc32(data))


def form_of(array: AnyArray) -> str:
    """Return the form of an array: type, shape, and strides if its items are not in C order."""
    return _form(array.dtype.str, array.shape, None if array.flags.c_contiguous else array.strides)


@lru_cache(10_000)
def _form(dtype: str, shape: tuple[int, ...], strides: tuple[int, ...] | None) -> str:
    return json.dumps([dtype, shape] if strides is None else [dtype, shape, strides])


def from_form(form: str, plain: AnyArray) -> AnyArray:
    """Return an array of the given form, memory order included, with the items of another array."""
    dtype, shape, strides = _parts_of(form)
    if strides is None:
        return plain
    size = plain.itemsize + sum((n - 1) * step for n, step in zip(shape, strides, strict=True))
    if size > MAX_SCENE_VALUE_BYTES:
        raise DamagedError(f"the form of an array is damaged: {shown(form)}")
    array: AnyArray = np.ndarray(shape, dtype, np.zeros(size, np.uint8), strides=strides)
    array[...] = plain
    return array


def from_bytes(form: str, data: bytes) -> AnyArray:
    """Return the array of a form and of bytes in C order."""
    dtype, shape, _ = _parts_of(form)
    return from_form(form, np.frombuffer(data, dtype).reshape(shape).copy())


@lru_cache(10_000)
def _parts_of(form: str) -> tuple[np.dtype[Any], tuple[int, ...], tuple[int, ...] | None]:
    """Return type, shape, and strides (or None) of a form; raise DamagedError if the form is invalid."""
    try:
        name, shape, *strides = msgspec.json.decode(form, type=_Form)
        dtype = np.dtype(str(name))
    except (msgspec.DecodeError, UnicodeError, RecursionError, TypeError, ValueError):
        raise DamagedError(f"the form of an array is damaged: {shown(form)}") from None
    sides = [item for item in (shape, *strides) if isinstance(item, tuple) and len(item) == len(shape)]
    if dtype.kind not in "biuf" or len(sides) != 1 + len(strides) or len(strides) > 1:
        raise DamagedError(f"the form of an array is damaged: {shown(form)}")
    return dtype, sides[0], sides[1] if strides else None


def packed(array: AnyArray) -> bytes:
    """Return an array's bytes, compressed in planes (see `_planes`); images as PNG."""
    if array.ndim == 2 and array.dtype in (np.uint8, np.uint16) and min(array.shape) >= SMALLEST_IMAGE:
        success, data = cv2.imencode(".png", array, [cv2.IMWRITE_PNG_COMPRESSION, PNG_COMPRESSION])
        if success:
            return data.tobytes()
    return deflated(_planes(array))


def unpacked(data: bytes, check: int, form: str, subject: str) -> AnyArray:
    """Return the array of bytes from `packed`, in C order."""
    dtype, shape, _ = _parts_of(form)
    try:
        if data.startswith(PNG):
            is_whole = check_sum(data) == check
            is_sound = is_whole and _png_shape(data) == shape
            image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if is_sound else None
            if image is None:
                fault = f"it is not of the form {shown(form)}" if is_whole else "its check sum is wrong"
                raise DamagedError(f"{subject} is damaged: {fault}")
            return image.reshape(shape).astype(dtype, copy=False)
        size = math.prod(shape) * dtype.itemsize
        return from_planes(inflated(data, check, subject, size=min(size, MAX_SCENE_VALUE_BYTES)), dtype, shape)
    except ValueError:
        raise DamagedError(f"{subject} is damaged: it is not of the form {shown(form)}") from None


def _png_shape(data: bytes) -> tuple[int, int]:
    """Return height and width from the header of a PNG, without decoding it."""
    return int.from_bytes(data[20:24], "big"), int.from_bytes(data[16:20], "big")


def packed_block(rows: AnyArray) -> bytes:
    """Return rows of the map (N,) compressed, or uncompressed if that is not longer."""
    data = deflated(_planes(rows))
    return data if len(data) < rows.nbytes else rows.tobytes()


class BlockRow(NamedTuple):
    """The columns of a map block other than its bytes, in order."""

    number: int
    cube: int
    visit: int
    rows: int
    living: int


def unpacked_block(row: BlockRow, check: int, data: bytes) -> AnyArray:
    """Return the rows (N,) from compressed bytes of `packed_block`, or from uncompressed bytes.

    Parameters
    ----------
    row : BlockRow
    check : int
        Check sum of the bytes and of the row's numbers.
    data : bytes

    Raises
    ------
    DamagedError
        The bytes or the numbers are not those that were written.
    """
    rows, subject = row.rows, f"block {row.number} of the map"
    size = rows * ROW.itemsize
    if len(data) == size:
        if check_sum(data, row) != check:
            raise DamagedError(f"{subject} is damaged: its check sum is wrong")
        return np.frombuffer(data, ROW)
    plain = inflated(data, check, subject, row, BLOCK_ROWS * ROW.itemsize)
    if len(plain) != size or not 0 < rows <= BLOCK_ROWS:
        raise DamagedError(f"{subject} is damaged: {len(plain)} bytes are not {rows} rows")
    return from_planes(plain, ROW, (rows,))


def _planes(array: AnyArray) -> bytes:
    """Return the bytes in planes: the first bytes of all rows, then the second ones; this gives long runs."""
    if array.size == 0:
        return b""
    rows = np.ascontiguousarray(array).reshape(len(array) if array.ndim else 1, -1).view(np.uint8)
    return np.ascontiguousarray(rows.T).tobytes()


def from_planes(data: bytes, dtype: np.dtype[Any], shape: tuple[int, ...]) -> AnyArray:
    """Return the array of bytes from `_planes`."""
    if not data:
        return np.zeros(shape, dtype)
    rows = np.frombuffer(data, np.uint8).reshape(-1, shape[0] if shape else 1)
    return np.ascontiguousarray(rows.T).view(dtype).reshape(shape)
