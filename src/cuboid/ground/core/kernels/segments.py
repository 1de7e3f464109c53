"""Hot loops that divide one depth image into surface segments.

All work on inverse depth w = 1/z: a plane is linear in w over the image, collinear points stay collinear,
and the noise of a disparity sensor is uniform in w.
"""

from __future__ import annotations

import numpy as np

from cuboid.ground.compiling.compiled import kernel
from cuboid.ground.core.tolerances import JUMP_SIGMAS

# Kinds of pixels: without a reading, on a large plane, on another surface, too far away.
NONE, PLANE, SURFACE, FAR = 0, 1, 2, 3
# Bits of the marks of a pixel: depth jump to the right, depth jump below, concave crease at the pixel; GROOVE: a crease
# sharper than those of one solid.
RIGHT, DOWN, CREASE, GROOVE = 1, 2, 4, 8
# Longest arm of the crease test to either side, pixels.
LONGEST = 10
# A pixel in a queue is its row, shifted by this many bits, plus its column: a division takes ten times longer.
PLACE_BITS = 16
COLUMN_MASK = (1 << PLACE_BITS) - 1


@kernel(error_model="numpy")
def mark(inverse, kind, focal, noise, jump, arm, bend, groove, smooth, marks):
    """Mark depth jumps between neighbours, and concave creases on surfaces.

    Parameters
    ----------
    inverse, kind : see `patches.classify`
    focal : float
        Pixels.
    noise : float
        Standard deviation of 1/z, 1/metre.
    jump : float
        Least jump, metres.
    arm : float
        Half the length of surface over which a crease is judged, metres; longer where noise requires it.
    bend : float
        Smallest depth of a crease behind the chord over it, as a fraction of the arm.
    groove : float
        The same for a groove.
    smooth : (H, W) float32, output
        1/z averaged over the 3 x 3 neighbours on the same surface; 0 off surfaces.
    marks : (H, W) uint8, output
        Bits RIGHT, DOWN, CREASE, GROOVE.
    """
    height, width = inverse.shape
    mark_jumps(inverse, kind, noise, jump, smooth, marks)
    # A margin without surface surrounds the image, so that no arm ends outside.
    wide = np.zeros((height + 2 * LONGEST, width + 2 * LONGEST), np.float32)
    for v in range(height):
        for u in range(width):
            wide[v + LONGEST, u + LONGEST] = smooth[v, u]
    # The ends of the arms lie within three arm lengths of the crease in depth: no jump lies between.
    lengths = np.arange(LONGEST + 1)
    reaches, sags = 3.0 * lengths / focal, 2.0 * bend * lengths / focal
    flat, long = wide.reshape(-1), wide.shape[1]
    for v in range(height):
        for u in range(width):
            if kind[v, u] != SURFACE:
                continue
            w = smooth[v, u]
            # After smoothing, the depth behind the chord has a standard deviation of 0.6 noise / w^2: 2.5 suffice.
            length = max(arm, 1.5 * noise / (w * w * bend))
            k = min(max(int(length * focal * w + 0.5), 2), LONGEST)
            slant = (k * 3 + 2) // 4
            reach, min_sag = reaches[k] * w, sags[k] * w
            center = (v + LONGEST) * long + u + LONGEST
            # All four directions without a branch: the branch predictor cannot predict which one is a crease.
            deepest = sag(flat, center, k, w, reach)
            deepest = max(deepest, sag(flat, center, k * long, w, reach))
            deepest = max(deepest, sag(flat, center, slant * (long + 1), w, reach))
            deepest = max(deepest, sag(flat, center, slant * (long - 1), w, reach))
            marks[v, u] |= (CREASE if deepest > min_sag else 0) | (GROOVE if deepest > groove / bend * min_sag else 0)


@kernel(inline="always")
def sag(smooth, center, arm, w, reach):
    """Return twice the depth, in 1/z, of the surface behind the chord between the pixels `arm` before and after one.

    `center` and `arm` are flat indices. It is 0 if an end of the chord differs from the pixel by more than `reach` in
    1/z.
    """
    # Unsigned: numba then skips the handling of negative indices.
    p, q = smooth[np.uintp(center - arm)], smooth[np.uintp(center + arm)]
    near = (p > 0.0) & (q > 0.0) & (abs(p - w) <= reach) & (abs(q - w) <= reach)
    return p + q - 2.0 * w if near else 0.0


@kernel(inline="always")
def with_near(x, w, limit, total, n):
    """Add a neighbour on the same surface to the running sum and count."""
    near = (x > np.float32(0.0)) & (abs(x - w) < limit)
    return total + (x if near else np.float32(0.0)), n + (np.float32(1.0) if near else np.float32(0.0))


@kernel(error_model="numpy")
def mark_jumps(inverse, kind, noise, jump, smooth, marks):
    """Mark depth jumps between neighbours, and write the smoothed 1/z of surfaces; see `mark`."""
    height, width = inverse.shape
    # Same float type as the readings, so that the compiler can vectorise with twice the width.
    jump, noise_limit, none = np.float32(jump), np.float32(JUMP_SIGMAS * noise), np.float32(0.0)
    # A margin without readings surrounds the image, so that neighbours need no bounds check.
    wide = np.zeros((height + 3, width + 3), np.float32)
    for v in range(height):
        for u in range(width):
            wide[v + 1, u + 1] = inverse[v, u]
    for v in range(height):
        above, row, below, next_ = wide[v], wide[v + 1], wide[v + 2], wide[v + 3]
        # No branches, so that the compiler can vectorise the loop.
        for u in range(width):
            w = row[u + 1]
            # A depth jump dz is a jump dw = dz w^2 in inverse depth.
            limit = jump * w * w + noise_limit
            total = n = none
            for k in range(3):
                total, n = with_near(above[u + k], w, limit, total, n)
            for k in range(3):
                total, n = with_near(row[u + k], w, limit, total, n)
            for k in range(3):
                total, n = with_near(below[u + k], w, limit, total, n)
            smooth[v, u] = total / n if (w > none) & (kind[v, u] == SURFACE) else none
        for u in range(width):
            limit = jump * row[u + 1] * row[u + 1] + noise_limit
            right = jumps(row[u], row[u + 1], row[u + 2], row[u + 3], limit)
            down = jumps(above[u + 1], row[u + 1], below[u + 1], next_[u + 1], limit)
            marks[v, u] = (RIGHT if right else 0) | (DOWN if down else 0)


@kernel(inline="always")
def jumps(before, first, second, after, limit):
    """Return whether depth jumps between two neighbours, unless the step continues the slope of either surface.

    The arguments are 1/z of four pixels in a row, and the largest step.
    """
    step = abs(first - second)
    none = np.float32(0.0)
    far = (first > none) & (second > none) & (step > limit)
    as_before = (before > none) & (abs(first + first - before - second) < limit) & (abs(first - before) < step + step)
    as_after = (after > none) & (abs(second + second - after - first) < limit)
    return far & ~(as_before | as_after)


@kernel(inline="always")
def linked(kind, marks, v, u, vv, uu):
    """Return whether two 4-neighbours lie on one surface."""
    if kind[vv, uu] != SURFACE:
        return False
    if vv == v:
        return (marks[v, min(u, uu)] & RIGHT) == 0
    return (marks[min(v, vv), u] & DOWN) == 0


@kernel
def label_surfaces(kind, marks, min_pixels, max_labels, labels, queue):
    """Number the segments: surface patches between jumps and creases.

    The cores, at least one pixel away from any jump or crease, are numbered first. They then grow back, nearest pixels
    first, so that a gap of two pixels in a crease does not join two segments. Surfaces without a core follow last.

    Parameters
    ----------
    kind, marks : see `mark`
        The kind of pixels in patches smaller than `min_pixels` becomes NONE.
    min_pixels : int
    max_labels : int
        Largest number of patches; further ones are dropped.
    labels : (H, W) int16, output
        From 1; 0 elsewhere.
    queue : (H * W,) int32, scratch

    Returns
    -------
    int
        The last label.
    """
    height, width = kind.shape
    labels[:] = 0
    core = cores(kind, marks)
    last = label_cores(kind, marks, core, min_pixels, labels, queue, max_labels)
    grow_back(kind, marks, labels, queue)
    for v in range(height):
        for u in range(width):
            if kind[v, u] != SURFACE or labels[v, u] != 0:
                continue
            n = flood(kind, marks, core, False, v, u, last + 1, labels, queue)
            if n >= min_pixels and last < max_labels:
                last += 1
            else:
                for i in range(n):
                    labels[queue[i] >> PLACE_BITS, queue[i] & COLUMN_MASK] = 0
                    kind[queue[i] >> PLACE_BITS, queue[i] & COLUMN_MASK] = NONE
    return last


@kernel
def cores(kind, marks):
    """Return the surface pixels (H, W) that touch neither a jump nor a crease, 1 or 0."""
    height, width = kind.shape
    core = np.zeros((height, width), np.uint8)
    for v in range(1, height - 1):
        # No branches, so that the compiler can vectorise the loop.
        for u in range(1, width - 1):
            unmarked = (marks[v, u] | (marks[v, u - 1] & RIGHT) | (marks[v - 1, u] & DOWN)) == 0
            creased = marks[v - 1, u] | marks[v + 1, u] | marks[v, u - 1] | marks[v, u + 1]
            surrounded = (kind[v - 1, u] == SURFACE) & (kind[v + 1, u] == SURFACE)
            surrounded &= (kind[v, u - 1] == SURFACE) & (kind[v, u + 1] == SURFACE)
            core[v, u] = unmarked & surrounded & (kind[v, u] == SURFACE) & ((creased & CREASE) == 0)
    return core


@kernel
def label_cores(kind, marks, core, min_pixels, labels, queue, max_labels):
    """Number the cores of surfaces of at least `min_pixels` // 2, at most `max_labels`; return the last number."""
    height, width = kind.shape
    last = 0
    for v in range(height):
        for u in range(width):
            if core[v, u] == 0 or labels[v, u] != 0 or last == max_labels:
                continue
            n = flood(kind, marks, core, True, v, u, last + 1, labels, queue)
            if n >= min_pixels // 2:
                last += 1
            else:
                for i in range(n):
                    labels[queue[i] >> PLACE_BITS, queue[i] & COLUMN_MASK] = 0
                    core[queue[i] >> PLACE_BITS, queue[i] & COLUMN_MASK] = 0
    return last


@kernel
def grow_back(kind, marks, labels, queue):
    """Grow all cores at once into the pixels that are linked to them."""
    height, width = kind.shape
    tail = 0
    for v in range(height):
        for u in range(width):
            if labels[v, u] != 0:
                queue[tail] = (v << PLACE_BITS) | u
                tail += 1
    head = 0
    while head < tail:
        v, u = queue[head] >> PLACE_BITS, queue[head] & COLUMN_MASK
        head += 1
        for k in range(4):
            vv, uu = v + (k == 0) - (k == 1), u + (k == 2) - (k == 3)
            if vv < 0 or uu < 0 or vv >= height or uu >= width or labels[vv, uu] != 0:
                continue
            if linked(kind, marks, v, u, vv, uu):
                labels[vv, uu] = labels[v, u]
                queue[tail] = (vv << PLACE_BITS) | uu
                tail += 1


@kernel
def flood(kind, marks, core, cores_only, v0, u0, label, labels, queue):
    """Label all pixels that are linked to a first pixel; return their number. The queue lists them."""
    height, width = kind.shape
    queue[0] = (v0 << PLACE_BITS) | u0
    labels[v0, u0] = label
    head, tail = 0, 1
    while head < tail:
        v, u = queue[head] >> PLACE_BITS, queue[head] & COLUMN_MASK
        head += 1
        for k in range(4):
            vv, uu = v + (k == 0) - (k == 1), u + (k == 2) - (k == 3)
            if vv < 0 or uu < 0 or vv >= height or uu >= width or labels[vv, uu] != 0:
                continue
            if cores_only and core[vv, uu] == 0:
                continue
            if linked(kind, marks, v, u, vv, uu):
                labels[vv, uu] = label
                queue[tail] = (vv << PLACE_BITS) | uu
                tail += 1
    return tail
