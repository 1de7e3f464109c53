"""The overlap of two oriented boxes: exact, and by the formula of the source paper."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.kernels.overlap import intersections

# Smallest usable volume, a cube with edges of a micrometre: quotients of smaller volumes are inaccurate.
NO_VOLUME_M3 = 1e-18


def pack(boxes: Sequence[Box]) -> Float64Array:
    """Return boxes as rows (N, 15): centre (3), size (3), rotation (9, row by row)."""
    if not boxes:
        return np.empty((0, 15))
    # One concatenation: NumPy takes longer to fill single rows.
    parts = [part for box in boxes for part in (box.center, box.size, box.rotation.ravel())]
    return np.concatenate(parts).reshape(-1, 15).astype(np.float64, copy=False)


def unpack(rows: Float64Array) -> list[Box]:
    """Return the boxes of rows (N, 15)."""
    return [Box(row[:3].copy(), row[3:6].copy(), row[6:].reshape(3, 3).copy()) for row in rows]


def intersection_matrix(a: Float64Array, b: Float64Array) -> Float64Array:
    """Return the volumes (N, M), in cubic metres, that boxes (N, 15) and (M, 15) have in common.

    The volumes are exact for any two orientations. Pairs whose bounding spheres do not touch cost almost no time.
    """
    volumes = np.empty((len(a), len(b)))
    intersections(np.ascontiguousarray(a), np.ascontiguousarray(b), volumes)
    return volumes


def overlaps(a: Float64Array, b: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return IoU and overlap of boxes (N, 15) and (M, 15), each (N, M).

    The IoU is exact, |A n B| / (|A| + |B| - |A n B|). The overlap is the common volume as a fraction of the volume of
    the smaller box: 1 if one box lies in the other. Both are 0 for a box without volume.
    """
    common = intersection_matrix(a, b)
    iou, inside = np.zeros_like(common), np.zeros_like(common)
    i, j = np.nonzero(common)
    if len(i):
        both, mine, theirs = common[i, j], _volumes(a)[i], _volumes(b[j])
        solid = np.minimum(mine, theirs) > NO_VOLUME_M3
        i, j, both, mine, theirs = i[solid], j[solid], both[solid], mine[solid], theirs[solid]
        iou[i, j] = np.minimum(1.0, both / (mine + theirs - both))
        inside[i, j] = np.minimum(1.0, both / np.minimum(mine, theirs))
    return iou, inside


def iou_matrix(a: Float64Array, b: Float64Array) -> Float64Array:
    """Return the exact IoU (N, M) of boxes (N, 15) and (M, 15)."""
    return overlaps(a, b)[0]


def overlap_min_matrix(a: Float64Array, b: Float64Array) -> Float64Array:
    """Return the common volume as a fraction of the volume of the smaller box, (N, M)."""
    return overlaps(a, b)[1]


def paper_iou_matrix(a: Float64Array, b: Float64Array) -> Float64Array:
    """Return the overlap (N, M) by the formula of Pahwa, Ng and Do 2017, with a corrected intersection.

    Both boxes of a pair are treated as aligned with the axes of the first, each with its own size. The value is the
    product of the intersections of their intervals over the product of the unions of their intervals. The paper takes
    the larger of the two end-to-start distances as the intersection; for [0, 2] and [1, 3] that is their union. The
    product of unions is larger than the volume of the union, so that for aligned boxes the value is at most the exact
    IoU.
    """
    result = np.zeros((len(a), len(b)))
    for i, row in enumerate(a):
        apart = np.abs((b[:, :3] - row[:3]) @ row[6:].reshape(3, 3))
        reach = (row[3:6] + b[:, 3:6]) / 2.0
        common = np.clip(reach - apart, 0.0, np.minimum(row[3:6], b[:, 3:6]))
        union = row[3:6] + b[:, 3:6] - common
        whole = union.prod(1)
        result[i] = np.divide(common.prod(1), whole, out=np.zeros(len(b)), where=whole > 0)
    return result


IOU_FORMULAS: dict[str, Callable[[Float64Array, Float64Array], Float64Array]] = {
    "exact": iou_matrix,
    "paper": paper_iou_matrix,
}


def iou(a: Box, b: Box, formula: str = "exact") -> float:
    """Return the IoU of two boxes, 0..1, by a formula of `IOU_FORMULAS`."""
    return float(IOU_FORMULAS[formula](pack([a]), pack([b]))[0, 0])


def _volumes(rows: Float64Array) -> Float64Array:
    return np.asarray(rows[:, 3:6].prod(1))
