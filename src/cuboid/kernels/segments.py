"""Hot loops that cut one depth image into surfaces and tell how these touch.

All work on inverse depth w = 1/z: a plane is linear in w over the image, collinear points stay collinear,
and a disparity sensor's noise is the same everywhere in w.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from cuboid.kernels.cells import AREA, CX, CY, CZ, NX, NY, NZ, RMS

# Kinds of pixels.
NONE, PLANE, SURFACE, FAR = 0, 1, 2, 3
# Bits of the marks of a pixel: depth jumps to its right, below it; a concave crease runs through it.
RIGHT, DOWN, CREASE = 1, 2, 4


@njit(cache=True, nogil=True)
def grow_planes(cells, shape, camera, size, noise, bias, flat, least_area, planes, member):
    """Join the flat cells of a frame to its large planes.

    Parameters
    ----------
    cells : (R * C, 8) float64
        From `fit_cells`.
    shape : (int, int)
        R, C.
    camera : (4,) float64
        fx, fy, cx, cy.
    size : int
        Edge of a cell, pixels.
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
        head, tail = 0, 1
        queue[0] = seed
        tried[seed // columns, seed % columns] = attempt
        # Normal equations of 1/z = a u + b v + c over the cells' centres.
        m = np.zeros(9)
        area = 0.0
        a, b, c = cell_plane(cells[seed], camera)
        fitted = 1
        while head < tail:
            here = queue[head]
            head += 1
            cell = cells[here]
            w = 1.0 / cell[CZ]
            u, v = cell[CX] * w * camera[0] + camera[2], cell[CY] * w * camera[1] + camera[3]
            area += cell[AREA]
            m[0] += u * u
            m[1] += u * v
            m[2] += u
            m[3] += v * v
            m[4] += v
            m[5] += 1.0
            m[6] += u * w
            m[7] += v * w
            m[8] += w
            if head >= 9 and head >= 1.5 * fitted:
                fitted = head
                ok, a2, b2, c2 = solve3(m)
                if ok:
                    a, b, c = a2, b2, c2
            r, q = here // columns, here % columns
            nx, ny, nz = plane_normal(a, b, c, camera)
            for k in range(4):
                rr, qq = r + (k == 0) - (k == 1), q + (k == 2) - (k == 3)
                if rr < 0 or qq < 0 or rr >= rows or qq >= columns:
                    continue
                if member[rr, qq] >= 0 or tried[rr, qq] == attempt:
                    continue
                other = cells[rr * columns + qq]
                if other[AREA] <= 0.0 or other[RMS] > flat:
                    continue
                ww = 1.0 / other[CZ]
                uu, vv = other[CX] * ww * camera[0] + camera[2], other[CY] * ww * camera[1] + camera[3]
                if abs(a * uu + b * vv + c - ww) > 2.0 * noise + bias:
                    continue
                if nx * other[NX] + ny * other[NY] + nz * other[NZ] < 0.9:
                    continue
                tried[rr, qq] = attempt
                queue[tail] = rr * columns + qq
                tail += 1
        if area < least_area or tail < 9:
            continue
        ok, a2, b2, c2 = solve3(m)
        if ok:
            a, b, c = a2, b2, c2
        for i in range(tail):
            member[queue[i] // columns, queue[i] % columns] = count
        planes[count, 0], planes[count, 1], planes[count, 2] = a, b, c
        count += 1
    return count


@njit(cache=True, nogil=True, inline="always")
def cell_plane(cell, camera):
    """Return a, b, c of 1/z = a u + b v + c of a cell: n.p = n.center, divided by z and by n.center."""
    d = cell[NX] * cell[CX] + cell[NY] * cell[CY] + cell[NZ] * cell[CZ]
    a, b = cell[NX] / (d * camera[0]), cell[NY] / (d * camera[1])
    return a, b, cell[NZ] / d - a * camera[2] - b * camera[3]


@njit(cache=True, nogil=True, inline="always")
def plane_normal(a, b, c, camera):
    """Return the unit normal, towards the camera, of the plane 1/z = a u + b v + c."""
    nx, ny, nz = a * camera[0], b * camera[1], a * camera[2] + b * camera[3] + c
    norm = -np.sqrt(nx * nx + ny * ny + nz * nz)
    return nx / norm, ny / norm, nz / norm


@njit(cache=True, nogil=True)
def solve3(m):
    """Solve the normal equations (uu, uv, u, vv, v, 1; uw, vw, w) of a plane by Cramer's rule on centred sums."""
    n = m[5]
    mu, mv, mw = m[2] / n, m[4] / n, m[8] / n
    uu, uv, vv = m[0] / n - mu * mu, m[1] / n - mu * mv, m[3] / n - mv * mv
    uw, vw = m[6] / n - mu * mw, m[7] / n - mv * mw
    det = uu * vv - uv * uv
    if det <= 1e-3:
        return False, 0.0, 0.0, 0.0
    a, b = (uw * vv - vw * uv) / det, (vw * uu - uw * uv) / det
    return True, a, b, mw - a * mu - b * mv


@njit(cache=True, nogil=True)
def classify(
    depth, cells, planes, count, member, camera, size, reach, noise, floor, bias, max_depth, inverse, kind, on
):  # fmt: skip
    """Tell pixels on a large plane from those on any other surface.

    A plane reaches `reach` cells beyond its own; there and within it a reading belongs to it that is no farther
    from it, at right angles, than max(floor, bias + 3 standard deviations). Where its cells bow (lens, baseline), the
    plane bows with them.

    Parameters
    ----------
    depth : (H, W) float32
        Metres, 0 none.
    cells, planes, count, member, camera, size
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
    height, width = depth.shape
    rows, columns = member.shape
    normals = np.empty((count, 4))
    for p in range(count):
        a, b, c = planes[p, 0], planes[p, 1], planes[p, 2]
        nx, ny, nz = plane_normal(a, b, c, camera)
        normals[p, 0], normals[p, 1], normals[p, 2] = nx, ny, nz
    near = np.empty(count, np.int32)
    bow = np.empty(count, np.float64)
    for r in range((height + size - 1) // size):
        for q in range((width + size - 1) // size):
            n = 0
            for p in range(count):
                total = weight = 0.0
                for rr in range(max(0, r - reach), min(rows, r + reach + 1)):
                    for qq in range(max(0, q - reach), min(columns, q + reach + 1)):
                        if member[rr, qq] == p:
                            cell = cells[rr * columns + qq]
                            w = 1.0 / cell[CZ]
                            u, v = cell[CX] * w * camera[0] + camera[2], cell[CY] * w * camera[1] + camera[3]
                            share = 1.0 / (1.0 + (rr - r) * (rr - r) + (qq - q) * (qq - q))
                            total += share * (w - planes[p, 0] * u - planes[p, 1] * v - planes[p, 2])
                            weight += share
                if weight > 0.0:
                    near[n] = p
                    bow[n] = total / weight
                    n += 1
            for v in range(r * size, min(height, (r + 1) * size)):
                for u in range(q * size, min(width, (q + 1) * size)):
                    z = depth[v, u]
                    on[v, u] = -1
                    if not z > 0.0:
                        inverse[v, u] = 0.0
                        kind[v, u] = NONE
                        continue
                    w = 1.0 / z
                    if z > max_depth:
                        inverse[v, u] = w
                        kind[v, u] = FAR
                        continue
                    inverse[v, u] = w
                    kind[v, u] = SURFACE
                    rx, ry = (u - camera[2]) / camera[0], (v - camera[3]) / camera[1]
                    for i in range(n):
                        p = near[i]
                        expected = planes[p, 0] * u + planes[p, 1] * v + planes[p, 2] + bow[i]
                        facing = abs(normals[p, 0] * rx + normals[p, 1] * ry + normals[p, 2])
                        # dz = z^2 dw, and at right angles to the plane dz times n.ray
                        across = abs(expected - w) * z * z * facing
                        if across < max(floor, bias + 3.0 * noise * z * z * facing):
                            kind[v, u] = PLANE
                            on[v, u] = p
                            break


@njit(cache=True, nogil=True)
def mark(inverse, kind, focal, noise, jump, arm, bend, smooth, marks):
    """Mark depth jumps between neighbours, and concave creases on surfaces.

    Parameters
    ----------
    inverse, kind : see `classify`
    focal : float
        Pixels.
    noise : float
        Standard deviation of 1/z, 1/metre.
    jump : float
        Least jump, metres.
    arm : float
        Half the length of surface over which a crease is judged, metres; more where noise asks for it.
    bend : float
        A crease lies behind the chord over it by at least this times the arm.
    smooth : (H, W) float32, output
        1/z averaged over the 3 x 3 neighbours on the same surface; 0 off surfaces.
    marks : (H, W) uint8, output
        Bits RIGHT, DOWN, CREASE.
    """
    height, width = inverse.shape
    for v in range(height):
        for u in range(width):
            marks[v, u] = 0
            smooth[v, u] = 0.0
            w = inverse[v, u]
            if w <= 0.0:
                continue
            # A jump dz is dw = dz w^2.
            limit = jump * w * w + 4.0 * noise
            if u + 1 < width and inverse[v, u + 1] > 0.0:
                right = inverse[v, u + 1]
                if abs(right - w) > limit:
                    before = inverse[v, u - 1] if u > 0 else np.float32(0.0)
                    after = inverse[v, u + 2] if u + 2 < width else np.float32(0.0)
                    if not continues(before, w, right, after, limit):
                        marks[v, u] |= RIGHT
            if v + 1 < height and inverse[v + 1, u] > 0.0:
                below = inverse[v + 1, u]
                if abs(below - w) > limit:
                    before = inverse[v - 1, u] if v > 0 else np.float32(0.0)
                    after = inverse[v + 2, u] if v + 2 < height else np.float32(0.0)
                    if not continues(before, w, below, after, limit):
                        marks[v, u] |= DOWN
            if kind[v, u] == SURFACE:
                total = 0.0
                n = 0
                for vv in range(max(0, v - 1), min(height, v + 2)):
                    for uu in range(max(0, u - 1), min(width, u + 2)):
                        x = inverse[vv, uu]
                        if x > 0.0 and abs(x - w) < limit:
                            total += x
                            n += 1
                smooth[v, u] = total / n
    for v in range(height):
        for u in range(width):
            if kind[v, u] != SURFACE:
                continue
            w = smooth[v, u]
            # The depth behind the chord has a deviation of 0.6 noise / w^2 after smoothing: 2.5 of them are enough.
            length = max(arm, 1.5 * noise / (w * w * bend))
            k = int(length * focal * w + 0.5)
            k = min(max(k, 2), 10)
            # The arms end at most three lengths before or behind the crease: no jump lies between.
            reach = 3.0 * k / focal * w
            least = 2.0 * bend * k / focal * w
            for direction in range(4):
                dv = k if direction != 0 else 0
                du = k if direction == 0 else 0
                if direction >= 2:
                    dv = (k * 3 + 2) // 4
                    du = dv if direction == 2 else -dv
                v0, u0, v1, u1 = v - dv, u - du, v + dv, u + du
                if v0 < 0 or v1 >= height or u0 < 0 or u1 < 0 or u0 >= width or u1 >= width:
                    continue
                p, q = smooth[v0, u0], smooth[v1, u1]
                if p <= 0.0 or q <= 0.0 or abs(p - w) > reach or abs(q - w) > reach:
                    continue
                if p + q - 2.0 * w > least:
                    marks[v, u] |= CREASE
                    break


@njit(cache=True, nogil=True, inline="always")
def continues(before, here, there, after, limit):
    """Whether a step from here to there goes on as the surface on either side does."""
    if before > 0.0 and abs(2.0 * here - before - there) < limit and abs(here - before) < abs(here - there) * 2.0:
        return True
    return after > 0.0 and abs(2.0 * there - after - here) < limit


@njit(cache=True, nogil=True, inline="always")
def linked(kind, marks, v, u, vv, uu):
    """Whether two 4-neighbours lie on one surface."""
    if kind[vv, uu] != SURFACE:
        return False
    if vv == v:
        return (marks[v, min(u, uu)] & RIGHT) == 0
    return (marks[min(v, vv), u] & DOWN) == 0


@njit(cache=True, nogil=True)
def label_surfaces(inverse, kind, marks, least, labels, queue, sizes):
    """Number the segments: surface patches between jumps and creases.

    Their cores, one pixel away from any jump or crease, are numbered first and then grow back, the nearest first, so
    that a gap of two pixels in a crease does not join what it parts. What has no core is numbered after that.

    Parameters
    ----------
    inverse, kind, marks : see `mark`
        The kind of patches below `least` pixels becomes NONE.
    least : int
    labels : (H, W) int16, output
        From 1; 0 elsewhere.
    queue : (H * W,) int32, scratch
    sizes : (S,) int32, output
        Pixels of each label; those beyond S - 1 patches are left out.

    Returns
    -------
    int
        The last label.
    """
    height, width = kind.shape
    labels[:] = 0
    sizes[:] = 0
    core = np.zeros((height, width), np.uint8)
    for v in range(1, height - 1):
        for u in range(1, width - 1):
            if kind[v, u] != SURFACE:
                continue
            ok = marks[v, u] == 0 and (marks[v, u - 1] & RIGHT) == 0 and (marks[v - 1, u] & DOWN) == 0
            if ok:
                for k in range(4):
                    vv, uu = v + (k == 0) - (k == 1), u + (k == 2) - (k == 3)
                    if kind[vv, uu] != SURFACE or marks[vv, uu] & CREASE:
                        ok = False
                        break
            if ok:
                core[v, u] = 1
    last = 0
    limit = sizes.size - 1
    for v in range(height):
        for u in range(width):
            if core[v, u] == 0 or labels[v, u] != 0 or last == limit:
                continue
            n = flood(kind, marks, core, True, v, u, last + 1, labels, queue)
            if n >= least // 2:
                last += 1
            else:
                for i in range(n):
                    labels[queue[i] // width, queue[i] % width] = 0
                    core[queue[i] // width, queue[i] % width] = 0
    # Grow back from all cores at once.
    tail = 0
    for v in range(height):
        for u in range(width):
            if labels[v, u] != 0:
                queue[tail] = v * width + u
                tail += 1
    head = 0
    while head < tail:
        v, u = queue[head] // width, queue[head] % width
        head += 1
        for k in range(4):
            vv, uu = v + (k == 0) - (k == 1), u + (k == 2) - (k == 3)
            if vv < 0 or uu < 0 or vv >= height or uu >= width or labels[vv, uu] != 0:
                continue
            if linked(kind, marks, v, u, vv, uu):
                labels[vv, uu] = labels[v, u]
                queue[tail] = vv * width + uu
                tail += 1
    for v in range(height):
        for u in range(width):
            if kind[v, u] != SURFACE or labels[v, u] != 0:
                continue
            n = flood(kind, marks, core, False, v, u, last + 1, labels, queue)
            if n >= least and last < limit:
                last += 1
            else:
                for i in range(n):
                    labels[queue[i] // width, queue[i] % width] = 0
                    kind[queue[i] // width, queue[i] % width] = NONE
    for v in range(height):
        for u in range(width):
            sizes[labels[v, u]] += 1
    return last


@njit(cache=True, nogil=True)
def flood(kind, marks, core, cores_only, v0, u0, label, labels, queue):
    """Label what is linked to a pixel; return how many pixels the queue lists."""
    height, width = kind.shape
    queue[0] = v0 * width + u0
    labels[v0, u0] = label
    head, tail = 0, 1
    while head < tail:
        v, u = queue[head] // width, queue[head] % width
        head += 1
        for k in range(4):
            vv, uu = v + (k == 0) - (k == 1), u + (k == 2) - (k == 3)
            if vv < 0 or uu < 0 or vv >= height or uu >= width or labels[vv, uu] != 0:
                continue
            if cores_only and core[vv, uu] == 0:
                continue
            if linked(kind, marks, v, u, vv, uu):
                labels[vv, uu] = label
                queue[tail] = vv * width + uu
                tail += 1
    return tail
