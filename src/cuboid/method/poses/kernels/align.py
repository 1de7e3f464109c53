"""Hot loops of dense alignment: pack an image, pick points from it, and compute their residuals in another image."""

from __future__ import annotations

import numpy as np

from cuboid.ground.compiling.compiled import kernel

# Channels of a packed image: intensity, its two derivatives per pixel, depth in metres.
INTENSITY, ALONG_U, ALONG_V, DEPTH = range(4)
# Entries of the sums that `accumulate` writes.
IN_IMAGE, WITH_DEPTH, INLIERS, ON_SURFACE, SQUARES_I, SQUARES_D, SHADED = range(7)
SUMS = 7
# Columns of a group's sums: weight, reference intensity, image intensity, their squares, their product.
GROUP_SUMS = 6
# Degrees of freedom of the t-distribution of residuals (Kerl, Sturm, Cremers, ICRA 2013).
FREEDOM = 5.0


@kernel
def pack(gray, depth_m, out):
    """Pack intensity, its derivatives (central differences) and depth, pixel by pixel.

    Parameters
    ----------
    gray : (H, W) uint8
    depth_m : (H, W) float32
        Metres, 0 none.
    out : (H, W, 4) float32, output
        The derivatives of the outermost pixels are 0.
    """
    height, width = gray.shape
    for v in range(height):
        for u in range(width):
            pixel = out[v, u]
            pixel[INTENSITY] = np.float32(gray[v, u])
            inside = 0 < u < width - 1 and 0 < v < height - 1
            pixel[ALONG_U] = 0.5 * (np.float32(gray[v, u + 1]) - np.float32(gray[v, u - 1])) if inside else 0.0
            pixel[ALONG_V] = 0.5 * (np.float32(gray[v + 1, u]) - np.float32(gray[v - 1, u])) if inside else 0.0
            pixel[DEPTH] = depth_m[v, u]


@kernel
def pick_points(image, camera, cell, reach, max_depth, noise, points, normals, intensity):
    """Pick from each cell of an image the pixel with the largest intensity gradient, as a point on a local plane.

    The plane is fitted to the inverse depth of the surrounding (2 reach + 1)^2 pixels that lie on the same surface:
    1/z = a u + b v + c. A pixel gives no point if most of the readings around it are missing or belong to other
    surfaces.

    Parameters
    ----------
    image : (H, W, 4) float32
        Packed image.
    camera : (4,) float64
        fx, fy, cx, cy.
    cell, reach : int
        Pixels.
    max_depth : float
        Metres.
    noise : float
        Standard deviation of a depth reading divided by z squared, 1/metre.
    points, normals : (M, 3) float32, output
        In the camera frame, M at least the number of cells; normals face the camera.
    intensity : (M,) float32, output

    Returns
    -------
    int
        Number of points.
    """
    height, width = image.shape[0], image.shape[1]
    fx, fy, cx, cy = camera[0], camera[1], camera[2], camera[3]
    needed = 0.6 * (2 * reach + 1) * (2 * reach + 1)
    count = 0
    margin = reach
    for top in range(margin, height - margin, cell):
        for left in range(margin, width - margin, cell):
            bu, bv = steepest(
                image, top, left, min(top + cell, height - margin), min(left + cell, width - margin), max_depth
            )
            if bu < 0:
                continue
            # The noise is uniform in 1/z.
            limit = 6.0 * noise + 0.02 * (1.0 / image[bv, bu, DEPTH])
            fixed, a, b, c = plane_around(image, bu, bv, reach, limit, needed)
            if not fixed or c <= 0.0:
                continue
            rx, ry = (bu - cx) / fx, (bv - cy) / fy
            # a (fx x + (cx - u0) z) + b (fy y + (cy - v0) z) + c z = 1
            nx, ny, nz = a * fx, b * fy, a * (cx - bu) + b * (cy - bv) + c
            norm = np.sqrt(nx * nx + ny * ny + nz * nz)
            facing = (nx * rx + ny * ry + nz) / norm
            if facing < 0.15 * np.sqrt(rx * rx + ry * ry + 1.0):  # grazing angle: depth is not reliable
                continue
            z = 1.0 / c
            points[count, 0], points[count, 1], points[count, 2] = rx * z, ry * z, z
            normals[count, 0], normals[count, 1], normals[count, 2] = -nx / norm, -ny / norm, -nz / norm
            intensity[count] = image[bv, bu, INTENSITY]
            count += 1
    return count


@kernel
def steepest(image, top, left, bottom, right, max_depth):
    """Return column and row of the pixel with the largest gradient among those with a reading; -1 if there is none."""
    best, bu, bv = np.float32(-1.0), -1, -1
    for v in range(top, bottom):
        for u in range(left, right):
            z = image[v, u, DEPTH]
            if not (0.0 < z <= max_depth):
                continue
            gu, gv = image[v, u, ALONG_U], image[v, u, ALONG_V]
            steep = gu * gu + gv * gv
            if steep > best:
                best, bu, bv = steep, u, v
    return bu, bv


@kernel
def plane_around(image, bu, bv, reach, limit, needed):
    """Fit 1/z = a u + b v + c to the readings around a pixel, with u and v relative to it.

    Only readings whose 1/z differs by at most `limit` are used. Returns whether at least `needed` of them determine a
    plane, and a, b, c.
    """
    w0 = 1.0 / image[bv, bu, DEPTH]
    n = 0.0
    su = sv = suu = svv = suv = sw = swu = swv = 0.0
    for i in range(-reach, reach + 1):
        for j in range(-reach, reach + 1):
            d = image[bv + i, bu + j, DEPTH]
            if d <= 0.0:
                continue
            w = 1.0 / d - w0
            if abs(w) > limit:
                continue
            n += 1.0
            su += j
            sv += i
            suu += j * j
            svv += i * i
            suv += i * j
            sw += w
            swu += w * j
            swv += w * i
    if n < needed:
        return False, 0.0, 0.0, 0.0
    mu, mv, mw = su / n, sv / n, sw / n
    vuu, vvv, vuv = suu / n - mu * mu, svv / n - mv * mv, suv / n - mu * mv
    det = vuu * vvv - vuv * vuv
    if det <= 1e-6:
        return False, 0.0, 0.0, 0.0
    vwu, vwv = swu / n - mw * mu, swv / n - mw * mv
    a = (vwu * vvv - vwv * vuv) / det
    b = (vwv * vuu - vwu * vuv) / det
    return True, a, b, w0 + mw - a * mu - b * mv


@kernel
def accumulate(
    points, normals, intensity, group, shade, image, camera, T_camera_points, sigma, noise, gate, system, sums, shades
):
    """Sum up the normal equations of a pose over all points: residuals of intensity and of distance to the surface.

    Each point is projected into the image. Its intensity, corrected for the exposure of its group, is compared with
    that of the image (bilinear); the distance along its normal is that to the reading at its pixel. Both residuals are
    weighted by a t-distribution. A point whose reading differs by more than the gate is hidden, or its surface is out
    of view: it is ignored. So is a point whose reading is negative: that pixel moves.

    Parameters
    ----------
    points, normals : (N, 3) float32
    intensity : (N,) float32
    group : (N,) int32
        The image from which each point comes, 0..G - 1.
    shade : (G, 2) float64
        Gain and bias from this image's intensity to that of each group.
    image : (H, W, 4) float32
        Packed image.
    camera : (4,) float64
        fx, fy, cx, cy.
    T_camera_points : (4, 4) float64
    sigma : (2,) float64
        Scale of the residuals: intensity in grey levels, distance as a multiple of depth noise.
    noise : (2,) float64
        The standard deviation of depth is noise[0] + noise[1] z^2, metres.
    gate : (2,) float64
        A reading agrees if it differs by at most gate[0] metres plus gate[1] standard deviations of depth.
    system : (7, 6) float64, output
        Information matrix and, in the last row, the gradient, for a motion xi = (translation, rotation) of the
        camera frame: T <- exp(xi) T.
    sums : (7,) float64, output
        Number of points in view, with a reading, with a reading that agrees, and of these within a centimetre plus
        three standard deviations of it; weighted squared residuals of intensity and of distance, both in units of
        their scale; number of points with an intensity residual.
    shades : (G, 6) float64, output
        Weighted sums of 1, the group's intensity, the image's intensity, the squares of both, and their product.
    """
    system[:] = 0.0
    sums[:] = 0.0
    shades[:] = 0.0
    height, width = image.shape[0], image.shape[1]
    fx, fy, cx, cy = camera[0], camera[1], camera[2], camera[3]
    T = T_camera_points
    J = np.empty(6)
    for k in range(len(points)):
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        qx = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
        qy = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
        qz = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
        if qz < 0.1:
            continue
        u, v = fx * qx / qz + cx, fy * qy / qz + cy
        if not (1.0 <= u < width - 2.0 and 1.0 <= v < height - 2.0):
            continue
        x, y, z = normals[k, 0], normals[k, 1], normals[k, 2]
        nx = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z
        ny = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z
        nz = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z
        if nx * qx + ny * qy + nz * qz > 0.0:  # seen from behind
            continue
        u1, v1 = int(u + 0.5), int(v + 0.5)
        d = image[v1, u1, DEPTH]
        if d < 0.0:  # the pixel moves
            continue
        sums[IN_IMAGE] += 1.0
        deviation = noise[0] + noise[1] * qz * qz
        if d > 0.0:
            sums[WITH_DEPTH] += 1.0
            if abs(d - qz) > gate[0] + gate[1] * deviation:
                continue
            sums[INLIERS] += 1.0
            sx, sy = (u1 - cx) / fx * d, (v1 - cy) / fy * d
            r = (nx * (sx - qx) + ny * (sy - qy) + nz * (d - qz)) / deviation
            if abs(r) * deviation < 0.01 + 3.0 * deviation:
                sums[ON_SURFACE] += 1.0
            r /= sigma[1]
            w = (FREEDOM + 1.0) / (FREEDOM + r * r)
            sums[SQUARES_D] += w * r * r
            s = 1.0 / (deviation * sigma[1])
            J[0], J[1], J[2] = nx * s, ny * s, nz * s
            J[3], J[4], J[5] = (qy * nz - qz * ny) * s, (qz * nx - qx * nz) * s, (qx * ny - qy * nx) * s
            add_equation(system, J, w, r)
        u0, v0 = int(u), int(v)
        a, b = u - u0, v - v0
        w00, w01, w10, w11 = (1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b
        p00, p01, p10, p11 = image[v0, u0], image[v0, u0 + 1], image[v0 + 1, u0], image[v0 + 1, u0 + 1]
        image_intensity = w00 * p00[0] + w01 * p01[0] + w10 * p10[0] + w11 * p11[0]
        g = group[k]
        gain = shade[g, 0]
        gu = (w00 * p00[1] + w01 * p01[1] + w10 * p10[1] + w11 * p11[1]) * gain
        gv = (w00 * p00[2] + w01 * p01[2] + w10 * p10[2] + w11 * p11[2]) * gain
        r = (intensity[k] - gain * image_intensity - shade[g, 1]) / sigma[0]
        w = (FREEDOM + 1.0) / (FREEDOM + r * r)
        sums[SQUARES_I] += w * r * r
        sums[SHADED] += 1.0
        shades[g, 0] += w
        shades[g, 1] += w * intensity[k]
        shades[g, 2] += w * image_intensity
        shades[g, 3] += w * intensity[k] * intensity[k]
        shades[g, 4] += w * image_intensity * image_intensity
        shades[g, 5] += w * intensity[k] * image_intensity
        s = 1.0 / sigma[0]
        ju, jv = gu * fx / qz * s, gv * fy / qz * s
        jz = -(ju * qx + jv * qy) / qz
        J[0], J[1], J[2] = ju, jv, jz
        J[3], J[4], J[5] = qy * jz - qz * jv, qz * ju - qx * jz, qx * jv - qy * ju
        add_equation(system, J, w, r)
    for i in range(6):
        for j in range(i):
            system[i, j] = system[j, i]


@kernel(inline="always")
def add_equation(system, J, w, r):
    """Add a residual r with derivative J (6,) and weight w to the normal equations; see `accumulate`."""
    for i in range(6):
        wj = w * J[i]
        system[6, i] += wj * r
        for j in range(i, 6):
            system[i, j] += wj * J[j]
