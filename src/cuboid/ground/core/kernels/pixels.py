"""Hot loops over the pixels of one frame: the plane beneath each pixel, mixed pixels, world points."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cuboid.ground.compiling.compiled import kernel
from cuboid.ground.core.tolerances import JUMP_M, SIGMAS


@kernel
def drop_mixed(depth, jump, out):
    """Copy depth without mixed (flying) pixels: readings between a nearer and a farther neighbour.

    A reading is removed if, along a row or a column, one neighbour is nearer and the other farther by more than
    `jump` times z squared, plus `JUMP_M`.
    """
    height, width = depth.shape
    for v in range(height):
        for u in range(width):
            out[v, u] = depth[v, u]
    for v in range(1, height - 1):
        above, row, below, clean = depth[v - 1], depth[v], depth[v + 1], out[v]
        # No branches, so that the compiler can vectorise the loop.
        for u in range(1, width - 1):
            z = row[u]
            limit = JUMP_M + jump * z * z
            mixed = is_mixed(row[u - 1], z, row[u + 1], limit) | is_mixed(above[u], z, below[u], limit)
            clean[u] = np.float32(0.0) if mixed else z


@kernel(inline="always")
def is_mixed(before, z, after, limit):
    """Return whether a reading lies between a nearer and a farther neighbour, far from both."""
    near, far = before - z, z - after
    all_measured = (before > 0.0) & (z > 0.0) & (after > 0.0)
    return all_measured & (near * far > 0.0) & (min(abs(near), abs(far)) > limit)


class PlanesInView(NamedTuple):
    """Supporting planes as a frame sees them.

    Attributes
    ----------
    in_camera : (P, 4) float64
        Each plane in the camera frame, as this frame sees it: normal (up) and offset, n.p + d = height.
    numbers : (P,) int32
        Number of each plane in `patches`.
    ground : (P, N, M) uint8
        Cells that each plane covers (1), holes beneath objects filled.
    origin : (2,) float64
        Grid coordinates of the corner of cell (0, 0), metres.
    cell : float
        Edge of a cell, metres.
    patches : (H // patch, W // patch) int32
        Number of the plane on which each image patch lies, -1: none.
    patch : int
        Edge of a patch, pixels.
    """

    in_camera: npt.NDArray[np.float64]
    numbers: npt.NDArray[np.int32]
    ground: npt.NDArray[np.uint8]
    origin: npt.NDArray[np.float64]
    cell: float
    patches: npt.NDArray[np.int32]
    patch: int


@kernel(error_model="numpy")
def assign_planes(depth, camera, T_grid_camera, planes, noise, floor, bias, max_depth, on_plane, support, seen):
    """Find for each pixel the supporting plane on which it lies, and the plane beneath it.

    Parameters
    ----------
    depth : (H, W) float32
    camera : (4,) float64
        fx, fy, cx, cy.
    T_grid_camera : (4, 4) float64
        Transform from the camera to the grid frame, whose third axis is up.
    planes : PlanesInView
    noise : float
        Standard deviation of depth is noise * z * z.
    floor, bias : float
        Readings at least max(floor, bias + 3 standard deviations of their height) away are off the plane, metres.
    max_depth : float
    on_plane : (H, W) int32, output
        Plane on which a reading lies, 0..P-1, -1: none.
    support : (H, W) int32, output
        Plane beneath the reading, or on which it lies; -1: none.
    seen : (P, N, M) int32, in and out
        Number of readings on each plane, by cell; only from patches that lie on the plane as a whole.
    """
    planes_camera, numbers, ground, origin, cell, patches, patch = planes
    rows, columns = depth.shape
    count, wide, high = ground.shape
    across, patch_of = (np.arange(columns) - camera[2]) / camera[0], np.arange(columns) // patch
    # For one image row: the cell under each pixel, whether a plane covers that cell, the height above the plane, and
    # the smallest height above any plane beneath; see `heights_above`.
    place, covered = np.empty(columns, np.int64), np.empty(columns, np.uint8)
    height, best = np.empty(columns), np.empty(columns)
    counts, grounds = seen.reshape(count, wide * high), ground.reshape(count, wide * high)
    bits = np.uint64(1) << (numbers & 63).astype(np.uint64)
    over, along = planes_by_cell(grounds, bits), planes_by_row(patches, rows, patch)
    for v in range(rows):
        ry, pr = (v - camera[3]) / camera[1], v // patch
        over_cells(depth[v], across, ry, T_grid_camera, origin, cell, wide, high, max_depth, place)
        best[:] = np.inf
        support[v] = -1
        in_row = along[pr]
        for u in range(columns):
            in_row |= over[place[u]] if place[u] >= 0 else np.uint64(0)
        for p in range(count):
            if in_row & bits[p] == 0:
                continue
            heights_above(depth[v], across, ry, planes_camera[p], noise, floor, bias, height)
            if along[pr] & bits[p] and pr < patches.shape[0]:
                for u in range(min(columns, patch * patches.shape[1])):
                    if place[u] >= 0 and height[u] == -np.inf and best[u] > -np.inf:
                        counts[p, place[u]] += patches[pr, patch_of[u]] == numbers[p]
            for u in range(columns):
                covered[u] = grounds[p, place[u]] if place[u] >= 0 else 0
            lower(height, covered, p, best, support[v])
        for u in range(columns):
            on_plane[v, u] = support[v, u] if best[u] == -np.inf else -1


@kernel(inline="always")
def lower(height, covered, plane, best, support):
    """Set `plane` as the support of the pixels in a row whose cell it covers and that no earlier plane is closer to."""
    # No branches, so that the compiler can vectorise the loops.
    for u in range(height.size):
        support[u] = plane if (height[u] < best[u]) & (covered[u] > 0) else support[u]
    for u in range(height.size):
        best[u] = height[u] if (height[u] < best[u]) & (covered[u] > 0) else best[u]


@kernel
def planes_by_cell(grounds, bits):
    """Return the planes that cover each cell, (cells,) uint64: one bit per plane; two planes may share a bit."""
    over = np.zeros(grounds.shape[1], np.uint64)
    for p in range(grounds.shape[0]):
        bit, covered = bits[p], grounds[p]
        for k in range(covered.size):
            over[k] |= bit if covered[k] else np.uint64(0)
    return over


@kernel
def planes_by_row(patches, rows, patch):
    """Return the planes of each row of image patches, as bits like in `planes_by_cell`, for all rows of an image."""
    along = np.zeros((rows - 1) // patch + 1, np.uint64)
    for r in range(patches.shape[0]):
        for number in patches[r]:
            along[r] |= np.uint64(1) << np.uint64(number & 63) if number >= 0 else np.uint64(0)
    return along


@kernel(inline="always")
def over_cells(depth, across, ry, T_grid_camera, origin, cell, wide, high, max_depth, place):
    """Write the index of the grid cell (wide x high) under each reading of a row, -1: none. See `assign_planes`."""
    xx, xy, xz, x0 = T_grid_camera[0]
    yx, yy, yz, y0 = T_grid_camera[1]
    # No branches, so that the compiler can vectorise the loop.
    for u in range(depth.size):
        z = np.float64(depth[u])
        x, y = across[u] * z, ry * z
        ix = np.floor((xx * x + xy * y + xz * z + x0 - origin[0]) / cell)
        iy = np.floor((yx * x + yy * y + yz * z + y0 - origin[1]) / cell)
        inside = (z > 0.0) & (z <= max_depth) & (ix >= 0.0) & (iy >= 0.0) & (ix < wide) & (iy < high)
        place[u] = np.int64(ix * high + iy) if inside else -1


@kernel(inline="always")
def heights_above(depth, across, ry, plane, noise, floor, bias, height):
    """Write the height of each reading of an image row above a plane; see `assign_planes`.

    The height is minus infinity for a reading on the plane, and infinity for a reading below it.
    """
    n0, n1, n2, d = plane
    for u in range(depth.size):
        z = np.float64(depth[u])
        h = n0 * (across[u] * z) + n1 * (ry * z) + n2 * z + d
        limit = max(floor, bias + SIGMAS * (noise * z * z * abs(n0 * across[u] + n1 * ry + n2)))
        height[u] = (-np.inf if abs(h) < limit else h) if h > -limit else np.inf


@kernel
def back_project(pixels, depth, camera, T, places):
    """Write the world coordinates of pixels.

    Parameters
    ----------
    pixels : (N,) int64
        Flat indices of the pixels.
    depth : (H, W) float32
        Metres.
    camera : (4,) float64
        fx, fy, cx, cy.
    T : (4, 4) float64
        T_world_camera.
    places : (N, 3) float64, output
        Metres.
    """
    flat, width = depth.reshape(-1), depth.shape[1]
    for i in range(pixels.size):
        v = pixels[i] // width
        u, z = pixels[i] - v * width, np.float64(flat[pixels[i]])
        x, y = (u - camera[2]) / camera[0] * z, (v - camera[3]) / camera[1] * z
        for k in range(3):
            places[i, k] = T[k, 0] * x + T[k, 1] * y + T[k, 2] * z + T[k, 3]
