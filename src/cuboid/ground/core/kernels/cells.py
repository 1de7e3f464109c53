"""Hot loop that fits a local plane to each square cell of a depth image.

In a pinhole image a plane is a linear function of inverse depth, 1/z = a u + b v + c, and the noise of a disparity
sensor is uniform in 1/z, so that one linear fit per cell and one threshold are valid at all distances.
"""

from __future__ import annotations

import numpy as np

from cuboid.ground.compiling.compiled import kernel
from cuboid.ground.core.tolerances import MIN_SIGMA_M, SIGMAS

# Columns of a cell.
NX, NY, NZ, CX, CY, CZ, AREA, RMS = range(8)
CELL_COLUMNS = 8

# Surfaces are searched only where they are seen at a larger grazing angle than this (sine; 3 degrees).
LOWEST = 0.05
# Fewest readings of a patch that must lie level.
MIN_LEVEL = 3
# At least this fraction of the pixels of a cell, or of a patch, must be readings on its plane.
FILLED = 0.6


@kernel
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
    needed = FILLED * size * size
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
            if facing < LOWEST * np.sqrt(rx * rx + ry * ry + 1.0):  # grazing angle: the fit is not reliable
                continue
            out[NX], out[NY], out[NZ] = -nx / norm, -ny / norm, -nz / norm
            out[CX], out[CY], out[CZ] = rx * z, ry * z, z
            out[AREA] = n * z * z / (fx * fy) / facing
            out[RMS] = np.sqrt(max(0.0, vww - a * vwu - b * vwv))


@kernel
def level_patches(depth, camera, up, size, noise, min_depth, max_depth, skip, patches):
    """Find the patches that show a level surface from above, however narrow it appears.

    A reading lies on a level surface if the reading beyond it, along the image direction of up, has the same height:
    on an upright surface the height changes along the image by far more than its noise. The height noise is the depth
    noise times the sine of the grazing angle, so the test is most precise for distant surfaces at grazing angles, where
    a square cell of the image does not contain a whole surface.

    Parameters
    ----------
    depth : (H, W) float32
        Metres, 0 none.
    camera : (4,) float64
        fx, fy, cx, cy.
    up : (3,) float64
        Unit, in the camera frame.
    size : int
        Edge of a patch in pixels.
    noise : float
        Standard deviation of depth is noise * z * z, 1/metre.
    min_depth, max_depth : float
        Metres.
    skip : (H // size, W // size) uint8
        1 for patches to skip.
    patches : (H // size * W // size, 5) float64, output
        One row per patch with a level surface: centre (3) in the camera frame, area in square metres, index of the
        patch.

    Returns
    -------
    int
        Number of patches found.
    """
    rows, columns = skip.shape
    height, width = depth.shape
    fx, fy, cx, cy = camera[0], camera[1], camera[2], camera[3]
    found = 0
    for r in range(rows):
        for c in range(columns):
            if skip[r, c]:
                continue
            rx, ry = ((c + 0.5) * size - cx) / fx, ((r + 0.5) * size - cy) / fy
            long = np.sqrt(rx * rx + ry * ry + 1.0)
            steep = -(up[0] * rx + up[1] * ry + up[2])  # height of a level surface below the camera, divided by z
            if steep < LOWEST * long:
                continue
            su, sv = fx * (up[0] - rx * up[2]), fy * (up[1] - ry * up[2])
            longest = max(abs(su), abs(sv))
            su, sv = su / longest, sv / longest
            n = readings = 0
            x = y = z = 0.0
            for i in range(size):
                for j in range(size):
                    v, u = r * size + i, c * size + j
                    depth_here = depth[v, u]
                    if not (min_depth <= depth_here <= max_depth):
                        continue
                    gate = SIGMAS * 1.42 * noise * depth_here * depth_here * steep + MIN_SIGMA_M
                    # After k pixels, at most two patches, an upright surface has risen by twice the gate. The first
                    # reading from there on, within one patch length, decides: surfaces at grazing angles have gaps.
                    k = int(np.ceil(2.0 * gate * longest / depth_here))
                    if k > 2 * size:
                        continue
                    depth_beyond = 0.0
                    vv = uu = 0
                    for step in range(k, k + size):
                        vv, uu = int(np.rint(v + step * sv)), int(np.rint(u + step * su))
                        if vv < 0 or uu < 0 or vv >= height or uu >= width:
                            break
                        depth_beyond = depth[vv, uu]
                        if depth_beyond > 0.0:
                            break
                    if not (0.0 < depth_beyond <= max_depth):
                        continue
                    readings += 1
                    px, py = (u - cx) / fx, (v - cy) / fy
                    qx, qy = (uu - cx) / fx, (vv - cy) / fy
                    rise = depth_beyond * (up[0] * qx + up[1] * qy + up[2]) - depth_here * (
                        up[0] * px + up[1] * py + up[2]
                    )
                    if abs(rise) <= gate:
                        n += 1
                        x, y, z = x + px * depth_here, y + py * depth_here, z + depth_here
            if n < MIN_LEVEL or n < FILLED * readings:
                continue
            z /= n
            out = patches[found]
            out[0], out[1], out[2] = x / n, y / n, z
            out[3] = n * z * z / (fx * fy) * long / steep
            out[4] = r * columns + c
            found += 1
    return found
