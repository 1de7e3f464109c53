"""The loop that computes the quantities of regions from their sums: what the score of a region depends on."""

from __future__ import annotations

import math

import numpy as np

from cuboid.ground.compiling.compiled import kernel
from cuboid.method.proposals.kernels.sums import (
    BEND,
    BEYOND_COLOR,
    BEYOND_RAYS,
    BEYOND_READINGS,
    BY_SIDE,
    CLOSED_BY_SIDE,
    COLOR,
    COLOR2,
    CONCAVE,
    CONTINUES,
    CONTRAST,
    CONVEX,
    CUT_OFF,
    DEPTH_STEP,
    EDGE_GRADIENT,
    EDGES,
    ENDS,
    ENDS_BY_SIDE,
    GRADIENT,
    HIDDEN,
    LINKS,
    NORMAL,
    PIXELS,
    POINT_SUMS,
    RAYS,
    READINGS,
)

# The quantities, in the order of their columns. Lengths are logarithms of metres.
QUANTITIES = (
    # Size: root of the area, width, height; logarithm of width over height.
    *("size", "width", "height", "aspect"),
    # Fraction of its rectangle; border over the root of the area; fraction of the border at the border of the image.
    *("fill", "roundness", "cut_off"),
    # Fraction of readings inside and beyond its border; mean depth, metres.
    *("readings", "readings_beyond", "depth"),
    # Deviation of depth over size; deviations of its points along their principal axes; residual of a plane.
    *("deep", "first_axis", "second_axis", "third_axis", "plane_residual"),
    # Length of the mean normal; deviation of color; gradient of color; bend.
    *("flatness", "color_deviation", "gradient", "bend"),
    # Distance of the mean colors inside and beyond, and over the deviation of color.
    *("color_distance", "relative_color_distance"),
    # Means over the border: contrast, gradient; fraction with a visible edge.
    *("contrast", "border_gradient", "edges"),
    # Fractions of the border where the surface ends, is hidden, is concave, is convex, continues; mean depth step.
    *("ends", "hidden", "concave", "convex", "continues", "step"),
    # Fractions of each side that are closed; the least closed side; where the top, the worse side, the bottom end.
    *(
        "closed_right",
        "closed_left",
        "closed_down",
        "closed_up",
        "least_closed",
        "top_ends",
        "side_ends",
        "bottom_ends",
    ),
    # Height over the plane of what lies beyond, metres, and over size; residual of that plane; its slope.
    *("above", "relative_above", "residual_beyond", "slope_beyond"),
    # Mean normal: towards the camera, down; centre in the image, 0..1; logarithm of pixels.
    *("facing", "facing_down", "column", "row", "pixels"),
    # In its tree: logarithm of the dissimilarity of its parts, at which it became a part, and their ratio.
    *("joined", "left", "persistence"),
    # The smaller part over both; distance of their colors; its size over that of the next union.
    *("balance", "color_gap", "next_fraction"),
    # The tree; border over those of both parts; gradient at the border over that inside.
    *("tree", "common_border", "relative_gradient"),
    # The largest IoU with a surface of the depth image, and the largest IoU times score.
    *("surface_iou", "surface_score"),
)
# Logarithm that stands for a quantity without readings, and for the dissimilarity of a leaf or a root.
NO_READINGS, NO_JOIN = -9.0, 9.0
# Smallest number of readings that give a plane.
FEW = 6.0


@kernel(error_model="numpy")
def solve_plane(sums, first, n, plane):
    """Fit inverse depth q = p0 a + p1 b + p2 to n readings; return the mean square of its residuals, -1: no plane."""
    aa, bb, ab = sums[first + 4] / n + 1e-9, sums[first + 5] / n + 1e-9, sums[first + 6] / n
    a, b, one = sums[first + 1] / n, sums[first + 2] / n, 1.0 + 1e-12
    aq, bq, q = sums[first + 7] / n, sums[first + 8] / n, sums[first] / n
    determinant = aa * (bb * one - b * b) - ab * (ab * one - b * a) + a * (ab * b - bb * a)
    if abs(determinant) < 1e-14:
        return -1.0
    plane[0] = (aq * (bb * one - b * b) - ab * (bq * one - b * q) + a * (bq * b - bb * q)) / determinant
    plane[1] = (aa * (bq * one - b * q) - aq * (ab * one - b * a) + a * (ab * q - bq * a)) / determinant
    plane[2] = (aa * (bb * q - bq * b) - ab * (ab * q - bq * a) + aq * (ab * b - bb * a)) / determinant
    return max(sums[first + 3] / n - plane[0] * aq - plane[1] * bq - plane[2] * q, 0.0)


@kernel(error_model="numpy")
def axes_of(sums, n, axes):
    """Compute the variances of n points along their principal axes, in descending order (3,)."""
    x, y, z = sums[POINT_SUMS] / n, sums[POINT_SUMS + 1] / n, sums[POINT_SUMS + 2] / n
    xx, yy, zz = sums[POINT_SUMS + 3] / n - x * x, sums[POINT_SUMS + 4] / n - y * y, sums[POINT_SUMS + 5] / n - z * z
    xy, xz, yz = sums[POINT_SUMS + 6] / n - x * y, sums[POINT_SUMS + 7] / n - x * z, sums[POINT_SUMS + 8] / n - y * z
    mean = (xx + yy + zz) / 3.0
    scale = (xx - mean) ** 2 + (yy - mean) ** 2 + (zz - mean) ** 2 + 2.0 * (xy * xy + xz * xz + yz * yz)
    scale = math.sqrt(max(scale, 1e-18) / 6.0)
    a, b, c, d, e, f = (xx - mean) / scale, (yy - mean) / scale, (zz - mean) / scale, xy / scale, xz / scale, yz / scale
    half = (a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e)) / 2.0
    angle = math.acos(min(max(half, -1.0), 1.0)) / 3.0
    axes[0] = mean + 2.0 * scale * math.cos(angle)
    axes[2] = mean + 2.0 * scale * math.cos(angle + 2.0 * math.pi / 3.0)
    axes[1] = 3.0 * mean - axes[0] - axes[2]


@kernel(error_model="numpy")
def quantities(tree, count, number, camera, shape, limits, found, usable):
    """Compute the quantities of the regions of a tree.

    Parameters
    ----------
    tree : Tree
    count : int
        Number of its regions.
    number : int
        Number of the tree.
    camera : (4,) float64
        fx, fy, cx, cy, pixels.
    shape : (int, int)
        Height and width of the picture.
    limits : (float, float, float)
        Smallest side, smallest and largest number of pixels of a usable region.
    found : (count, Q) float32, output
        In the order of `QUANTITIES`; the two quantities of surfaces are left as they are.
    usable : (count,) uint8, output
    """
    plane, axes = np.empty(3), np.empty(3)
    for i in range(count):
        s, b, f = tree.sums[i], tree.borders[i], found[i]
        area = s[PIXELS]
        wide, high = float(tree.boxes[i, 2] - tree.boxes[i, 0]), float(tree.boxes[i, 3] - tree.boxes[i, 1])
        usable[i] = min(wide, high) >= limits[0] and limits[1] <= area and area <= limits[2]
        if not usable[i]:
            continue
        read, links = s[READINGS], max(b[LINKS], 1.0)
        z = 1.0
        if read > 0.0:
            z = s[POINT_SUMS + 2] / read
        elif b[BEYOND_READINGS] > 0.0:
            z = b[BEYOND_READINGS] / b[BEYOND_RAYS]
        size_m = math.sqrt(area) * z / camera[0]
        f[0], f[1], f[2] = math.log(size_m), math.log(wide * z / camera[0]), math.log(high * z / camera[0])
        f[3], f[4], f[5] = math.log(wide / high), area / (wide * high), (links + s[CUT_OFF]) / math.sqrt(area)
        f[6], f[7], f[8], f[9] = s[CUT_OFF] / (links + s[CUT_OFF]), read / area, b[BEYOND_READINGS] / links, z
        if read > FEW:
            mean = s[POINT_SUMS + 2] / read
            f[10] = math.sqrt(max(s[POINT_SUMS + 5] / read - mean * mean, 0.0)) / size_m
            axes_of(s, read, axes)
            for k in range(3):
                f[11 + k] = 0.5 * math.log(max(axes[k], 1e-8))
            f[14] = math.log(math.sqrt(max(solve_plane(s, RAYS, read, plane), 1e-12)) * z * z + 1e-4)
        else:
            f[10] = -1.0
            for k in range(11, 15):
                f[k] = NO_READINGS
        f[15] = math.sqrt(s[NORMAL] ** 2 + s[NORMAL + 1] ** 2 + s[NORMAL + 2] ** 2) / area
        variance, distance = 0.0, 0.0
        for k in range(3):
            level = s[COLOR + k] / area
            variance += max(s[COLOR2 + k] / area - level * level, 0.0)
            distance += (level - b[BEYOND_COLOR + k] / links) ** 2
        f[16], f[17], f[18] = math.sqrt(variance), s[GRADIENT] / area, s[BEND] / area
        f[19] = math.sqrt(distance)
        f[20] = f[19] / (f[16] + 3.0)
        f[21], f[22], f[23] = b[CONTRAST] / links, b[EDGE_GRADIENT] / links, b[EDGES] / links
        f[24], f[25], f[26] = b[ENDS] / links, b[HIDDEN] / links, b[CONCAVE] / links
        f[27], f[28], f[29] = b[CONVEX] / links, b[CONTINUES] / links, b[DEPTH_STEP] / links
        f[34] = 1.0
        for k in range(4):
            f[30 + k] = (b[CLOSED_BY_SIDE + k] + 0.5) / (b[BY_SIDE + k] + 1.0)
            f[34] = min(f[34], f[30 + k])
        right, left = b[ENDS_BY_SIDE] + 0.5, b[ENDS_BY_SIDE + 1] + 0.5
        f[35] = (b[ENDS_BY_SIDE + 3] + 0.5) / (b[BY_SIDE + 3] + 1.0)
        f[36] = min(right / (b[BY_SIDE] + 1.0), left / (b[BY_SIDE + 1] + 1.0))
        f[37] = (b[ENDS_BY_SIDE + 2] + 0.5) / (b[BY_SIDE + 2] + 1.0)
        f[38], f[39], f[40], f[41] = 0.0, -1.0, NO_READINGS, 0.0
        if read > FEW and b[BEYOND_READINGS] > FEW:
            residual = solve_plane(b, BEYOND_RAYS, b[BEYOND_READINGS], plane)
            if residual >= 0.0:
                nearer = s[RAYS] - plane[0] * s[RAYS + 1] - plane[1] * s[RAYS + 2] - plane[2] * read
                f[38] = nearer / read * z * z
                f[39], f[40] = f[38] / size_m, math.log(math.sqrt(max(residual, 1e-12)) * z * z + 1e-4)
                f[41] = plane[1] / (math.sqrt(plane[0] ** 2 + plane[1] ** 2 + plane[2] ** 2) + 1e-9)
        f[42], f[43] = s[NORMAL + 2] / area, s[NORMAL + 1] / area
        f[44] = 0.5 * (tree.boxes[i, 0] + tree.boxes[i, 2]) / shape[1]
        f[45] = 0.5 * (tree.boxes[i, 1] + tree.boxes[i, 3]) / shape[0]
        f[46] = math.log(area)
        place_in_tree(tree, i, links, f)
        f[53] = number
        f[55] = f[22] / (f[17] + 1.0)


@kernel(error_model="numpy")
def place_in_tree(tree, i, links, f):
    """Compute the quantities of a region that its tree gives."""
    area = tree.sums[i, PIXELS]
    f[47] = math.log(tree.joined[i] + 1e-6) if tree.joined[i] > 0.0 else NO_READINGS
    f[48] = math.log(tree.left[i] + 1e-6) if tree.left[i] > 0.0 else NO_JOIN
    f[49] = f[48] - f[47]
    f[50], f[51], f[54] = 0.0, 0.0, 1.0
    f[52] = area / tree.sums[tree.parent[i], PIXELS] if tree.parent[i] >= 0 else 1.0
    first, second = tree.parts[i, 0], tree.parts[i, 1]
    if first < 0:
        return
    a, b, gap = tree.sums[first, PIXELS], tree.sums[second, PIXELS], 0.0
    for k in range(3):
        gap += (tree.sums[first, COLOR + k] / a - tree.sums[second, COLOR + k] / b) ** 2
    f[50], f[51] = min(a, b) / area, math.sqrt(gap)
    f[54] = links / max(tree.borders[first, LINKS] + tree.borders[second, LINKS], 1.0)


@kernel
def count_leaves(rectangles, starts, flat, labels, counts):
    """Count the pixels of each leaf in each mask, (N, M) float32; see `sums.mask_sums`. Zeros at first."""
    for m in range(len(rectangles)):
        x0, y0, x1, y1 = rectangles[m, 0], rectangles[m, 1], rectangles[m, 2], rectangles[m, 3]
        for v in range(y0, y1):
            for u in range(x0, x1):
                if flat[starts[m] + (v - y0) * (x1 - x0) + u - x0]:
                    counts[labels[v, u], m] += 1.0


@kernel
def compare_surfaces(tree, count, leaves, sizes, scores, usable, counts, found):
    """Compute the two quantities of surfaces: the last two columns of `found`.

    Parameters
    ----------
    tree : Tree
    count, leaves : int
        Number of its regions, and of its leaves.
    sizes, scores : (M,) float32
        Pixels and score of each surface.
    usable : (count,) uint8
    counts : (count, M) float32, in and out
        Pixels of each region in each surface; those of the leaves are given.
    found : (count, Q) float32, output
    """
    last = found.shape[1] - 1
    for i in range(count):
        if i >= leaves:
            a, b = tree.parts[i, 0], tree.parts[i, 1]
            for m in range(len(sizes)):
                counts[i, m] = counts[a, m] + counts[b, m]
        found[i, last - 1] = found[i, last] = 0.0
        if not usable[i]:
            continue
        for m in range(len(sizes)):
            if counts[i, m] > 0.0:
                iou = counts[i, m] / (np.float32(tree.sums[i, PIXELS]) + sizes[m] - counts[i, m])
                found[i, last - 1] = max(found[i, last - 1], iou)
                found[i, last] = max(found[i, last], iou * scores[m])
