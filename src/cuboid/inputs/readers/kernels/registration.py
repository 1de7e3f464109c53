"""Projection of one camera's depth into another camera's image."""

from __future__ import annotations

import numpy as np

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.compiling.compiled import kernel
from cuboid.ground.core.tolerances import DEPTH_NOISE_PER_M, SIGMAS

# Half the side of a reading's footprint, in pixels of the depth image: slightly more than half a pixel, because
# neighbours on a curved surface do not meet exactly.
COVERS_PX = 0.6
# Neighbouring readings lie on one surface if their depths differ by at most the step per pixel of a surface tilted by
# 80 degrees, plus SIGMAS standard deviations of noise.
STEEPEST = 5.7
NOISE_PER_M = SIGMAS * DEPTH_NOISE_PER_M
# Points nearer to the color camera than this, metres, have no pixel in its image.
NEAREST_COLOR_M = 0.02


@kernel
def project_depth(
    depth_m: Float32Array,
    rays: Float32Array,
    T_color_depth: Float64Array,
    K_color: Float64Array,
    uvz: Float32Array,
) -> None:
    """Compute the position of each reading in the color image.

    Parameters
    ----------
    depth_m : (H, W) float32
        Depth, metres; 0 is no reading.
    rays : (H, W, 2) float32
        x / z and y / z of each pixel of the depth image; NaN where none is known.
    T_color_depth : (4, 4) float64
        Transform from the depth camera to the color camera.
    K_color : (4,) float64
        fx, fy, cx, cy of the color image.
    uvz : (H, W, 3) float32
        Written: column, row, and depth from the color camera; all 0 where there is none.
    """
    T = T_color_depth
    fx, fy, cx, cy = K_color
    for r in range(depth_m.shape[0]):
        for c in range(depth_m.shape[1]):
            z = depth_m[r, c]
            uvz[r, c, 0] = uvz[r, c, 1] = uvz[r, c, 2] = 0.0
            if not z > 0:
                continue
            x, y = rays[r, c, 0] * z, rays[r, c, 1] * z
            depth = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
            if not depth > NEAREST_COLOR_M:  # NaN too
                continue
            uvz[r, c, 0] = fx * (T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]) / depth + cx
            uvz[r, c, 1] = fy * (T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]) / depth + cy
            uvz[r, c, 2] = depth


@kernel
def splat_depth(
    uvz: Float32Array, footprint: Float32Array, pixel: float, offset: Float32Array, out_m: Float32Array
) -> None:
    """Draw each reading onto the pixels of the color image that it covers; the nearest surface wins.

    A reading covers the parallelogram halfway to its neighbours on the same surface, with interpolated depth; without a
    neighbour, its own footprint at its own depth. So surfaces have no gaps at any ratio of resolutions, and nothing is
    drawn between two surfaces. Of several readings of one surface, the one with the nearest middle is used.

    Parameters
    ----------
    uvz : (H, W, 3) float32
        Output of `project_depth`.
    footprint : (H, W, 4) float32
        Pixels of the color image to the next column (u, v) and the next row (u, v) of the depth image, for a surface
        that faces the camera.
    pixel : float
        Width of a pixel of the depth image at 1 m, metres.
    offset : (h, w) float32
        Written: squared distance to the middle of the used reading, in pixels of the depth image.
    out_m : (h, w) float32
        Written: depth in the color image, 0 where there is no reading.
    """
    rows, columns = uvz.shape[0], uvz.shape[1]
    height, width = out_m.shape
    out_m[:] = 0.0
    for r in range(rows):
        for c in range(columns):
            u, v, z = uvz[r, c, 0], uvz[r, c, 1], uvz[r, c, 2]
            if z <= 0:
                continue
            same = STEEPEST * pixel * z + NOISE_PER_M * z * z
            au, av, bu, bv = footprint[r, c, 0], footprint[r, c, 1], footprint[r, c, 2], footprint[r, c, 3]
            right, left, down, up = np.float32(0.0), np.float32(0.0), np.float32(0.0), np.float32(0.0)
            if c > 0 and uvz[r, c - 1, 2] > 0 and abs(uvz[r, c - 1, 2] - z) <= same:
                au, av, left = u - uvz[r, c - 1, 0], v - uvz[r, c - 1, 1], z - uvz[r, c - 1, 2]
            if c + 1 < columns and uvz[r, c + 1, 2] > 0 and abs(uvz[r, c + 1, 2] - z) <= same:
                au, av, right = uvz[r, c + 1, 0] - u, uvz[r, c + 1, 1] - v, uvz[r, c + 1, 2] - z
            if r > 0 and uvz[r - 1, c, 2] > 0 and abs(uvz[r - 1, c, 2] - z) <= same:
                bu, bv, up = u - uvz[r - 1, c, 0], v - uvz[r - 1, c, 1], z - uvz[r - 1, c, 2]
            if r + 1 < rows and uvz[r + 1, c, 2] > 0 and abs(uvz[r + 1, c, 2] - z) <= same:
                bu, bv, down = uvz[r + 1, c, 0] - u, uvz[r + 1, c, 1] - v, uvz[r + 1, c, 2] - z
            area = au * bv - av * bu
            if abs(area) < 1e-6:  # a surface seen from its edge
                continue
            half_u, half_v = COVERS_PX * (abs(au) + abs(bu)), COVERS_PX * (abs(av) + abs(bv))
            if u + half_u < 0 or v + half_v < 0 or u - half_u > width - 1 or v - half_v > height - 1:
                continue
            for row in range(max(0, int(np.ceil(v - half_v))), min(height - 1, int(np.floor(v + half_v))) + 1):
                for column in range(max(0, int(np.ceil(u - half_u))), min(width - 1, int(np.floor(u + half_u))) + 1):
                    du, dv = column - u, row - v
                    dc, dr = (du * bv - dv * bu) / area, (dv * au - du * av) / area
                    if abs(dc) > COVERS_PX or abs(dr) > COVERS_PX:
                        continue
                    depth = z + dc * (right if dc > 0 else left) + dr * (down if dr > 0 else up)
                    before, away = out_m[row, column], dc * dc + dr * dr
                    in_front = before == 0 or depth < before - same
                    if in_front or (depth <= before + same and away < offset[row, column]):
                        out_m[row, column] = depth
                        offset[row, column] = away
