"""Hot loop: exact intersection volumes of oriented boxes.

The surface of A n B consists of the parts of A's faces inside B and of B's faces inside A. By the divergence theorem
its volume is a third of the sum, over these polygons, of area times distance of the plane from any fixed point.
Coincident faces are counted once: the faces of A are clipped to the closed B, the faces of B to the open A.
"""

from __future__ import annotations

import numpy as np

from cuboid.ground.compiling.compiled import kernel

# Two planes with a smaller distance than this coincide, metres.
COINCIDE_M = 1e-10
MAX_CORNERS = 16

# Boxes are searched in batches of this many, and a batch is skipped if its bounds are too far away: most successive
# boxes lie near each other. Allowance for rounding errors in that test, metres.
BATCH = 64
SLACK_M = 1e-6


@kernel(inline="always")
def clip(polygon, count, axis, bound, sign, out):
    """Clip a polygon (K, 3) to sign * x[axis] <= bound; return the number of corners left."""
    left = 0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        a, b = sign * polygon[i, axis] - bound, sign * polygon[j, axis] - bound
        if a <= 0.0:
            out[left, 0], out[left, 1], out[left, 2] = polygon[i, 0], polygon[i, 1], polygon[i, 2]
            left += 1
        if (a <= 0.0) != (b <= 0.0):
            t = a / (a - b)
            for k in range(3):
                out[left, k] = polygon[i, k] + t * (polygon[j, k] - polygon[i, k])
            left += 1
    return left


@kernel
def faces_within(center, R, size, other, slack, origin, first, second):
    """Sum area times distance from a point over the faces of a box, clipped to another box.

    Parameters
    ----------
    center : (3,) float64
    R : (3, 3) float64
        Axes as columns; both in the frame of the other box, which lies at zero.
    size, other : (3,) float64
        Sizes of this box and of the other one.
    slack : float
        Added to the other box's half sizes, metres.
    origin : (3,) float64
        Reference point of the distances, in the frame of the other box.
    first, second : (MAX_CORNERS, 3) float64, scratch

    Returns
    -------
    float
        Three times the contribution of this box's faces to the volume.
    """
    total = 0.0
    for axis in range(3):
        a, b = (axis + 1) % 3, (axis + 2) % 3
        for side in (-1.0, 1.0):
            for corner in range(4):
                sa = -0.5 if corner == 0 or corner == 3 else 0.5
                sb = -0.5 if corner < 2 else 0.5
                for k in range(3):
                    first[corner, k] = (
                        center[k]
                        + side * 0.5 * size[axis] * R[k, axis]
                        + sa * size[a] * R[k, a]
                        + sb * size[b] * R[k, b]
                    )
            count = 4
            for k in range(3):
                count = clip(first, count, k, 0.5 * other[k] + slack, 1.0, second)
                count = clip(second, count, k, 0.5 * other[k] + slack, -1.0, first)
            if count < 3:
                continue
            nx = ny = nz = 0.0
            for i in range(1, count - 1):
                ux, uy, uz = first[i, 0] - first[0, 0], first[i, 1] - first[0, 1], first[i, 2] - first[0, 2]
                vx, vy, vz = (
                    first[i + 1, 0] - first[0, 0],
                    first[i + 1, 1] - first[0, 1],
                    first[i + 1, 2] - first[0, 2],
                )
                nx += uy * vz - uz * vy
                ny += uz * vx - ux * vz
                nz += ux * vy - uy * vx
            area = 0.5 * np.sqrt(nx * nx + ny * ny + nz * nz)
            distance = 0.0
            for k in range(3):
                distance += side * R[k, axis] * (first[0, k] - origin[k])
            total += area * distance
    return total


@kernel
def intersections(A, B, out):
    """Write the volumes of A[i] n B[j].

    Parameters
    ----------
    A, B : (N, 15), (M, 15) float64
        Centre, size, rotation row by row; axes right- or left-handed.
    out : (N, M) float64, output
        Cubic metres.
    """
    first, second = np.empty((MAX_CORNERS, 3)), np.empty((MAX_CORNERS, 3))
    R, R_back = np.empty((3, 3)), np.empty((3, 3))
    center, center_back, zero = np.empty(3), np.empty(3), np.zeros(3)
    radius = np.empty(B.shape[0])
    for j in range(B.shape[0]):
        radius[j] = 0.5 * np.sqrt(B[j, 3] ** 2 + B[j, 4] ** 2 + B[j, 5] ** 2)
    for i in range(A.shape[0]):
        mine = 0.5 * np.sqrt(A[i, 3] ** 2 + A[i, 4] ** 2 + A[i, 5] ** 2)
        for j in range(B.shape[0]):
            out[i, j] = 0.0
            dx, dy, dz = A[i, 0] - B[j, 0], A[i, 1] - B[j, 1], A[i, 2] - B[j, 2]
            reach = mine + radius[j]
            if not dx * dx + dy * dy + dz * dz < reach * reach:
                continue
            for k in range(3):
                center[k] = B[j, 6 + k] * dx + B[j, 9 + k] * dy + B[j, 12 + k] * dz
                center_back[k] = -(A[i, 6 + k] * dx + A[i, 9 + k] * dy + A[i, 12 + k] * dz)
                for m in range(3):
                    R[k, m] = B[j, 6 + k] * A[i, 6 + m] + B[j, 9 + k] * A[i, 9 + m] + B[j, 12 + k] * A[i, 12 + m]
                    R_back[m, k] = R[k, m]
            # Both sums are taken about the centre of B.
            volume = faces_within(center, R, A[i, 3:6], B[j, 3:6], COINCIDE_M, zero, first, second)
            volume += faces_within(center_back, R_back, B[j, 3:6], A[i, 3:6], -COINCIDE_M, center_back, first, second)
            out[i, j] = max(0.0, volume / 3.0)


@kernel
def bound(boxes, batch, bounds):
    """Write the bounds of the boxes of a batch: smallest and largest centre, largest radius of a bounding sphere.

    Parameters
    ----------
    boxes : (N, 15) float64
        See `intersections`; a row of NaN is ignored.
    batch : int
        Index of the batch; its rows begin at `batch` times `BATCH`.
    bounds : (M, 7) float64, output
        Row `batch` is written.
    """
    row = bounds[batch]
    row[:3], row[3:6], row[6] = np.inf, -np.inf, 0.0
    for k in range(batch * BATCH, min((batch + 1) * BATCH, boxes.shape[0])):
        if not np.isnan(boxes[k, 0]):
            for c in range(3):
                row[c], row[3 + c] = min(row[c], boxes[k, c]), max(row[3 + c], boxes[k, c])
            long, wide, high = boxes[k, 3], boxes[k, 4], boxes[k, 5]
            row[6] = max(row[6], 0.5 * np.sqrt(long * long + wide * wide + high * high))


@kernel
def near(boxes, bounds, center, radius, gap, found):
    """Find the boxes whose bounding spheres come near another sphere.

    Parameters
    ----------
    boxes : (N, 15) float64
        See `intersections`; a row of NaN is never found.
    bounds : (M, 7) float64
        See `bound`.
    center : (3,) float64
    radius : float
        Radius of that sphere, metres.
    gap : float
        Largest gap between two spheres that are near, metres.
    found : (N,) int64, output
        Rows, ascending.

    Returns
    -------
    int
        Number of boxes found.
    """
    n, rows = 0, boxes.shape[0]
    for batch in range((rows + BATCH - 1) // BATCH):
        away = 0.0
        for c in range(3):
            off = max(bounds[batch, c] - center[c], center[c] - bounds[batch, 3 + c], 0.0)
            away += off * off
        if not (np.sqrt(away) <= bounds[batch, 6] + radius + gap + SLACK_M):
            continue
        for k in range(batch * BATCH, min((batch + 1) * BATCH, rows)):
            x, y, z = boxes[k, 0] - center[0], boxes[k, 1] - center[1], boxes[k, 2] - center[2]
            long, wide, high = boxes[k, 3], boxes[k, 4], boxes[k, 5]
            reach = 0.5 * np.sqrt(long * long + wide * wide + high * high) + radius + gap
            if np.sqrt(x * x + y * y + z * z) <= reach:
                found[n] = k
                n += 1
    return n
