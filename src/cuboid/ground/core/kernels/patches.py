"""Hot loops that find the large planes of a depth image and mark their pixels; `segments` explains the use of 1/z."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cuboid.ground.compiling.compiled import kernel
from cuboid.ground.core.kernels.cells import AREA, CX, CY, CZ, NX, NY, NZ, RMS
from cuboid.ground.core.kernels.segments import FAR, NONE, PLANE, SURFACE
from cuboid.ground.core.kernels.sorting import stable_order
from cuboid.ground.core.tolerances import SIGMAS

# Fewest cells that define a plane to which other cells can be joined.
MIN_PLANE_CELLS = 9
# The normals of a cell and of its plane differ by at most 25 degrees (cosine).
MIN_NORMAL_COS = 0.9


@kernel
def grow_planes(cells, shape, camera, noise, bias, flat, least_area, planes, member):
    """Join the flat cells of a frame to its large planes.

    Parameters
    ----------
    cells : (R * C, 8) float64
        From `fit_cells`.
    shape : (int, int)
        R, C.
    camera : (4,) float64
        fx, fy, cx, cy.
    noise : float
        Standard deviation of 1/z, 1/metre.
    bias : float
        Systematic error of depth along a plane, metres at 1 m; grows with z squared.
    flat : float
        A cell is flat below this rms of 1/z, 1/metre.
    least_area : float
        Smallest area of a large plane, square metres.
    planes : (P, 3) float64, output
        a, b, c of each plane: 1/z = a u + b v + c at pixel (u, v).
    member : (R, C) int16, output
        Index of the plane of each cell, -1: none.

    Returns
    -------
    int
        Number of planes.
    """
    rows, columns = shape
    member[:] = -1
    tried = np.zeros((rows, columns), np.int32)
    queue = np.empty(rows * columns, np.int32)
    order = stable_order(cells[:, RMS])
    count = 0
    attempt = 0
    for seed in order:
        if count == planes.shape[0]:
            break
        if cells[seed, AREA] <= 0.0 or cells[seed, RMS] > flat:
            continue
        if member[seed // columns, seed % columns] >= 0 or tried[seed // columns, seed % columns] != 0:
            continue
        attempt += 1
        tail, area, a, b, c = grow(seed, attempt, cells, camera, 2.0 * noise + bias, flat, member, tried, queue)
        if area < least_area or tail < MIN_PLANE_CELLS:
            continue
        for i in range(tail):
            member[queue[i] // columns, queue[i] % columns] = count
        planes[count, 0], planes[count, 1], planes[count, 2] = a, b, c
        count += 1
    return count


@kernel
def grow(seed, attempt, cells, camera, off, flat, member, tried, queue):
    """Grow a plane from a seed cell by joining neighbouring cells that lie on it; see `grow_planes`.

    Parameters
    ----------
    seed : int
    attempt : int
        Number of this attempt; written to `tried` (R, C) int32 for each joined cell.
    off : float
        Largest deviation of a joined cell from the plane in 1/z, 1/metre.
    queue : (R * C,) int32, output
        Its first `count` entries are the joined cells.

    Returns
    -------
    count : int
        Number of joined cells.
    area : float
        Square metres.
    a, b, c : float
        1/z = a u + b v + c.
    """
    rows, columns = member.shape
    head, tail, fitted, area = 0, 1, 1, 0.0
    queue[0] = seed
    tried[seed // columns, seed % columns] = attempt
    # Normal equations of 1/z = a u + b v + c over the cells' centres.
    m = np.zeros(9)
    a, b, c = cell_plane(cells[seed], camera)
    while head < tail:
        cell = queue[head]
        head += 1
        u, v, w = seen_at(cells[cell], camera)
        area += cells[cell, AREA]
        m[0], m[1], m[2], m[3], m[4] = m[0] + u * u, m[1] + u * v, m[2] + u, m[3] + v * v, m[4] + v
        m[5], m[6], m[7], m[8] = m[5] + 1.0, m[6] + u * w, m[7] + v * w, m[8] + w
        if head >= MIN_PLANE_CELLS and head >= 1.5 * fitted:
            fitted = head
            a, b, c = solve3(m, a, b, c)
        nx, ny, nz = plane_normal(a, b, c, camera)
        for k in range(4):
            r, q = cell // columns + (k == 0) - (k == 1), cell % columns + (k == 2) - (k == 3)
            if r < 0 or q < 0 or r >= rows or q >= columns or member[r, q] >= 0 or tried[r, q] == attempt:
                continue
            neighbour = cells[r * columns + q]
            if neighbour[AREA] <= 0.0 or neighbour[RMS] > flat:
                continue
            u, v, w = seen_at(neighbour, camera)
            if (
                abs(a * u + b * v + c - w) > off
                or nx * neighbour[NX] + ny * neighbour[NY] + nz * neighbour[NZ] < MIN_NORMAL_COS
            ):
                continue
            tried[r, q] = attempt
            queue[tail] = r * columns + q
            tail += 1
    a, b, c = solve3(m, a, b, c)
    return tail, area, a, b, c


@kernel(inline="always")
def seen_at(cell, camera):
    """Return the column and row of a cell's centre in the image, pixels, and its 1/z."""
    w = 1.0 / cell[CZ]
    return cell[CX] * w * camera[0] + camera[2], cell[CY] * w * camera[1] + camera[3], w


@kernel(inline="always")
def cell_plane(cell, camera):
    """Return a, b, c of 1/z = a u + b v + c of a cell: n.p = n.center, divided by z and by n.center."""
    d = cell[NX] * cell[CX] + cell[NY] * cell[CY] + cell[NZ] * cell[CZ]
    a, b = cell[NX] / (d * camera[0]), cell[NY] / (d * camera[1])
    return a, b, cell[NZ] / d - a * camera[2] - b * camera[3]


@kernel(inline="always")
def plane_normal(a, b, c, camera):
    """Return the unit normal, towards the camera, of the plane 1/z = a u + b v + c."""
    nx, ny, nz = a * camera[0], b * camera[1], a * camera[2] + b * camera[3] + c
    norm = -np.sqrt(nx * nx + ny * ny + nz * nz)
    return nx / norm, ny / norm, nz / norm


@kernel
def solve3(m, a, b, c):
    """Solve the normal equations of a plane by Cramer's rule on centred sums.

    `m` holds the sums uu, uv, u, vv, v, 1, uw, vw, w. Returns the given a, b, c if the cells do not define a plane.
    """
    n = m[5]
    mu, mv, mw = m[2] / n, m[4] / n, m[8] / n
    uu, uv, vv = m[0] / n - mu * mu, m[1] / n - mu * mv, m[3] / n - mv * mv
    uw, vw = m[6] / n - mu * mw, m[7] / n - mv * mw
    det = uu * vv - uv * uv
    if det <= 1e-3:
        return a, b, c
    a, b = (uw * vv - vw * uv) / det, (vw * uu - uw * uv) / det
    return a, b, mw - a * mu - b * mv


class Grown(NamedTuple):
    """The large planes that `grow_planes` found.

    Attributes
    ----------
    cells : (R * C, CELL_COLUMNS) float64
    planes : (P, 3) float64
    found : int
        Number of valid rows in `planes`.
    member : (R, C) int16
        Index of the plane of each cell, -1: none.
    """

    cells: npt.NDArray[np.float64]
    planes: npt.NDArray[np.float64]
    found: int
    member: npt.NDArray[np.int16]


@kernel(error_model="numpy")
def classify(depth, grown, camera, size, reach, noise, floor, bias, max_depth, inverse, kind, on):
    """Classify pixels as large plane, other surface, far, or without a reading.

    A plane extends `reach` cells beyond its own cells. Within this area a reading belongs to the plane if its distance
    at right angles is below max(floor, bias + 3 standard deviations). The plane is bent locally to follow the
    deviations of its cells (lens, baseline).

    Parameters
    ----------
    depth : (H, W) float32
        Metres, 0 none.
    grown : Grown
    camera, size
        See `grow_planes`.
    reach : int
        Cells.
    noise : float
        Standard deviation of 1/z, 1/metre.
    floor, bias, max_depth : float
        Metres.
    inverse : (H, W) float32, output
        1/z, 0 none.
    kind : (H, W) uint8, output
        NONE, PLANE, SURFACE, or FAR beyond `max_depth`.
    on : (H, W) int8, output
        Index of the plane of each pixel, -1: none.
    """
    cells, planes, count, member = grown
    height, width = depth.shape
    rows, columns = member.shape
    normals = np.empty((count, 3))
    for p in range(count):
        normals[p, 0], normals[p, 1], normals[p, 2] = plane_normal(planes[p, 0], planes[p, 1], planes[p, 2], camera)
    # Deviation of each cell from its plane in 1/z.
    off = np.empty((rows, columns))
    for r in range(rows):
        for q in range(columns):
            p = member[r, q]
            if p >= 0:
                cell = cells[r * columns + q]
                u, v, w = seen_at(cell, camera)
                off[r, q] = w - planes[p, 0] * u - planes[p, 1] * v - planes[p, 2]
    tell_far(depth, max_depth, inverse, kind, on)
    across_x = ((np.arange(width) - camera[2]) / camera[0]).astype(np.float32)
    across_y = ((np.arange(height) - camera[3]) / camera[1]).astype(np.float32)
    # Same float type as the readings, so that the compiler can vectorise with twice the width.
    floor, bias, per_depth = np.float32(floor), np.float32(bias), np.float32(SIGMAS * noise)
    columns_x = np.arange(width).astype(np.float32)
    # For a row of cells: the local deviation of each plane, and its weight (0: the plane does not extend there).
    bow, weight = np.empty((columns_of(width, size), count)), np.empty((columns_of(width, size), count))
    bowed = np.empty(width, np.float32)
    for r in range(columns_of(height, size)):
        for q in range(len(bow)):
            bow_at(r, q, reach, member, off, bow[q], weight[q])
        for p in range(count):
            first, end = width, 0
            for q in range(len(bow)):
                if weight[q, p] > 0.0:
                    first, end = min(first, q * size), min((q + 1) * size, width)
                # An infinite deviation: no reading is near the plane where it does not extend.
                bowed[q * size : (q + 1) * size] = bow[q, p] if weight[q, p] > 0.0 else np.inf
            a, nx = np.float32(planes[p, 0]), np.float32(normals[p, 0])
            for v in range(r * size, min(height, (r + 1) * size)):
                along = np.float32(planes[p, 1] * v + planes[p, 2])
                facing_along = np.float32(normals[p, 1] * across_y[v] + normals[p, 2])
                # No branches, so that the compiler can vectorise the loop.
                for u in range(first, end):
                    z = depth[v, u]
                    facing = abs(nx * across_x[u] + facing_along)
                    # dz = z^2 dw; the distance at right angles to the plane is dz times n.ray
                    across = abs(a * columns_x[u] + along + bowed[u] - inverse[v, u]) * z * z * facing
                    on_plane = across < max(floor, bias + per_depth * z * z * facing)
                    on_plane &= kind[v, u] == SURFACE
                    kind[v, u] = PLANE if on_plane else kind[v, u]
                    on[v, u] = p if on_plane else on[v, u]


@kernel(inline="always")
def columns_of(length, size):
    """Return the number of cells along an image side; the last cell may be cut off."""
    return (length + size - 1) // size


@kernel(error_model="numpy")
def tell_far(depth, max_depth, inverse, kind, on):
    """Mark pixels as NONE, FAR or SURFACE, write 1/z, and clear the planes of all pixels; see `classify`."""
    one, none = np.float32(1.0), np.float32(0.0)
    on[:] = -1
    # No branches, so that the compiler can vectorise the loops.
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            z = depth[v, u]
            inverse[v, u] = one / z if z > none else none
        for u in range(depth.shape[1]):
            z = depth[v, u]
            kind[v, u] = (FAR if z > max_depth else SURFACE) if z > none else NONE


@kernel(inline="always")
def bow_at(r, q, reach, member, off, bow, weight):
    """Write the weighted mean deviation of the cells near (r, q) from each plane, and the weights; see `classify`."""
    rows, columns = member.shape
    bow[:] = 0.0
    weight[:] = 0.0
    for rr in range(max(0, r - reach), min(rows, r + reach + 1)):
        for qq in range(max(0, q - reach), min(columns, q + reach + 1)):
            p = member[rr, qq]
            if p >= 0:
                falloff = 1.0 / (1.0 + (rr - r) * (rr - r) + (qq - q) * (qq - q))
                bow[p] += falloff * off[rr, qq]
                weight[p] += falloff
    for p in range(bow.size):
        bow[p] = bow[p] / weight[p] if weight[p] > 0.0 else 0.0
