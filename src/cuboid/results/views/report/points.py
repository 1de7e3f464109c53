"""The point map in a size for a page: thinned, rounded, sorted and packed."""

from __future__ import annotations

import base64
import math
import zlib
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.results import MapPoints

# A laptop without a graphics card still rotates this many points smoothly; packed they take about 3 MB.
MAX_REPORT_POINTS = 400_000

# Points of objects matter most to people: they get up to this fraction of the points of a page.
OBJECTS_FRACTION = 0.5

# A tenth of the voxel size of the finest map: rounding to it is invisible, and the small differences compress well.
STEP_M = 0.001

# Largest coordinate in steps, since coordinates are 16-bit numbers; a larger scene has larger steps.
LARGEST = 65535

# Number of points at which the spacing is measured.
MEASURED_POINTS = 2000

# Spacing of a map with a single point.
DEFAULT_SPACING_M = 0.01

# OpenCV's number of the exact tree of FLANN (FLANN_INDEX_KDTREE_SINGLE).
EXACT_TREE = 4

# The default level of zlib: a higher level saves one percent and takes twice the time.
EFFORT = 6


@dataclass(frozen=True, slots=True)
class PackedPoints:
    """A point map in the binary format of the page.

    Attributes
    ----------
    count, total : int
        Numbers of packed points, and of points of the map.
    low : (3,) float64
        Origin of the coordinates in the world, metres.
    step_m : float
        Length of one step of a coordinate, metres.
    spacing_m : float
        Median distance of a packed point to its nearest neighbour, metres.
    content : bytes
        Deflated (RFC 1950). Columns of differences between consecutive points: low bytes of x, high bytes of x, the
        same for y and z; red, green, blue, heat (0..255); low bytes of the label, high bytes of the label. Differences
        of x, y, z and the label are modulo 2**16, the others modulo 2**8.
    """

    count: int
    total: int
    low: Float64Array
    step_m: float
    spacing_m: float
    content: bytes

    def to_dict(self) -> dict[str, Any]:
        """Return the entry for the points in the document of the page."""
        return {
            "count": self.count,
            "total": self.total,
            "low": [round(float(value), 6) for value in self.low],
            "step_m": self.step_m,
            "spacing_m": round(self.spacing_m, 5),
            "content": base64.b64encode(self.content).decode("ascii"),
        }


def pack_points(points: MapPoints) -> PackedPoints:
    """Return at most `MAX_REPORT_POINTS` points of the map in the binary format of the page.

    They are selected evenly in the order of the map, points of objects more densely.
    """
    kept = thinned(points.label, MAX_REPORT_POINTS)
    low, step_m, cells = stepped(points.xyz[kept])
    order = np.argsort(morton(cells), kind="stable")
    level = np.round(255.0 * np.clip(points.heat[kept], 0.0, 1.0)).astype(np.uint8)
    label = points.label[kept].astype(np.uint16)
    columns = [*_bytes_of(_differences(cells[order])), *_differences(points.rgb[kept][order]).T]
    columns += [_differences(level[order]), *_bytes_of(_differences(label[order])[:, None])]
    content = zlib.compress(b"".join(column.tobytes() for column in columns), EFFORT)
    return PackedPoints(len(kept), len(points.xyz), low, step_m, spacing(points.xyz[kept]), content)


def stepped(xyz: Float32Array) -> tuple[Float64Array, float, npt.NDArray[np.uint16]]:
    """Return points (N, 3) in whole steps (N, 3) from their lowest coordinates (3,), and the step, metres."""
    low = xyz.min(axis=0).astype(np.float64) if len(xyz) else np.zeros(3)
    extent_m = float((xyz - low).max()) if len(xyz) else 0.0
    step_m = max(STEP_M, extent_m / LARGEST)
    return low, step_m, np.round((xyz - low) / step_m).astype(np.uint16)


def thinned(label: npt.NDArray[np.int32], max_points: int) -> npt.NDArray[np.int64]:
    """Return the indices of at most `max_points` points, ascending; points with a label are preferred.

    Parameters
    ----------
    label : (N,) int32
        0 for points without an object.
    max_points : int
    """
    if len(label) <= max_points:
        return np.arange(len(label))
    on_objects, elsewhere = np.flatnonzero(label), np.flatnonzero(label == 0)
    max_on_objects = max(round(max_points * OBJECTS_FRACTION), max_points - len(elsewhere))
    kept = np.concatenate(
        (_evenly(on_objects, max_on_objects), _evenly(elsewhere, max_points - min(len(on_objects), max_on_objects)))
    )
    return np.sort(kept)


def morton(cells: npt.NDArray[np.uint16]) -> npt.NDArray[np.uint64]:
    """Return the position of each cell (N, 3) on the Z-order curve (G. Morton, 1966): neighbours stay close."""
    code = np.zeros(len(cells), np.uint64)
    for axis in range(3):
        spread = cells[:, axis].astype(np.uint64)
        for shift, mask in (
            (16, 0x00FF0000FF0000FF),
            (8, 0xF00F00F00F00F00F),
            (4, 0x30C30C30C30C30C3),
            (2, 0x9249249249249249),
        ):
            spread = (spread | (spread << np.uint64(shift))) & np.uint64(mask)
        code |= spread << np.uint64(axis)
    return code


def spacing(xyz: Float32Array) -> float:
    """Return the median distance, metres, of points (N, 3) to their nearest neighbours."""
    if len(xyz) < 2:
        return DEFAULT_SPACING_M
    probes = np.ascontiguousarray(xyz[:: max(1, len(xyz) // MEASURED_POINTS)])
    tree = cv2.flann.Index(np.ascontiguousarray(xyz), {"algorithm": EXACT_TREE})
    _, squared = tree.knnSearch(probes, 2, params={"checks": -1})
    return math.sqrt(float(np.median(squared[:, 1]))) or DEFAULT_SPACING_M


def _evenly(numbers: npt.NDArray[np.int64], max_count: int) -> npt.NDArray[np.int64]:
    count = min(len(numbers), max_count)
    return numbers[np.arange(count) * len(numbers) // max(count, 1)]


def _differences(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the difference of each row to the previous row, modulo the range of the type."""
    return np.diff(values, axis=0, prepend=np.zeros((1, *values.shape[1:]), values.dtype))


def _bytes_of(columns: npt.NDArray[np.uint16]) -> list[UInt8Array]:
    """Return low and high bytes of each column of (N, C), 2 C arrays (N,)."""
    return [(column >> shift & 0xFF).astype(np.uint8) for column in columns.T for shift in (0, 8)]
