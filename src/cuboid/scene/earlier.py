"""The map of a scene that was written before it lay in cubes: read to be written anew."""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cuboid.heatmap.voxel_map import VoxelMap
from cuboid.kernels.cubes import KEY_BITS, KEY_OFFSET, LEVELS, PLACES, ROW, cubes_of
from cuboid.kernels.voxels import MAX_HITS
from cuboid.scene.packing import from_planes, inflated
from cuboid.scene.validation import DamagedError, Row, iterate_table

Rows = npt.NDArray[np.void]
Keys = npt.NDArray[np.int64]

# Columns of the rows as they were: type, numbers a row.
_COLUMNS = {
    "key": (np.int64, 1), "values": (np.float32, 8), "hits": (np.int32, 1), "passes": (np.int32, 1),
    "owner": (np.int32, 1), "confidence": (np.uint8, 1), "anchor": (np.int32, 1), "last_frame": (np.int32, 1),
}  # fmt: skip


def take_earlier(connection: sqlite3.Connection, voxels: VoxelMap) -> bool:
    """Have the map of an earlier version's file, and tell whether there is one.

    Raises
    ------
    DamagedError
        A block of it is.
    """
    blocks = []
    for place, row in enumerate(iterate_table(connection, "earlier_blocks")):
        if row[0] != place:
            raise DamagedError(f"the map is damaged: block {row[0]} is there, expected block {place}")
        blocks.append(earlier_block(row, voxels.voxel_m))
    if blocks:
        refill(voxels, blocks)
    return bool(blocks)


def refill(voxels: VoxelMap, blocks: Sequence[tuple[Rows, Keys]]) -> None:
    """Have these rows, in cubes of these keys, and no others; of a voxel that comes twice, the first."""
    rows, keys = (np.concatenate(some) for some in zip((np.zeros(0, ROW), np.zeros(0, np.int64)), *blocks, strict=True))
    _, first = np.unique(np.column_stack([keys, rows["voxel"]]), axis=0, return_index=True)
    voxels.refill(keys[np.sort(first)], rows[np.sort(first)])


def earlier_block(row: Row, voxel_m: float) -> tuple[Rows, Keys]:
    """Return the living rows of a row of `earlier_blocks` and the keys of their cubes; raises DamagedError."""
    number, count, _, check, data = row
    what = f"block {number} of the map"
    plain, at, columns = inflated(data, check, what), 0, {}
    for name, (kind, width) in _COLUMNS.items():
        size = count * width * np.dtype(kind).itemsize
        if at + size > len(plain):
            raise DamagedError(f"{what} is damaged: {len(plain)} bytes are not {count} rows")
        shape = (count, width) if width > 1 else (count,)
        columns[name], at = from_planes(plain[at : at + size], np.dtype(kind), shape), at + size
    values = columns["values"].astype(np.float64)
    alive = values[:, 7] > 0
    place = np.floor(np.nan_to_num(values[:, :3]) / voxel_m)
    keys = place.astype(np.int64) + KEY_OFFSET
    told = columns["key"] + ((keys[:, 0] << (2 * KEY_BITS)) | (keys[:, 1] << KEY_BITS) | keys[:, 2])
    mask = (1 << KEY_BITS) - 1
    voxel = np.stack([told >> (2 * KEY_BITS), (told >> KEY_BITS) & mask, told & mask], 1) - KEY_OFFSET
    rows = np.zeros(count, ROW)
    rows["place"] = np.clip((values[:, :3] / voxel_m - voxel) * PLACES, 0, PLACES - 1)
    rows["color"], rows["heat"] = np.clip(values[:, 3:6] * LEVELS, 0, 65535), np.clip(values[:, 6] * 65535, 0, 65535)
    rows["weight"] = values[:, 7]
    for name in ("hits", "passes", "anchor"):
        rows[name] = np.clip(columns[name], 0, MAX_HITS)
    for name in ("owner", "confidence", "last_frame"):
        rows[name] = columns[name]
    cubes, rows["voxel"] = cubes_of(voxel)
    return rows[alive], cubes[alive]
