"""Hot loops that sum what the quantities of a region need: over its pixels, and over the links that cross its border.

Sums of disjoint regions add up, so that a hierarchy of regions gets all its quantities from those of its leaves. The
border of a union has the links of both parts without those between them.
"""

from __future__ import annotations

import math

from cuboid.ground.compiling.compiled import kernel
from cuboid.method.proposals.kernels.leaves import jump_m

# Columns of the sums over pixels: pixels; CIE Lab and its squares; readings; gradient of color; bend; normal.
PIXELS, COLOR, COLOR2, READINGS, GRADIENT, BEND, NORMAL = 0, 1, 4, 7, 8, 9, 10
# Over readings, with ray (a, b, 1) and inverse depth q: q, a, b, qq, aa, bb, ab, aq, bq, ...
RAYS = 13
# ... and with point (x, y, z): x, y, z, xx, yy, zz, xy, xz, yz.
POINT_SUMS = 22
# Pixels at the border of the image.
CUT_OFF = 31
PIXEL_SUMS = 32
# Columns of the sums over links that leave a region: links; links by side (right, left, down, up).
LINKS, BY_SIDE = 0, 1
# Color difference across; gradient of color; links with a visible edge; depth step across, in jumps.
CONTRAST, EDGE_GRADIENT, EDGES, DEPTH_STEP = 5, 6, 7, 8
# Links beyond which the surface is farther (it ends), nearer (it is hidden), meets in a concave or convex crease, or
# continues.
ENDS, HIDDEN, CONCAVE, CONVEX, CONTINUES = 9, 10, 11, 12, 13
# Links where it ends, by side; where it ends, or meets in a concave crease or at an edge, by side.
ENDS_BY_SIDE, CLOSED_BY_SIDE = 14, 18
# Beyond the border: CIE Lab; readings; the nine sums of RAYS.
BEYOND_COLOR, BEYOND_READINGS, BEYOND_RAYS = 22, 25, 26
LINK_SUMS = 35
# Color difference that is a visible edge, CIE Lab: three times a just noticeable one.
VISIBLE_EDGE = 7.0
# Difference of the normals along the way across a border that is a crease, radians.
CREASE_RAD = 0.35
# Upper limits of a color difference, and of a depth step in jumps: a stronger one says no more.
MAX_CONTRAST, MAX_STEP = 40.0, 6.0


@kernel(inline="always")
def add_rays(sums, first, a, b, q):
    """Add the nine sums of a reading with ray (a, b, 1) and inverse depth q."""
    sums[first] += q
    sums[first + 1] += a
    sums[first + 2] += b
    sums[first + 3] += q * q
    sums[first + 4] += a * a
    sums[first + 5] += b * b
    sums[first + 6] += a * b
    sums[first + 7] += a * q
    sums[first + 8] += b * q


@kernel(inline="always")
def add_pixel(maps, camera, v, u, sums):
    """Add a pixel to the sums of its region.

    Parameters
    ----------
    maps : Maps
    camera : (4,) float64
        fx, fy, cx, cy, pixels.
    v, u : int
    sums : (PIXEL_SUMS,) float64, in and out
    """
    h, w = maps.depth_m.shape
    sums[PIXELS] += 1.0
    for k in range(3):
        level = maps.lab[v, u, k]
        sums[COLOR + k] += level
        sums[COLOR2 + k] += level * level
        sums[NORMAL + k] += maps.normals[v, u, k]
    sums[GRADIENT] += maps.gradient[v, u]
    sums[BEND] += maps.bend[v, u]
    if u == 0 or v == 0 or u == w - 1 or v == h - 1:
        sums[CUT_OFF] += 1.0
    if maps.read[v, u]:
        z = maps.depth_m[v, u]
        a, b = (u - camera[2]) / camera[0], (v - camera[3]) / camera[1]
        sums[READINGS] += 1.0
        add_rays(sums, RAYS, a, b, 1.0 / z)
        x, y = a * z, b * z
        sums[POINT_SUMS] += x
        sums[POINT_SUMS + 1] += y
        sums[POINT_SUMS + 2] += z
        sums[POINT_SUMS + 3] += x * x
        sums[POINT_SUMS + 4] += y * y
        sums[POINT_SUMS + 5] += z * z
        sums[POINT_SUMS + 6] += x * y
        sums[POINT_SUMS + 7] += x * z
        sums[POINT_SUMS + 8] += y * z


@kernel(inline="always")
def add_link(maps, camera, v, u, dv, du, sums):
    """Add the link of a pixel of a region with its neighbour (v + dv, u + du) outside the region.

    Color and depth are compared one pixel inside and two outside, where no pixel mixes the two surfaces; normals, and
    what lies beyond, one pixel farther.

    Parameters
    ----------
    maps : Maps
    camera : (4,) float64
    v, u, dv, du : int
    sums : (LINK_SUMS,) float64, in and out
    """
    depth_m, lab, normals = maps.depth_m, maps.lab, maps.normals
    h, w = depth_m.shape
    side = (0 if du > 0 else 1) if du else (2 if dv > 0 else 3)
    va, ua = min(max(v - dv, 0), h - 1), min(max(u - du, 0), w - 1)
    vb, ub = min(max(v + 2 * dv, 0), h - 1), min(max(u + 2 * du, 0), w - 1)
    vc, uc = min(max(v - 2 * dv, 0), h - 1), min(max(u - 2 * du, 0), w - 1)
    vd, ud = min(max(v + 3 * dv, 0), h - 1), min(max(u + 3 * du, 0), w - 1)
    contrast = 0.0
    for k in range(3):
        contrast += (lab[va, ua, k] - lab[vb, ub, k]) ** 2
    contrast = math.sqrt(contrast)
    za, zb, zc, zd = depth_m[va, ua], depth_m[vb, ub], depth_m[vc, uc], depth_m[vd, ud]
    jump = jump_m(min(za, zb))
    # The smaller of the slopes on both sides, over the three pixels between a and b.
    before, after = za - zc, zd - zb
    slope = before if abs(before) < abs(after) else after
    step, bare = (zb - za - 3.0 * slope) / jump, (zb - za) / jump
    fx, fy, cx, cy = camera[0], camera[1], camera[2], camera[3]
    x = (ud - cx) / fx * zd - (uc - cx) / fx * zc
    y = (vd - cy) / fy * zd - (vc - cy) / fy * zc
    z = zd - zc
    turn = (normals[vd, ud, 0] - normals[vc, uc, 0]) * x + (normals[vd, ud, 1] - normals[vc, uc, 1]) * y
    turn += (normals[vd, ud, 2] - normals[vc, uc, 2]) * z
    turn /= math.sqrt(x * x + y * y + z * z) + 1e-9
    sums[LINKS] += 1.0
    sums[BY_SIDE + side] += 1.0
    sums[CONTRAST] += min(contrast, MAX_CONTRAST)
    sums[EDGE_GRADIENT] += min(max(maps.gradient[v, u], maps.gradient[v + dv, u + du]), MAX_CONTRAST)
    sums[DEPTH_STEP] += min(abs(step), MAX_STEP)
    closed = contrast > VISIBLE_EDGE
    if closed:
        sums[EDGES] += 1.0
    if bare > 1.0 and step > 1.0:
        sums[ENDS] += 1.0
        sums[ENDS_BY_SIDE + side] += 1.0
        closed = True
    elif bare < -1.0 and step < -1.0:
        sums[HIDDEN] += 1.0
    elif turn < -CREASE_RAD:
        sums[CONCAVE] += 1.0
        closed = True
    elif turn > CREASE_RAD:
        sums[CONVEX] += 1.0
    else:
        sums[CONTINUES] += 1.0
    if closed:
        sums[CLOSED_BY_SIDE + side] += 1.0
    for k in range(3):
        sums[BEYOND_COLOR + k] += lab[vd, ud, k]
    if maps.read[vd, ud]:
        sums[BEYOND_READINGS] += 1.0
        add_rays(sums, BEYOND_RAYS, (ud - cx) / fx, (vd - cy) / fy, 1.0 / zd)


@kernel(inline="always")
def widen(box, v, u):
    """Extend a rectangle (left, top, right, bottom; ends exclusive) to a pixel."""
    box[0], box[1] = min(box[0], u), min(box[1], v)
    box[2], box[3] = max(box[2], u + 1), max(box[3], v + 1)


@kernel(error_model="numpy")
def leaf_sums(labels, maps, camera, sums, boxes):
    """Sum over the pixels of each leaf.

    Parameters
    ----------
    labels : (h, w) int32
        Leaf of each pixel.
    maps : Maps
    camera : (4,) float64
    sums : (N, PIXEL_SUMS) float64, in and out
        Zeros at first.
    boxes : (N, 4) int32, in and out
        Empty rectangles (w, h, 0, 0) at first.
    """
    h, w = labels.shape
    for v in range(h):
        for u in range(w):
            i = labels[v, u]
            add_pixel(maps, camera, v, u, sums[i])
            widen(boxes[i], v, u)


@kernel
def number_borders(labels, keys, numbers, ends):
    """Number the pairs of leaves that are neighbours.

    Parameters
    ----------
    labels : (h, w) int32
    keys : (2^k,) int64, output
        Open addressing: the pair at each place, -1: none. At least four places for each pair.
    numbers : (2^k,) int32, output
    ends : (2^k, 2) int32, output
        The lower and the higher leaf of each pair.

    Returns
    -------
    int
        Number of pairs.
    """
    h, w = labels.shape
    for k in range(len(keys)):
        keys[k] = -1
    count = 0
    for v in range(h):
        for u in range(w):
            for side in range(2):
                v2, u2 = v + side, u + 1 - side
                if v2 >= h or u2 >= w or labels[v, u] == labels[v2, u2]:
                    continue
                low, high = min(labels[v, u], labels[v2, u2]), max(labels[v, u], labels[v2, u2])
                place = place_of(keys, low, high)
                if keys[place] == -1:
                    keys[place], numbers[place] = (low << 32) + high, count
                    ends[count, 0], ends[count, 1] = low, high
                    count += 1
    return count


@kernel(inline="always")
def place_of(keys, low, high):
    """Return the place of a pair in the table, or the free place where it belongs."""
    key = (low << 32) + high
    place = (low * 40503 + high * 9973) & (len(keys) - 1)
    while keys[place] != -1 and keys[place] != key:
        place = (place + 1) & (len(keys) - 1)
    return place


@kernel(error_model="numpy")
def border_sums(labels, maps, camera, keys, numbers, sums):
    """Sum over the links between each pair of neighbouring leaves.

    Parameters
    ----------
    labels : (h, w) int32
    maps : Maps
    camera : (4,) float64
    keys, numbers : see `number_borders`
    sums : (B, 2, LINK_SUMS) float64, in and out
        As seen from the lower and from the higher leaf; zeros at first.
    """
    h, w = labels.shape
    for v in range(h):
        for u in range(w):
            for side in range(2):
                v2, u2 = v + side, u + 1 - side
                if v2 >= h or u2 >= w or labels[v, u] == labels[v2, u2]:
                    continue
                low, high = min(labels[v, u], labels[v2, u2]), max(labels[v, u], labels[v2, u2])
                border = sums[numbers[place_of(keys, low, high)]]
                first = 0 if labels[v, u] == low else 1
                add_link(maps, camera, v, u, side, 1 - side, border[first])
                add_link(maps, camera, v2, u2, -side, side - 1, border[1 - first])


@kernel(error_model="numpy")
def mask_sums(rectangles, starts, flat, maps, camera, sums, borders, boxes):
    """Sum over the pixels and over the border of each mask; masks may overlap.

    Parameters
    ----------
    rectangles : (M, 4) int64
    starts : (M,) int64
        Begin of each mask in `flat`.
    flat : (L,) uint8
        The masks one after the other, row by row.
    maps : Maps
    camera : (4,) float64
    sums : (M, PIXEL_SUMS) float64, in and out
    borders : (M, LINK_SUMS) float64, in and out
        Both zeros at first.
    boxes : (M, 4) int32, in and out
        Empty rectangles (w, h, 0, 0) at first.
    """
    h, w = maps.depth_m.shape
    for m in range(len(rectangles)):
        x0, y0, x1, y1 = rectangles[m, 0], rectangles[m, 1], rectangles[m, 2], rectangles[m, 3]
        wide = x1 - x0
        for v in range(y0, y1):
            for u in range(x0, x1):
                at = starts[m] + (v - y0) * wide + u - x0
                if not flat[at]:
                    continue
                add_pixel(maps, camera, v, u, sums[m])
                widen(boxes[m], v, u)
                for side in range(4):
                    du, dv = (1 - 2 * side, 0) if side < 2 else (0, 5 - 2 * side)
                    v2, u2 = v + dv, u + du
                    if v2 < 0 or u2 < 0 or v2 >= h or u2 >= w:
                        continue
                    inside = x0 <= u2 and u2 < x1 and y0 <= v2 and v2 < y1
                    if not (inside and flat[at + dv * wide + du]):
                        add_link(maps, camera, v, u, dv, du, borders[m])
