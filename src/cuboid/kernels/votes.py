"""Hot loop: proposals vote for the pixels that they cover, as far as depth bears them out."""

from __future__ import annotations

import numpy as np
from numba import njit

from cuboid.kernels.claims import covers, span


@njit(cache=True, nogil=True)
def weigh(depth, candidate, boxes, scores, masks, starts, step, phase, focal, low_m, high_m, weights):
    """Weigh each proposal by what depth says of it.

    The weight is the score times the share of the proposal's readings that are candidates. It is 0 where the
    proposal holds no depth support, straddles surfaces farther apart than an object is large, or has not the size
    of an object.

    Parameters
    ----------
    depth : (h, w) float32
        The working image: pixel (v, u) is pixel (phase[1] + step v, phase[0] + step u) of the full image.
    candidate : (h, w) uint8
        1 where a reading may belong to an object.
    boxes : (N, 4) int32
        x0, y0, x1, y1 in pixels of the full image, end exclusive.
    scores : (N,) float32
    masks : (L,) uint8
        All masks, row by row, one after the other.
    starts : (N,) int64
        Where each proposal's mask begins.
    step : int
    phase : (2,) int64
        x and y.
    focal : float
        Focal length of the full image, pixels.
    low_m, high_m : float
        Least and largest extent of an object, metres.
    weights : (N,) float32, output
    """
    height, width = depth.shape
    for k in range(boxes.shape[0]):
        box = boxes[k]
        rows, columns = span(box[1], box[3], phase[1], step, height), span(box[0], box[2], phase[0], step, width)
        weights[k] = 0.0
        pixels = readings = fit = 0
        total = square = 0.0
        left, right, top, bottom = width, -1, height, -1
        for v in range(rows[0], rows[1]):
            for u in range(columns[0], columns[1]):
                if not covers(masks, starts[k], box, phase, step, v, u):
                    continue
                pixels += 1
                z = depth[v, u]
                if z <= 0.0:
                    continue
                readings += 1
                if candidate[v, u] == 0:
                    continue
                fit += 1
                total += z
                square += z * z
                left, right, top, bottom = min(left, u), max(right, u), min(top, v), max(bottom, v)
        if fit < 8 or readings < 0.3 * pixels:
            continue
        mean = total / fit
        spread = np.sqrt(max(0.0, square / fit - mean * mean))
        extent = max(right - left + 1, bottom - top + 1) * step * mean / focal
        # Uniform depth over an object's length has a spread of 0.29 of it.
        if extent < 0.5 * low_m or extent > 1.5 * high_m or spread > 0.4 * high_m:
            continue
        weights[k] = scores[k] * fit / readings


@njit(cache=True, nogil=True)
def vote(candidate, boxes, weights, masks, starts, step, phase, heat):
    """Add each proposal's weight to the candidates that it covers; see `weigh` for the parameters."""
    height, width = candidate.shape
    for k in range(boxes.shape[0]):
        if weights[k] <= 0.0:
            continue
        box = boxes[k]
        rows, columns = span(box[1], box[3], phase[1], step, height), span(box[0], box[2], phase[0], step, width)
        for v in range(rows[0], rows[1]):
            for u in range(columns[0], columns[1]):
                if candidate[v, u] and covers(masks, starts[k], box, phase, step, v, u):
                    heat[v, u] += weights[k]
