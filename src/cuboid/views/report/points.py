"""The point map, made small enough for a page: thinned, rounded, put in order, packed."""

from __future__ import annotations

import base64
import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from cuboid.core.frame import Float32Array, Float64Array, UInt8Array
from cuboid.core.results import MapPoints

# A laptop without a graphics card still turns this many points smoothly; packed they are about 3 MB.
MAX_POINTS = 400_000

# Points of objects are what people look at: they keep up to this fraction of the page's points.
OBJECTS_FRACTION = 0.5

# A tenth of the finest map's voxel: no eye sees it, and differences of so small numbers pack well.
STEP_M = 0.001

# Coordinates are 16-bit numbers of steps; a larger scene has larger steps.
LARGEST = 65535

# The spacing of points is measured at this many of them.
MEASURED_POINTS = 2000

# Spacing of a map with one point only.
DEFAULT_SPACING_M = 0.01

# zlib's own default: more saves one percent and takes twice the time.
EFFORT = 6


@dataclass(frozen=True, slots=True)
class PackedPoints:
    """A point map as the page reads it.

    Attributes
    ----------
    count, total : int
        Points packed, and points of the map.
    low : (3,) float64
        World, metres; coordinates count from here.
    step_m : float
        Metres of one step of a coordinate.
    spacing_m : float
        Median distance of a packed point to the nearest other, metres.
    content : bytes
        Deflated (RFC 1950). Per column the differences from point to point, modulo 2**8: low bytes of x, high
        bytes of x (differences modulo 2**16), y and z likewise, red, green, blue, heat (0..255), low bytes
        of the label, high bytes.
    """

    count: int
    total: int
    low: Float64Array
    step_m: float
    spacing_m: float
    content: bytes

    def to_dict(self) -> dict[str, Any]:
        """Return what the page's document says of the points."""
        return {
            "count": self.count,
            "total": self.total,
            "low": [round(float(value), 6) for value in self.low],
            "step_m": self.step_m,
            "spacing_m": round(self.spacing_m, 5),
            "content": base64.b64encode(self.content).decode("ascii"),
        }


def pack_points(points: MapPoints, most: int = MAX_POINTS) -> PackedPoints:
    """Return the map as the page reads it.

    Parameters
    ----------
    points : MapPoints
        N points in the world, metres.
    most : int
        At most this many are packed, taken evenly in the map's order, those of objects more densely.

    Returns
    -------
    PackedPoints
    """
    kept = thinned(points.label, most)
    xyz = points.xyz[kept].astype(np.float64)
    low = xyz.min(axis=0) if len(xyz) else np.zeros(3)
    extent_m = float((xyz - low).max()) if len(xyz) else 0.0
    step_m = max(STEP_M, extent_m / LARGEST)
    cells = np.round((xyz - low) / step_m).astype(np.uint16)
    order = np.argsort(morton(cells), kind="stable")
    level = np.round(255.0 * np.clip(points.heat[kept], 0.0, 1.0)).astype(np.uint8)
    label = points.label[kept].astype(np.uint16)
    columns = [*_bytes_of(_differences(cells[order])), *_differences(points.rgb[kept][order]).T]
    columns += [_differences(level[order]), *_bytes_of(_differences(label[order])[:, None])]
    content = zlib.compress(b"".join(column.tobytes() for column in columns), EFFORT)
    return PackedPoints(len(kept), len(points.xyz), low, step_m, spacing(points.xyz[kept]), content)


def thinned(label: npt.NDArray[np.int32], most: int) -> npt.NDArray[np.int64]:
    """Return the numbers of at most `most` points, ascending; those with a label are favoured.

    Parameters
    ----------
    label : (N,) int32
        0 for points of no object.
    most : int
    """
    if len(label) <= most:
        return np.arange(len(label))
    own, other = np.flatnonzero(label), np.flatnonzero(label == 0)
    fraction = max(round(most * OBJECTS_FRACTION), most - len(other))
    kept = np.concatenate((_evenly(own, fraction), _evenly(other, most - min(len(own), fraction))))
    return np.sort(kept)


def morton(cells: npt.NDArray[np.uint16]) -> npt.NDArray[np.uint64]:
    """Return the place of each cell (N, 3) on the Z-order curve (G. Morton, 1966): neighbours stay close."""
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
    """Return the median distance in metres of points (N, 3) to their nearest neighbours."""
    if len(xyz) < 2:
        return DEFAULT_SPACING_M
    probes = xyz[:: max(1, len(xyz) // MEASURED_POINTS)]
    tree = cKDTree(xyz, balanced_tree=False, compact_nodes=False)  # both cost more than they save here
    nearest = np.asarray(tree.query(probes, k=2)[0])
    return float(np.median(nearest[:, 1])) or DEFAULT_SPACING_M


def _evenly(numbers: npt.NDArray[np.int64], most: int) -> npt.NDArray[np.int64]:
    count = min(len(numbers), most)
    return numbers[np.arange(count) * len(numbers) // max(count, 1)]


def _differences(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return what each row adds to the one before it, modulo the type's range."""
    return np.diff(values, axis=0, prepend=np.zeros((1, *values.shape[1:]), values.dtype))


def _bytes_of(columns: npt.NDArray[np.uint16]) -> list[UInt8Array]:
    """Return low and high bytes of each column of (N, C), 2 C arrays (N,)."""
    return [(column >> shift & 0xFF).astype(np.uint8) for column in columns.T for shift in (0, 8)]
