"""The overlap of axis-aligned rectangles in an image."""

from __future__ import annotations

import numpy as np

from cuboid.ground.arrays import Float64Array


def areas(rects_xyxy: Float64Array) -> Float64Array:
    """Return the areas (N,) of rectangles (N, 4), ends exclusive; 0 where a rectangle is empty."""
    return np.asarray(np.maximum(rects_xyxy[:, 2:] - rects_xyxy[:, :2], 0.0).prod(1))


def common_areas(a_xyxy: Float64Array, b_xyxy: Float64Array) -> Float64Array:
    """Return the areas (N, M) of the intersections of rectangles (N, 4) with other rectangles (M, 4)."""
    low = np.maximum(a_xyxy[:, None, :2], b_xyxy[None, :, :2])
    high = np.minimum(a_xyxy[:, None, 2:], b_xyxy[None, :, 2:])
    return np.asarray(np.maximum(high - low, 0.0).prod(2))


def rect_iou_matrix(a_xyxy: Float64Array, b_xyxy: Float64Array) -> Float64Array:
    """Return the IoU (N, M), 0..1, of rectangles (N, 4) with others (M, 4); 0 for an empty rectangle."""
    common = common_areas(a_xyxy, b_xyxy)
    union = areas(a_xyxy)[:, None] + areas(b_xyxy)[None, :] - common
    return np.divide(common, union, out=np.zeros_like(common), where=common > 0)


def rect_iou(a_xyxy: Float64Array, b_xyxy: Float64Array) -> float:
    """Return the IoU of two rectangles (4,); faster than `rect_iou_matrix` for a single pair."""
    (ax0, ay0, ax1, ay1), (bx0, by0, bx1, by1) = a_xyxy.tolist(), b_xyxy.tolist()
    common = max(0.0, min(ax1, bx1) - max(ax0, bx0)) * max(0.0, min(ay1, by1) - max(ay0, by0))
    if common <= 0.0:
        return 0.0
    return float(common / ((ax1 - ax0) * (ay1 - ay0) + (bx1 - bx0) * (by1 - by0) - common))


def fractions_inside(a_xyxy: Float64Array, b_xyxy: Float64Array) -> Float64Array:
    """Return the fraction (N, M), 0..1, of each rectangle (N, 4) that lies inside each other rectangle (M, 4)."""
    common = common_areas(a_xyxy, b_xyxy)
    return np.divide(common, areas(a_xyxy)[:, None], out=np.zeros_like(common), where=common > 0)
