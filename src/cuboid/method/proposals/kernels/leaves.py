"""Hot loops that divide a picture into leaves: small regions of similar color on one smooth surface.

The division is that of Felzenszwalb and Huttenlocher, "Efficient graph-based image segmentation" (IJCV 2004). The
links between neighbouring pixels are weighted by color and depth together.
"""

from __future__ import annotations

import math

import numpy as np

from cuboid.ground.compiling.compiled import kernel

# Distance of the pixels whose depths give the normal of a pixel, pixels.
NORMAL_ARM = 2
# Depth step that separates two surfaces at depth z, metres: JUMP_BASE_M + JUMP_SLOPE z + JUMP_PER_M z^2. It is several
# standard deviations of a first Kinect, and less than the height of a book.
JUMP_BASE_M, JUMP_SLOPE, JUMP_PER_M = 0.004, 0.012, 0.006
# Link weight of a difference of normals of one radian, and of a depth step of one jump, in units of color difference
# (CIE Lab): a crease of ten degrees, or a step of a jump, weighs as much as a clearly visible change of color.
NORMAL_COLORS, STEP_COLORS = 30.0, 5.0
# Link weights are sorted in steps of a sixteenth of a color unit, up to the largest one.
WEIGHT_STEPS, MAX_WEIGHT = 16.0, 4095


@kernel(inline="always")
def jump_m(depth_m):
    """Return the depth step that separates two surfaces at a depth, metres."""
    return JUMP_BASE_M + JUMP_SLOPE * depth_m + JUMP_PER_M * depth_m * depth_m


@kernel(error_model="numpy")
def surface_normals(depth_m, fx, fy, cx, cy, normals):
    """Compute the unit normal of each pixel, towards the camera.

    Parameters
    ----------
    depth_m : (h, w) float32
        Metres, without holes.
    fx, fy, cx, cy : float
        Pixels.
    normals : (h, w, 3) float32, output
    """
    h, w = depth_m.shape
    for v in range(h):
        top, bottom = max(v - NORMAL_ARM, 0), min(v + NORMAL_ARM, h - 1)
        for u in range(w):
            left, right = max(u - NORMAL_ARM, 0), min(u + NORMAL_ARM, w - 1)
            a, b, c, d = depth_m[v, left], depth_m[v, right], depth_m[top, u], depth_m[bottom, u]
            ax, ay, az = (right - cx) * b / fx - (left - cx) * a / fx, (v - cy) * (b - a) / fy, b - a
            bx, by, bz = (u - cx) * (d - c) / fx, (bottom - cy) * d / fy - (top - cy) * c / fy, d - c
            nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
            length = math.sqrt(nx * nx + ny * ny + nz * nz) + 1e-12
            if nz > 0.0:
                length = -length
            normals[v, u, 0], normals[v, u, 1], normals[v, u, 2] = nx / length, ny / length, nz / length


@kernel
def changes(across, down, normals, gradient, bend):
    """Compute how much color and normal change at each pixel.

    Parameters
    ----------
    across, down : (h, w, 3) float32
        Change of the color from pixel to pixel along rows, and along columns.
    normals : (h, w, 3) float32
    gradient : (h, w) float32, output
        Length of the change of the color, units of color per pixel.
    bend : (h, w) float32, output
        Length of the change of the normal over two pixels, at most 1; 0 at the border of the picture.
    """
    h, w = gradient.shape
    for v in range(h):
        for u in range(w):
            color = np.float32(0.0)
            for k in range(3):
                color += across[v, u, k] * across[v, u, k] + down[v, u, k] * down[v, u, k]
            gradient[v, u], bend[v, u] = np.sqrt(color), 0.0
            if 0 < v < h - 1 and 0 < u < w - 1:
                below = beside = np.float32(0.0)
                for k in range(3):
                    a, b = normals[v + 1, u, k] - normals[v - 1, u, k], normals[v, u + 1, k] - normals[v, u - 1, k]
                    below += a * a
                    beside += b * b
                bend[v, u] = min(np.sqrt(below + beside), np.float32(1.0))


@kernel(error_model="numpy")
def link_weights(lab, depth_m, normals, color_weight, depth_weight, right, down):
    """Weigh the links of each pixel with its right and its lower neighbour.

    Parameters
    ----------
    lab : (h, w, 3) float32
        CIE Lab.
    depth_m : (h, w) float32
    normals : (h, w, 3) float32
    color_weight, depth_weight : float
        Factors of the differences in color, and in depth.
    right, down : (h, w) int32, output
        In steps of 1 / WEIGHT_STEPS.
    """
    h, w = depth_m.shape
    for v in range(h):
        for u in range(w):
            for side in range(2):
                v2, u2 = v + side, u + 1 - side
                if v2 >= h or u2 >= w:
                    continue
                color, bend = 0.0, 0.0
                for k in range(3):
                    color += (lab[v, u, k] - lab[v2, u2, k]) ** 2
                    bend += (normals[v, u, k] - normals[v2, u2, k]) ** 2
                a, b = depth_m[v, u], depth_m[v2, u2]
                steps = STEP_COLORS * (a - b) / jump_m(min(a, b))
                shape = bend * NORMAL_COLORS**2 + steps * steps
                weight = math.sqrt(color_weight**2 * color + depth_weight**2 * shape)
                out = down if side else right
                out[v, u] = min(int(weight * WEIGHT_STEPS), MAX_WEIGHT)


@kernel(inline="always")
def root_of(parent, i):
    """Return the root of an element, and shorten its path."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@kernel
def join_pixels(right, down, tolerance, min_pixels, parent, size, limit, order, starts, labels):
    """Join linked pixels to leaves, the weakest link first, and number the leaves in the order of the rows.

    Two leaves join if their link is not weaker than the strongest link within each, plus tolerance over its size. Then
    each leaf of less than `min_pixels` joins the neighbour with the lightest link.

    Parameters
    ----------
    right, down : (h, w) int32
        See `link_weights`.
    tolerance : float
        In color units times pixels: larger values give larger leaves.
    min_pixels : int
    parent, size : (h w,) int32, work
    limit : (h w,) float32, work
    order : (2 h w,) int32, work
    starts : (MAX_WEIGHT + 2,) int32, work
    labels : (h, w) int32, output

    Returns
    -------
    int
        Number of leaves.
    """
    h, w = right.shape
    for k in range(len(starts)):
        starts[k] = 0
    for v in range(h):
        for u in range(w):
            if u + 1 < w:
                starts[right[v, u] + 1] += 1
            if v + 1 < h:
                starts[down[v, u] + 1] += 1
    for k in range(1, len(starts)):
        starts[k] += starts[k - 1]
    links = starts[len(starts) - 1]
    for v in range(h):
        for u in range(w):
            i = v * w + u
            parent[i], size[i], limit[i] = i, 1, tolerance
            if u + 1 < w:
                weight = right[v, u]
                order[starts[weight]] = 2 * i
                starts[weight] += 1
            if v + 1 < h:
                weight = down[v, u]
                order[starts[weight]] = 2 * i + 1
                starts[weight] += 1
    for small_ones in range(2):
        for n in range(links):
            i, vertical = order[n] >> 1, order[n] & 1
            a, b = root_of(parent, i), root_of(parent, i + w if vertical else i + 1)
            if a == b:
                continue
            weight = (down[i // w, i % w] if vertical else right[i // w, i % w]) / WEIGHT_STEPS
            if small_ones:
                joins = size[a] < min_pixels or size[b] < min_pixels
            else:
                joins = weight <= limit[a] and weight <= limit[b]
            if joins:
                if size[a] < size[b]:
                    a, b = b, a
                parent[b] = a
                size[a] += size[b]
                limit[a] = weight + tolerance / size[a]
    count = 0
    for i in range(h * w):
        size[i] = -1
    for i in range(h * w):
        root = root_of(parent, i)
        if size[root] < 0:
            size[root] = count
            count += 1
        labels[i // w, i % w] = size[root]
    return count
