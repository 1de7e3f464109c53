"""Hot loops that find the large planes of one depth image and set their pixels apart; see `segments` for why 1/z."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cuboid.core.compiled import kernel
from cuboid.core.kernels.cells import AREA, CX, CY, CZ, NX, NY, NZ, RMS
from cuboid.core.kernels.segments import FAR, NONE, PLANE, SURFACE
from cuboid.core.tolerances import SIGMAS

# Fewer cells fix no plane that others are joined to.
MIN_CELLS = 9
# A cell of a plane faces as it does, to 25 degrees.
ALIKE_COS = 0.9


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
        Square metres of a large plane.
    planes : (P, 3) float64, output
        a, b, c of each: 1/z = a u + b v + c at pixel (u, v).
    member : (R, C) int16, output
        Plane of each cell, -1 none.

    Returns
    -------
    int
        Number of planes.
    """
    rows, columns = shape
    member[:] = -1
    tried = np.zeros((rows, columns), np.int32)
    queue = np.empty(rows * columns, np.int32)
    order = np.argsort(cells[:, RMS], kind="mergesort")
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
        if area < least_area or tail < MIN_CELLS:
            continue
        for i in range(tail):
            member[queue[i] // columns, queue[i] % columns] = count
        planes[count, 0], planes[count, 1], planes[count, 2] = a, b, c
        count += 1
    return count


@kernel
def grow(seed, attempt, cells, camera, off, flat, member, tried, queue):
    """Join cells to a plane, beginning with a seed, as long as they lie on it; see `grow_planes`.

    Parameters
    ----------
    seed : int
    attempt : int
        Written to `tried` (R, C) int32 for each cell.
    off : float
        A cell lies on the plane whose 1/z is off by no more, 1/metre.
    queue : (R * C,) int32, output
        Begins with the cells.

    Returns
    -------
    count : int
        How many cells there are.
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
        here = queue[head]
        head += 1
        u, v, w = seen_at(cells[here], camera)
        area += cells[here, AREA]
        m[0], m[1], m[2], m[3], m[4] = m[0] + u * u, m[1] + u * v, m[2] + u, m[3] + v * v, m[4] + v
        m[5], m[6], m[7], m[8] = m[5] + 1.0, m[6] + u * w, m[7] + v * w, m[8] + w
        if head >= MIN_CELLS and head >= 1.5 * fitted:
            fitted = head
            a, b, c = solve3(m, a, b, c)
        nx, ny, nz = plane_normal(a, b, c, camera)
        for k in range(4):
            r, q = here // columns + (k == 0) - (k == 1), here % columns + (k == 2) - (k == 3)
            if r < 0 or q < 0 or r >= rows or q >= columns or member[r, q] >= 0 or tried[r, q] == attempt:
                continue
            other = cells[r * columns + q]
            if other[AREA] <= 0.0 or other[RMS] > flat:
                continue
            u, v, w = seen_at(other, camera)
            if abs(a * u + b * v + c - w) > off or nx * other[NX] + ny * other[NY] + nz * other[NZ] < ALIKE_COS:
                continue
            tried[r, q] = attempt
            queue[tail] = r * columns + q
            tail += 1
    a, b, c = solve3(m, a, b, c)
    return tail, area, a, b, c


@kernel(inline="always")
def seen_at(cell, camera):
    """Return column and row of a cell's centre in the image, pixels, and its 1/z."""
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
    """Solve the normal equations (uu, uv, u, vv, v, 1; uw, vw, w) of a plane by Cramer's rule on centred sums.

    Returns a, b, c as they are where the cells fix no plane.
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
    """The planes that `grow_planes` found.

    Attributes
    ----------
    cells : (R * C, CELL_COLUMNS) float64
    planes : (P, 3) float64
    found : int
        How many of these there are.
    member : (R, C) int16
        The plane of each cell, -1 none.
    """

    cells: npt.NDArray[np.float64]
    planes: npt.NDArray[np.float64]
    found: int
    member: npt.NDArray[np.int16]


@kernel(error_model="numpy")
def classify(depth, grown, camera, size, reach, noise, floor, bias, max_depth, inverse, kind, on):
    """Tell pixels on a large plane from those on any other surface.

    A plane reaches `reach` cells beyond its own; there and within it a reading belongs to it that is no farther
    from it, at right angles, than max(floor, bias + 3 standard deviations). Where its cells bow (lens, baseline), the
    plane bows with them.

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
        The plane of each pixel, -1 none.
    """
    cells, planes, count, member = grown
    height, width = depth.shape
    rows, columns = member.shape
    normals = np.empty((count, 3))
    for p in range(count):
        normals[p, 0], normals[p, 1], normals[p, 2] = plane_normal(planes[p, 0], planes[p, 1], planes[p, 2], camera)
    # How far a cell lies off its plane, and the directions in which the pixels look.
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
    # As the readings are, so that one instruction takes twice as many.
    floor, bias, per_depth = np.float32(floor), np.float32(bias), np.float32(SIGMAS * noise)
    columns_x = np.arange(width).astype(np.float32)
    # For a row of cells: how far each plane bows there, and whether it reaches there.
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
                # Where it does not reach nothing is near it.
                bowed[q * size : (q + 1) * size] = bow[q, p] if weight[q, p] > 0.0 else np.inf
            a, nx = np.float32(planes[p, 0]), np.float32(normals[p, 0])
            for v in range(r * size, min(height, (r + 1) * size)):
                along = np.float32(planes[p, 1] * v + planes[p, 2])
                facing_along = np.float32(normals[p, 1] * across_y[v] + normals[p, 2])
                # Without a branch: so one instruction takes several pixels.
                for u in range(first, end):
                    z = depth[v, u]
                    facing = abs(nx * across_x[u] + facing_along)
                    # dz = z^2 dw, and at right angles to the plane dz times n.ray
                    across = abs(a * columns_x[u] + along + bowed[u] - inverse[v, u]) * z * z * facing
                    own = across < max(floor, bias + per_depth * z * z * facing)
                    own &= kind[v, u] == SURFACE
                    kind[v, u] = PLANE if own else kind[v, u]
                    on[v, u] = p if own else on[v, u]


@kernel(inline="always")
def columns_of(length, size):
    """Return how many cells an image's side has, the last of them cut off where they do not fit in."""
    return (length + size - 1) // size


@kernel(error_model="numpy")
def tell_far(depth, max_depth, inverse, kind, on):
    """Tell pixels without a reading, and those that are too far, from surfaces, none yet on a plane; see `classify`."""
    one, none = np.float32(1.0), np.float32(0.0)
    on[:] = -1
    # Without a branch: so one instruction takes several pixels.
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            z = depth[v, u]
            inverse[v, u] = one / z if z > none else none
        for u in range(depth.shape[1]):
            z = depth[v, u]
            kind[v, u] = (FAR if z > max_depth else SURFACE) if z > none else NONE


@kernel(inline="always")
def bow_at(r, q, reach, member, off, bow, weight):
    """Write how far the cells around one lie off each plane, in the mean, and what weight they have; see `classify`."""
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
