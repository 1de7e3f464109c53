"""Hot loop: the number of points of each object that a frame sees."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cuboid.ground.compiling.compiled import kernel
from cuboid.ground.core.tolerances import NEAREST_M, SIGMAS
from cuboid.ground.geometry.kernels.overlap import BATCH, SLACK_M
from cuboid.method.boxes.kernels.extents import ends_at


class Surfaces(NamedTuple):
    """The points of several objects, one object after the other.

    Attributes
    ----------
    points : (N, 3) float32
        World, metres.
    colors : (N, 3) uint8
    ends : (n,) int64
        End of each object's points.
    feet : (n, 4) float64
        The plane on which each object stands: unit normal, and normal.p for points p on it.
    numbers : (n,) int64
        Numbers of the objects.
    """

    points: npt.NDArray[np.float32]
    colors: npt.NDArray[np.uint8]
    ends: npt.NDArray[np.int64]
    feet: npt.NDArray[np.float64]
    numbers: npt.NDArray[np.int64]


class View(NamedTuple):
    """A frame, and the owners of its pixels' voxels.

    Attributes
    ----------
    depth : (h, w) float32
        Metres, 0 none.
    color : (h, w, 3) uint8
    slots : (h, w) int32
        Voxel of each pixel, -1: none.
    owner : (N,) int32
        Number of the object that owns each voxel.
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
def count_seen(surfaces, view, noise, agree, max_difference, counts, corners):
    """Count, for each object, the points that a frame sees, the hidden points, and the unknown points.

    A point is seen if the reading at its pixel agrees with it; without a reading, if the color agrees. A point behind a
    reading of its own object is ignored; any other point with a reading is hidden, and any other point without a
    reading, or outside the image, is unknown.

    An object stands on its foot and extends down to it below each of its points, also where dark or shiny surfaces have
    no depth. For the rectangle, every other point is therefore used a second time, at the foot below it; it is not
    counted.

    Parameters
    ----------
    surfaces : Surfaces
    view : View
    noise : float
        The standard deviation of depth is this value times z squared.
    agree : float
        A reading agrees with a point within this distance, metres, or within three standard deviations.
    max_difference : int
        Largest difference per channel, of 255, between colors that agree.
    counts : (n, 3) int64, output
        Points seen, hidden, and unknown.
    corners : (n, 4) float64, output
        Rectangle around the points in front of the camera that nothing nearer hides, see `ends_at`, in pixels, not
        clipped: left, top, right, bottom; infinite, with left beyond right, if there are none.
    """
    points, colors, ends, feet, numbers = surfaces
    depth, color, slots, owner, camera, T = view
    height, width = depth.shape
    begin = 0
    across, down = np.empty(2 * points.shape[0]), np.empty(2 * points.shape[0])
    places = np.empty((3, 2 * points.shape[0]))
    for k in range(ends.size):
        seen = hidden = unknown = in_rect = 0
        count = ends[k] - begin
        total = count + (count + 1) // 2
        pictured(points[begin : ends[k]], feet[k], T, camera, places[:, :total])
        for n in range(total):
            i = begin + (n if n < count else 2 * (n - count))
            u, v, ahead = places[0, n], places[1, n], places[2, n]
            z = max(ahead, NEAREST_M)
            reading, same, of_object = 0.0, False, False
            if ahead > NEAREST_M:
                x, y = int(np.rint(u)), int(np.rint(v))
                if 0 <= x < width and 0 <= y < height:
                    reading, row, same = depth[y, x], slots[y, x], True
                    of_object = row >= 0 and owner[row] == numbers[k]
                    for c in range(3):
                        same &= abs(np.int64(color[y, x, c]) - np.int64(colors[i, c])) <= max_difference
            within = max(agree, SIGMAS * noise * z * z)
            if ahead > NEAREST_M and (of_object or not 0.0 < reading < z - within):
                # Limited to one image width or height outside: a point beside the camera would be infinitely far.
                across[in_rect], down[in_rect] = min(max(u, -width), 2.0 * width), min(max(v, -height), 2.0 * height)
                in_rect += 1
            if n >= count:
                continue
            if abs(reading - z) <= within if reading > 0.0 else same:
                seen += 1
            elif reading <= 0.0:
                unknown += 1
            elif not (of_object and reading < z - within):
                hidden += 1
        counts[k, 0], counts[k, 1], counts[k, 2] = seen, hidden, unknown
        corners[k, 0], corners[k, 2] = ends_at(across[:in_rect])
        corners[k, 1], corners[k, 3] = ends_at(down[:in_rect])
        begin = ends[k]


@kernel(error_model="numpy")
def pictured(points, foot, T, camera, places):
    """Project points (N, 3) into the image, and then the foot below every other one; see `count_seen`.

    The result is written to `places` (3, M) float64: column, row, and depth.
    """
    ux, uy, uz, low = foot
    count = points.shape[0]
    us, vs, zs = places[0], places[1], places[2]
    # No branches, so that the compiler can vectorise the loops.
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
    """Return whether a box within bounds (7,), see `overlap.bound`, may reach into an image; see `boxes_in_frustum`."""
    if bounds[0] > bounds[3]:
        return False
    # All centres lie within a sphere; the conditions of `boxes_in_frustum` become linear when multiplied by the
    # depth of a centre.
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
    """Find the boxes whose bounding spheres reach into an image.

    Parameters
    ----------
    boxes : (N, 15) float64
        See `overlap.intersections`; a row of NaN is never found.
    bounds : (M, 7) float64
        See `overlap.bound`.
    T_camera_world : (4, 4) float64
    camera : (4,) float64
        fx, fy, cx, cy.
    width, height : int
        Size of the image, pixels.
    far : float
        Spheres that begin farther away are not found, metres; nor are centres nearer than `NEAREST_M`.
    found : (N,) int64, output
        Rows, ascending.

    Returns
    -------
    int
        Number of boxes found.
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
