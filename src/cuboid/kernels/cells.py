"""Hot loop: a small plane for each square cell of a depth image.

In a pinhole image a plane is a linear function of inverse depth, 1/z = a u + b v + c, and a disparity sensor's
noise is the same everywhere in 1/z, so that one linear fit a cell and one threshold serve all distances.
"""

from __future__ import annotations

import numpy as np
from numba import njit

# Columns of a cell's row.
NX, NY, NZ, CX, CY, CZ, AREA, RMS = range(8)
CELL_COLUMNS = 8


@njit(cache=True, nogil=True)
def fit_cells(depth, camera, size, max_depth, cells):
    """Fit a plane to every size x size cell that is mostly filled.

    Parameters
    ----------
    depth : (H, W) float32
        Metres, 0 none.
    camera : (4,) float64
        fx, fy, cx, cy.
    size : int
        Edge of a cell in pixels.
    max_depth : float
        Metres.
    cells : ((H // size) * (W // size), 8) float64, output
        Unit normal towards the camera (3), centre on the plane (3), area in square metres, rms of the
        residual of 1/z in 1/metre; all in the camera frame. An area of 0 marks a cell without a plane.
    """
    rows, columns = depth.shape[0] // size, depth.shape[1] // size
    fx, fy, cx, cy = camera[0], camera[1], camera[2], camera[3]
    half = (size - 1) * 0.5
    needed = 0.6 * size * size
    for r in range(rows):
        for c in range(columns):
            out = cells[r * columns + c]
            out[:] = 0.0
            n = 0.0
            su = sv = suu = svv = suv = sw = swu = swv = sww = 0.0
            for i in range(size):
                for j in range(size):
                    z = depth[r * size + i, c * size + j]
                    if not (0.0 < z <= max_depth):
                        continue
                    w = 1.0 / z
                    u, v = j - half, i - half
                    n += 1.0
                    su += u
                    sv += v
                    suu += u * u
                    svv += v * v
                    suv += u * v
                    sw += w
                    swu += w * u
                    swv += w * v
                    sww += w * w
            if n < needed:
                continue
            mu, mv, mw = su / n, sv / n, sw / n
            vuu, vvv, vuv = suu / n - mu * mu, svv / n - mv * mv, suv / n - mu * mv
            vwu, vwv, vww = swu / n - mw * mu, swv / n - mw * mv, sww / n - mw * mw
            det = vuu * vvv - vuv * vuv
            if det <= 1e-9:
                continue
            a = (vwu * vvv - vwv * vuv) / det
            b = (vwv * vuu - vwu * vuv) / det
            # 1 = a (fx x + (cx - u0) z) + b (fy y + (cy - v0) z) + w0 z, with (u0, v0) the cell's mean pixel
            u0, v0 = c * size + half + mu, r * size + half + mv
            nx, ny, nz = a * fx, b * fy, a * (cx - u0) + b * (cy - v0) + mw
            norm = np.sqrt(nx * nx + ny * ny + nz * nz)
            if mw <= 0.0 or norm <= 0.0:
                continue
            z = 1.0 / mw
            rx, ry = (u0 - cx) / fx, (v0 - cy) / fy
            facing = (nx * rx + ny * ry + nz) / norm
            if facing < 0.05 * np.sqrt(rx * rx + ry * ry + 1.0):  # grazing: the fit says nothing
                continue
            out[NX], out[NY], out[NZ] = -nx / norm, -ny / norm, -nz / norm
            out[CX], out[CY], out[CZ] = rx * z, ry * z, z
            out[AREA] = n * z * z / (fx * fy) / facing
            out[RMS] = np.sqrt(max(0.0, vww - a * vwu - b * vwv))
