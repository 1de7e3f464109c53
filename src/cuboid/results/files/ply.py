"""`map.ply`: the global point map, binary PLY that common viewers open."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, UInt8Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.results import MapPoints
from cuboid.ground.formats.reading import MAX_BINARY_BYTES, read_bytes
from cuboid.ground.geometry.se3 import MAX_FROM_ORIGIN_M

# Little-endian layout of a point, as in the PLY format (G. Turk, 1994).
POINT = np.dtype(
    [
        ("xyz", "<f4", 3),
        ("rgb", "u1", 3),
        ("heat", "<f4"),
        ("label", "<i4"),
    ]
)
PROPERTIES = (
    ("float", "x"),
    ("float", "y"),
    ("float", "z"),
    ("uchar", "red"),
    ("uchar", "green"),
    ("uchar", "blue"),
    ("float", "heat"),
    ("int", "label"),
)


def _header(points: int, properties: Sequence[tuple[str, str]] = PROPERTIES) -> bytes:
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {points}"]
    lines += [f"property {kind} {name}" for kind, name in properties]
    return ("\n".join([*lines, "end_header"]) + "\n").encode("ascii")


def write_map(path: Path, points: MapPoints) -> None:
    """Write `map.ply`.

    Parameters
    ----------
    path : Path
        The file.
    points : MapPoints
        N points in the world, metres.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    rows: npt.NDArray[np.void] = np.zeros(len(points.xyz), dtype=POINT)
    rows["xyz"] = points.xyz
    rows["rgb"] = points.rgb
    rows["heat"] = points.heat
    rows["label"] = points.label
    with path.open("wb") as file:
        file.write(_header(len(rows)))
        file.write(rows.tobytes())


def cloud_ply(xyz: Float32Array, rgb: UInt8Array) -> bytes:
    """Return a binary PLY file of points (N, 3) with colors (N, 3)."""
    rows: npt.NDArray[np.void] = np.zeros(len(xyz), dtype=[("xyz", "<f4", 3), ("rgb", "u1", 3)])
    rows["xyz"], rows["rgb"] = xyz, rgb
    return _header(len(rows), PROPERTIES[:6]) + rows.tobytes()


def read_map(path: Path) -> MapPoints:
    """Read `map.ply` as `write_map` wrote it.

    Raises
    ------
    InputError
        The file is missing, has another layout, is shorter than its header says, or a value is out of its range.
    """
    content = read_bytes(path, MAX_BINARY_BYTES)
    head, mark, body = content.partition(b"end_header\n")
    words = head.split()
    at = words.index(b"vertex") + 1 if b"vertex" in words else len(words)
    count = int(words[at]) if at < len(words) and words[at].isdigit() else -1
    if count < 0 or head + mark != _header(count):
        raise InputError(f"{path}: expected a binary PLY with {', '.join(name for _, name in PROPERTIES)}")
    if len(body) != count * POINT.itemsize:
        raise InputError(f"{path}: expected {count} points, got {len(body) / POINT.itemsize:g}")
    rows = np.frombuffer(body, dtype=POINT)
    _refuse_values(path, rows)
    return MapPoints(
        xyz=rows["xyz"].astype(np.float32),
        rgb=rows["rgb"].copy(),
        heat=rows["heat"].astype(np.float32),
        label=rows["label"].astype(np.int32),
    )


def _refuse_values(path: Path, rows: npt.NDArray[np.void]) -> None:
    """Raise InputError if a point is not finite or too far away, or if its heat or label is out of range."""
    wrong = ~(np.abs(rows["xyz"]) <= MAX_FROM_ORIGIN_M).all(axis=1) | ~((rows["heat"] >= 0) & (rows["heat"] <= 1))
    wrong |= rows["label"] < 0
    if wrong.any():
        k = int(np.flatnonzero(wrong)[0])
        raise InputError(
            f"{path}: point {k}: expected a finite place, heat 0 to 1 and a label of at least 0, got "
            f"{rows['xyz'][k].tolist()}, {rows['heat'][k]:g} and {rows['label'][k]}"
        )
