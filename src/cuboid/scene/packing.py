"""Arrays as bytes and back, exactly: bit for bit, with the order in memory that sums depend on."""

from __future__ import annotations

import json
import zlib
from typing import Annotated, Any

import cv2
import msgspec
import numpy as np
import numpy.typing as npt
from msgspec import Meta

from cuboid.errors import shown
from cuboid.frame import Float32Array
from cuboid.heatmap.carrying import keys_of
from cuboid.heatmap.voxel_map import CHANGED_ROWS
from cuboid.kernels.voxels import X, Z
from cuboid.scene.door import DamagedError

# Images of at least so many pixels a side are kept as PNG, compressed so far.
SMALLEST_IMAGE, PNG_COMPRESSION = 48, 3
PNG = b"\x89PNG"

# What `form_of` writes, two or three items.
_Form = list[str | tuple[Annotated[int, Meta(ge=0, lt=2**40)], ...]]

AnyArray = npt.NDArray[Any]
Columns = tuple[AnyArray, ...]


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
    dtype, shape, strides = _parts_of(form)
    if strides is None:
        return plain
    size = plain.itemsize + sum((n - 1) * step for n, step in zip(shape, strides, strict=True))
    array: AnyArray = np.ndarray(shape, dtype, np.zeros(size, np.uint8), strides=strides)
    array[...] = plain
    return array


def from_bytes(form: str, data: bytes) -> AnyArray:
    """Return the array of a form and of bytes in C order."""
    dtype, shape, _ = _parts_of(form)
    return from_form(form, np.frombuffer(data, dtype).reshape(shape).copy())


def _parts_of(form: str) -> tuple[np.dtype[Any], tuple[int, ...], tuple[int, ...] | None]:
    """Return type, shape, and strides where there are any; DamagedError where the form tells none of an array."""
    try:
        name, shape, *strides = msgspec.json.decode(form, type=_Form)
        dtype = np.dtype(str(name))
    except (msgspec.DecodeError, UnicodeError, RecursionError, TypeError, ValueError):
        raise DamagedError(f"the form of an array is damaged: {shown(form)}") from None
    sides = [one for one in (shape, *strides) if isinstance(one, tuple) and len(one) == len(shape)]
    if dtype.kind not in "biuf" or len(sides) != 1 + len(strides) or len(strides) > 1:
        raise DamagedError(f"the form of an array is damaged: {shown(form)}")
    return dtype, sides[0], sides[1] if strides else None


def packed(array: AnyArray) -> bytes:
    """Return an array's bytes, the first of each row first, compressed; images as PNG."""
    if array.ndim == 2 and array.dtype in (np.uint8, np.uint16) and min(array.shape) >= SMALLEST_IMAGE:
        done, data = cv2.imencode(".png", array, [cv2.IMWRITE_PNG_COMPRESSION, PNG_COMPRESSION])
        if done:
            return data.tobytes()
    return deflated(_planes(array))


def unpacked(data: bytes, check: int, form: str, what: str) -> AnyArray:
    """Return the array of bytes from `packed`, in C order."""
    dtype, shape, _ = _parts_of(form)
    try:
        if data.startswith(PNG):
            whole = check_sum(data) == check
            image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if whole else None
            if image is None:
                raise DamagedError(f"{what} is damaged: its check sum is wrong")
            return image.reshape(shape).astype(dtype, copy=False)
        return _from_planes(inflated(data, check, what), dtype, shape)
    except ValueError:
        raise DamagedError(f"{what} is damaged: it is not of the form {shown(form)}") from None


def packed_block(columns: Columns, voxel_m: float) -> bytes:
    """Return a block of the map's rows compressed.

    Parameters
    ----------
    columns : tuple of (N, ...) arrays
        As `VoxelMap.rows_in` gives them: keys first, then values. A key is told by its point but for rounding, and
        kept as what is off from that.
    voxel_m : float
    """
    keys, values, *rest = columns
    off = keys - keys_of(_points(values), voxel_m)
    return deflated(b"".join(_planes(column) for column in (off, values, *rest)))


def unpacked_block(data: bytes, check: int, rows: int, forms: Columns, voxel_m: float, what: str) -> Columns:
    """Return the columns of bytes from `packed_block`.

    Parameters
    ----------
    data : bytes
    check : int
        Their check sum.
    rows : int
        Of the block.
    forms : tuple of arrays
        Columns of any length, of the same types and widths.
    voxel_m : float
    what : str
        Name of the block in messages.
    """
    plain, columns, at = inflated(data, check, what), [], 0
    for form in forms:
        size = rows * int(np.prod(form.shape[1:])) * form.itemsize
        if at + size > len(plain) or not 0 < rows <= CHANGED_ROWS:
            raise DamagedError(f"{what} is damaged: {len(plain)} bytes are not {rows} rows")
        columns.append(_from_planes(plain[at : at + size], form.dtype, (rows, *form.shape[1:])))
        at += size
    keys, values = columns[:2]
    return (keys + keys_of(_points(values), voxel_m), *columns[1:])


def _points(values: Float32Array) -> npt.NDArray[np.float64]:
    return np.nan_to_num(values[:, X : Z + 1].astype(np.float64))


def _planes(array: AnyArray) -> bytes:
    """Return the bytes of an array's rows: all first ones, then all second ones; numbers alike have runs there."""
    if array.size == 0:
        return b""
    rows = np.ascontiguousarray(array).reshape(len(array) if array.ndim else 1, -1).view(np.uint8)
    return np.ascontiguousarray(rows.T).tobytes()


def _from_planes(data: bytes, dtype: np.dtype[Any], shape: tuple[int, ...]) -> AnyArray:
    if not data:
        return np.zeros(shape, dtype)
    rows = np.frombuffer(data, np.uint8).reshape(-1, shape[0] if shape else 1)
    return np.ascontiguousarray(rows.T).view(dtype).reshape(shape)
