"""Hot loop: how many points of each object a frame sees."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cuboid.boxes.kernels.extents import ends_at
from cuboid.core.compiled import kernel
from cuboid.core.tolerances import NEAREST_M, SIGMAS
from cuboid.geometry.kernels.overlap import BATCH, SLACK_M


class Surfaces(NamedTuple):
    """The points of objects, those of one after those of the other.

    Attributes
    ----------
    points : (N, 3) float32
        World, metres.
    colors : (N, 3) uint8
    ends : (n,) int64
        Where each object's points end.
    feet : (n, 4) float64
        The plane that each stands on: its unit normal, and normal.p of all that lies on it.
    numbers : (n,) int64
        The objects.
    """

    points: npt.NDArray[np.float32]
    colors: npt.NDArray[np.uint8]
    ends: npt.NDArray[np.int64]
    feet: npt.NDArray[np.float64]
    numbers: npt.NDArray[np.int64]


class View(NamedTuple):
    """What a frame shows, and of which object that is.

    Attributes
    ----------
    depth : (h, w) float32
        Metres, 0 none.
    color : (h, w, 3) uint8
    slots : (h, w) int32
        Voxel of each pixel, -1 none.
    owner : (N,) int32
        Number of the object that each voxel belongs to.
    camera : (4,) float64
        fx, fy, cx, cy.
    T_camera_world : (4, 4) float64
    """

    depth: npt.NDArray[np.float32]
    color: npt.NDArray[np.uint8]
    slots: npt.NDArray[np.int32]
    owner: npt.NDArray[np.int32]
    camera: npt.NDArray[np.float64]
    T_camera_world: npt.NDArray[np.float64]


@kernel
def count_seen(surfaces, view, noise, agree, alike, counts, corners):
    """Count, for each object, its points that a frame sees, those that it hides, and those it says nothing of.

    A point is seen when the reading at its pixel agrees with it; where there is none, when the color does. One behind
    a reading of its own object counts not at all; any other with a reading is hidden, and any other without, or
    outside the picture, is one of which nothing is said.

    An object stands on its foot, and goes on down to it below each of its points, also where that is dark or shines and
    has no depth: there, every other point tells where it is once more, and counts not.

    Parameters
    ----------
    surfaces : Surfaces
    view : View
    noise : float
        Standard deviation of depth is this times z squared.
    agree : float
        A reading within this of a point agrees with it, metres, or within three standard deviations.
    alike : int
        A color agrees when no channel is farther off, of 255.
    counts : (n, 3) int64, output
        Points seen, hidden, and unknown.
    corners : (n, 4) float64, output
        Rectangle around the points ahead that nothing nearer hides, see `ends_at`, in pixels, within the picture or
        not: left, top, right, bottom; infinite, the left beyond the right, where there are none.
    """
    points, colors, ends, feet, numbers = surfaces
    depth, color, slots, owner, camera, T = view
    height, width = depth.shape
    begin = 0
    across, down = np.empty(2 * points.shape[0]), np.empty(2 * points.shape[0])
    places = np.empty((3, 2 * points.shape[0]))
    for k in range(ends.size):
        seen = hidden = unknown = around = 0
        count = ends[k] - begin
        total = count + (count + 1) // 2
        pictured(points[begin : ends[k]], feet[k], T, camera, places[:, :total])
        for n in range(total):
            i = begin + (n if n < count else 2 * (n - count))
            u, v, ahead = places[0, n], places[1, n], places[2, n]
            z = max(ahead, NEAREST_M)
            reading, same, mine = 0.0, False, False
            if ahead > NEAREST_M:
                x, y = int(np.rint(u)), int(np.rint(v))
                if 0 <= x < width and 0 <= y < height:
                    reading, row, same = depth[y, x], slots[y, x], True
                    mine = row >= 0 and owner[row] == numbers[k]
                    for c in range(3):
                        same &= abs(np.int64(color[y, x, c]) - np.int64(colors[i, c])) <= alike
            within = max(agree, SIGMAS * noise * z * z)
            if ahead > NEAREST_M and (mine or not 0.0 < reading < z - within):
                # As far beyond the picture as it is wide: one beside the camera is infinitely far out.
                across[around], down[around] = min(max(u, -width), 2.0 * width), min(max(v, -height), 2.0 * height)
                around += 1
            if n >= count:
                continue
            if abs(reading - z) <= within if reading > 0.0 else same:
                seen += 1
            elif reading <= 0.0:
                unknown += 1
            elif not (mine and reading < z - within):
                hidden += 1
        counts[k, 0], counts[k, 1], counts[k, 2] = seen, hidden, unknown
        corners[k, 0], corners[k, 2] = ends_at(across[:around])
        corners[k, 1], corners[k, 3] = ends_at(down[:around])
        begin = ends[k]


@kernel(error_model="numpy")
def pictured(points, foot, T, camera, places):
    """Tell where in the picture points (N, 3) are, and then where below them every other one stands; see `count_seen`.

    Written to `places` (3, M) float64: column and row, and how far ahead.
    """
    ux, uy, uz, low = foot
    count = points.shape[0]
    us, vs, zs = places[0], places[1], places[2]
    # Without a branch: so one instruction takes several points.
    for i in range(count):
        us[i], vs[i], zs[i] = np.float64(points[i, 0]), np.float64(points[i, 1]), np.float64(points[i, 2])
    for i in range(us.size - count):
        px, py, pz = us[2 * i], vs[2 * i], zs[2 * i]
        above = px * ux + py * uy + pz * uz - low
        us[count + i], vs[count + i], zs[count + i] = px - above * ux, py - above * uy, pz - above * uz
    for i in range(us.size):
        px, py, pz = us[i], vs[i], zs[i]
        ahead = px * T[2, 0] + py * T[2, 1] + pz * T[2, 2] + T[2, 3]
        z = max(ahead, NEAREST_M)
        us[i] = (px * T[0, 0] + py * T[0, 1] + pz * T[0, 2] + T[0, 3]) / z * camera[0] + camera[2]
        vs[i] = (px * T[1, 0] + py * T[1, 1] + pz * T[1, 2] + T[1, 3]) / z * camera[1] + camera[3]
        zs[i] = ahead


@kernel
def may_be_in_frustum(bounds, T, camera, width, height, far):
    """Tell whether any box within bounds (7,), see `overlap.bound`, may reach into a picture; as `boxes_in_frustum`."""
    if bounds[0] > bounds[3]:
        return False
    # All centres lie within a sphere; what `boxes_in_frustum` asks of them is linear once it is multiplied by their
    # depth.
    x, y, z = 0.5 * (bounds[0] + bounds[3]), 0.5 * (bounds[1] + bounds[4]), 0.5 * (bounds[2] + bounds[5])
    dx, dy, dz = bounds[3] - bounds[0], bounds[4] - bounds[1], bounds[5] - bounds[2]
    within, radius = 0.5 * np.sqrt(dx * dx + dy * dy + dz * dz) + SLACK_M, bounds[6]
    ahead = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
    if ahead + within <= NEAREST_M or ahead - within - radius >= far:
        return False
    across = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
    down = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
    for side, f, c, end in ((across, camera[0], camera[2], width), (down, camera[1], camera[3], height)):
        low, high = f * (side + radius) + c * ahead, f * (radius - side) + (end - c) * ahead
        if low <= -within * np.sqrt(f * f + c * c) or high <= -within * np.sqrt(f * f + (end - c) * (end - c)):
            return False
    return True


@kernel
def boxes_in_frustum(boxes, bounds, T_camera_world, camera, width, height, far, found):
    """Find the boxes that reach into a picture with their bounding spheres.

    Parameters
    ----------
    boxes : (N, 15) float64
        See `overlap.intersections`; a row of NaN is in no picture.
    bounds : (M, 7) float64
        See `overlap.bound`.
    T_camera_world : (4, 4) float64
    camera : (4,) float64
        fx, fy, cx, cy.
    width, height : int
        Of the picture, pixels.
    far : float
        Spheres that begin farther away are not seen, metres; nor is what is nearer than `NEAREST_M`.
    found : (N,) int64, output
        Rows, ascending.

    Returns
    -------
    int
        How many there are.
    """
    T, n = T_camera_world, 0
    rows = boxes.shape[0]
    for batch in range((rows + BATCH - 1) // BATCH):
        if not may_be_in_frustum(bounds[batch], T, camera, width, height, far):
            continue
        for k in range(batch * BATCH, min((batch + 1) * BATCH, rows)):
            px, py, pz = boxes[k, 0], boxes[k, 1], boxes[k, 2]
            z = T[2, 0] * px + T[2, 1] * py + T[2, 2] * pz + T[2, 3]
            long, wide, high = boxes[k, 3], boxes[k, 4], boxes[k, 5]
            radius = 0.5 * np.sqrt(long * long + wide * wide + high * high)
            if not (z > NEAREST_M and z - radius < far):
                continue
            u = (T[0, 0] * px + T[0, 1] * py + T[0, 2] * pz + T[0, 3]) / z * camera[0] + camera[2]
            v = (T[1, 0] * px + T[1, 1] * py + T[1, 2] * pz + T[1, 3]) / z * camera[1] + camera[3]
            reach_u, reach_v = radius / z * camera[0], radius / z * camera[1]
            if u + reach_u > 0 and u - reach_u < width and v + reach_v > 0 and v - reach_v < height:
                found[n] = k
                n += 1
    return n
