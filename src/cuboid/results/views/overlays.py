"""Values of pixels as colors: heat over the picture, depth instead of the picture, planes over the picture."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import cv2
import numpy as np

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.palette import color_of
from cuboid.ground.core.results import MapPoints, SupportPlane
from cuboid.ground.geometry.se3 import inverse, transform
from cuboid.results.views.projection import NEAR_PLANE_M

# Opacity of the colormap in a pixel of heat 1; colder pixels have less, pixels of heat 0 have none.
HEAT_FRACTION = 0.80

# Depths of the two ends of the colormap, metres: the range that indoor depth cameras measure well. Equal steps of
# color are equal steps of disparity, as in the sensor, so that near objects get most of the colors.
NEAREST_SHOWN_M, FARTHEST_M = 0.5, 5.0

# The relief: direction of the light in the camera frame (a unit vector), its fraction of the brightness, brightness of
# the farthest and the nearest surface, and side of the window in pixels that averages the noise of the depth.
LIGHT = (0.48, 0.60, 0.64)
SHADED_FRACTION = 0.75
DARKEST, BRIGHTEST = 0.25, 0.85
SMOOTH_PX = 5

# Side in pixels of the cells on which map points are splatted: at 1 m a cell of 4 pixels spans 8 mm, less than the
# spacing of the map's points; the blur closes the gaps.
CELL_PX = 4
BLUR_CELLS = 5
# Minimum fraction of the blur's window with points; less is a stray point.
MIN_COVER = 0.15
# An outline is cut at the camera: each edge is projected in this many steps. Coordinates beyond this many pixels are
# clipped.
EDGE_STEPS, FARTHEST_PX = 16, 20_000.0
PLANE_FRACTION = 0.35
# Points farther than this behind the visible surface are hidden by it, fraction of the depth.
BEHIND = 0.04
# A cell that is farther than its neighbour by more than this shows through a gap between points, fraction of the depth.
THROUGH = 0.10


def heat_over(color: UInt8Array, heat: Float32Array) -> UInt8Array:
    """Return a picture with its heat laid over it.

    Parameters
    ----------
    color : (H, W, 3) uint8
        RGB.
    heat : (h, w) float32
        0..1; of the picture's size, or smaller if the tracker runs on a reduced image.

    Returns
    -------
    (H, W, 3) uint8
        Cold pixels stay unchanged, hot pixels get the colors of the perceptual colormap "inferno".
    """
    height, width = color.shape[:2]
    if heat.shape != (height, width):
        heat = np.asarray(cv2.resize(heat, (width, height), interpolation=cv2.INTER_LINEAR), np.float32)
    level = np.clip(heat * np.float32(255.0), 0.0, 255.0).astype(np.uint8)
    fraction = cv2.merge([level] * 3).astype(np.float32) * np.float32(HEAT_FRACTION / 255.0)
    mixed = color + fraction * (_colors(level, cv2.COLORMAP_INFERNO).astype(np.float32) - color)
    return np.asarray(np.round(mixed), np.uint8)


def depth_picture(depth_m: Float32Array, intrinsics: Intrinsics) -> UInt8Array:
    """Return depth as a shaded relief: near bright, far dark, missing readings black, lit from the upper left.

    The colormap is almost grey, so that the colors of labels stand out.

    Parameters
    ----------
    depth_m : (H, W) float32
        Metres; 0 is a missing reading.
    intrinsics : Intrinsics
        Of the depth image.

    Returns
    -------
    (H, W, 3) uint8
    """
    measured = depth_m > 0
    disparity = np.reciprocal(np.where(measured, depth_m, np.float32(FARTHEST_M)))
    level = np.clip((disparity - 1.0 / FARTHEST_M) / (1.0 / NEAREST_SHOWN_M - 1.0 / FARTHEST_M), 0.0, 1.0)
    light = (1.0 - SHADED_FRACTION) + SHADED_FRACTION * _lit(depth_m, disparity, intrinsics)
    brightness = (DARKEST + (BRIGHTEST - DARKEST) * level) * light
    picture = _colors((255.0 * brightness).astype(np.uint8), cv2.COLORMAP_BONE)
    picture[~measured] = 0
    return picture


def _lit(depth_m: Float32Array, disparity: Float32Array, intrinsics: Intrinsics) -> Float32Array:
    """Return the fraction of the light that each surface gets, (H, W), 0..1, from the slope of the smoothed depth."""
    smooth = cv2.blur(cv2.medianBlur(depth_m, 5), (SMOOTH_PX, SMOOTH_PX))
    gx = cv2.Scharr(smooth, cv2.CV_32F, 1, 0, scale=intrinsics.fx / 32.0) * disparity
    gy = cv2.Scharr(smooth, cv2.CV_32F, 0, 1, scale=intrinsics.fy / 32.0) * disparity
    along = (LIGHT[2] - LIGHT[0] * gx - LIGHT[1] * gy) / np.sqrt(gx * gx + gy * gy + 1.0)
    lit: Float32Array = np.clip(along, 0.0, 1.0).astype(np.float32)
    return lit


def map_heat(
    points: MapPoints, depth_m: Float32Array, T_world_camera: Float64Array, intrinsics: Intrinsics
) -> Float32Array:
    """Return the heat of the global map from the view of a camera.

    In each cell of the image the nearest point counts; points behind the surface of the depth image are hidden. A blur
    that ignores empty cells closes the gaps between points.

    Parameters
    ----------
    points : MapPoints
        N points in the world.
    depth_m : (H, W) float32
        Depth image of the camera, metres; 0 is a missing reading.
    T_world_camera : (4, 4) float64
    intrinsics : Intrinsics
        Of the depth image.

    Returns
    -------
    (H, W) float32
        0..1; 0 in pixels without a visible point of the map.
    """
    height, width = depth_m.shape
    xyz = transform(inverse(T_world_camera), points.xyz)
    heat, xyz = points.heat[xyz[:, 2] > NEAR_PLANE_M], xyz[xyz[:, 2] > NEAR_PLANE_M]
    u, v = np.rint(intrinsics.pixels(xyz)).astype(np.int64).T
    inside = np.flatnonzero((u >= 0) & (u < width) & (v >= 0) & (v < height))
    u, v, z, heat = u[inside], v[inside], xyz[inside, 2], heat[inside]
    surface_m = depth_m[v, u]
    seen = np.flatnonzero((surface_m == 0) | (z <= surface_m * (1.0 + BEHIND)))
    order = seen[np.argsort(-z[seen], kind="stable")]
    cells = (-(-height // CELL_PX), -(-width // CELL_PX))
    value, nearest_m = np.zeros(cells, np.float32), np.full(cells, np.inf, np.float32)
    at = (v[order] // CELL_PX, u[order] // CELL_PX)
    value[at], nearest_m[at] = heat[order], z[order]  # far to near: the nearest overwrites the others
    around_m = cv2.erode(nearest_m, np.ones((3, 3), np.uint8), borderType=cv2.BORDER_REPLICATE)
    cover = (nearest_m <= around_m * (1.0 + THROUGH)) & np.isfinite(nearest_m)
    value *= cover
    return _closed(value, cover.astype(np.float32), height, width)


def planes_over(
    color: UInt8Array, planes: Sequence[SupportPlane], T_world_camera: Float64Array, intrinsics: Intrinsics
) -> UInt8Array:
    """Return a picture (H, W, 3) with supporting planes tinted, hidden parts included; each plane has its own color.

    Parameters
    ----------
    color : (H, W, 3) uint8
        RGB.
    planes : sequence of SupportPlane
    T_world_camera : (4, 4) float64
    intrinsics : Intrinsics
    """
    picture, T_camera_world = color.copy(), inverse(T_world_camera)
    for number, plane in enumerate(planes):
        ring = np.concatenate((plane.extent, plane.extent[:1]))
        steps = np.linspace(0.0, 1.0, EDGE_STEPS, endpoint=False)[:, None]
        outline = np.concatenate([a + steps * (b - a) for a, b in itertools.pairwise(ring)])
        seen = transform(T_camera_world, outline)
        seen = seen[seen[:, 2] > NEAR_PLANE_M]
        if len(seen) < 3:
            continue
        pixels = np.clip(intrinsics.pixels(seen), -FARTHEST_PX, FARTHEST_PX).round().astype(np.int32)
        layer = picture.copy()
        cv2.fillPoly(layer, [pixels], color_of(number + 1))
        picture = np.asarray(cv2.addWeighted(layer, PLANE_FRACTION, picture, 1.0 - PLANE_FRACTION, 0.0), np.uint8)
        cv2.polylines(picture, [pixels], True, color_of(number + 1), 2, cv2.LINE_AA)
    return picture


def _closed(value: Float32Array, cover: Float32Array, height: int, width: int) -> Float32Array:
    window = (BLUR_CELLS, BLUR_CELLS)
    weight = cv2.GaussianBlur(cover, window, 0, borderType=cv2.BORDER_REPLICATE)
    total = cv2.GaussianBlur(value, window, 0, borderType=cv2.BORDER_REPLICATE)
    mean = np.where(weight > MIN_COVER, total / np.maximum(weight, 1e-6), 0.0).astype(np.float32)
    larger = cv2.resize(mean, None, fx=CELL_PX, fy=CELL_PX, interpolation=cv2.INTER_LINEAR)
    return np.asarray(larger[:height, :width], np.float32)


def _colors(level: UInt8Array, colormap: int) -> UInt8Array:
    """Return RGB (H, W, 3) of levels (H, W), 0..255."""
    blue_first = cv2.applyColorMap(level, colormap)
    return np.asarray(cv2.cvtColor(blue_first, cv2.COLOR_BGR2RGB), np.uint8)
