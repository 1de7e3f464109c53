"""Hot loop: proposals vote for the pixels that they cover, weighted by their depth readings."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cuboid.ground.compiling.compiled import kernel
from cuboid.ground.core.tolerances import MIN_READINGS


class Masks(NamedTuple):
    """The masks of proposals.

    Attributes
    ----------
    boxes : (N, 4) int32
        x0, y0, x1, y1 in pixels of the masks' image, end exclusive.
    flat : (L,) uint8
        The masks of all boxes, row by row, one after the other.
    step : int
        Pixel (v, u) of the working image is pixel (phase[1] + step v, phase[0] + step u) of the masks' image.
    phase : (2,) int64
        x and y.
    rectangles : (N, 4) int64
        x0, y0, x1, y1 of the working pixels in each box, end exclusive.
    starts : (N + 1,) int64
        Begin of each rectangle in the flat array of all rectangles, row by row.
    """

    boxes: npt.NDArray[np.int32]
    flat: npt.NDArray[np.uint8]
    step: int
    phase: npt.NDArray[np.int64]
    rectangles: npt.NDArray[np.int64]
    starts: npt.NDArray[np.int64]


@kernel(error_model="numpy")
def weigh(depth, candidate, proposals, scores, focal, low_m, high_m, covered, weights):
    """Weigh each proposal by its depth readings, and mark the candidates that it covers.

    The weight is the score times the fraction of the proposal's readings that are candidates. It is 0 if the proposal
    has too few readings, covers surfaces that are farther apart in depth than the size of an object, or does not have
    the size of an object.

    Parameters
    ----------
    depth : (h, w) float32
        The working image.
    candidate : (h, w) uint8
        1 where a reading may belong to an object.
    proposals : Masks
    scores : (N,) float32
    focal : float
        Focal length of the working image, pixels.
    low_m, high_m : float
        Smallest and largest size of an object, metres.
    covered : (starts[N],) uint8, output
        1 for each working pixel of a box that is a candidate and that the proposal covers.
    weights : (N,) float32, output
    """
    boxes, masks, step, phase, rectangles, starts = proposals
    height, width = depth.shape
    mask = 0
    for k in range(boxes.shape[0]):
        x0, y0, x1, y1 = rectangles[k]
        wide = np.int64(boxes[k, 2] - boxes[k, 0])
        weights[k] = 0.0
        pixels = readings = fit = 0
        total = square = 0.0
        left, right, top, bottom = width, -1, height, -1
        at = starts[k]
        for v in range(y0, y1):
            row = mask + (phase[1] + step * v - boxes[k, 1]) * wide + phase[0] - boxes[k, 0]
            first, last = width, -1
            for u in range(x0, x1):
                covered[at] = 0
                at += 1
                if masks[row + step * u] == 0:
                    continue
                pixels += 1
                z = depth[v, u]
                if z <= 0.0:
                    continue
                readings += 1
                if candidate[v, u] == 0:
                    continue
                covered[at - 1] = 1
                fit += 1
                total += z
                square += z * z
                first, last = min(first, u), u
            if last >= 0:
                left, right, top, bottom = min(left, first), max(right, last), min(top, v), v
        mask += wide * (boxes[k, 3] - boxes[k, 1])
        if fit < MIN_READINGS or readings < 0.3 * pixels:
            continue
        mean = total / fit
        spread = np.sqrt(max(0.0, square / fit - mean * mean))
        extent = max(right - left + 1, bottom - top + 1) * mean / focal
        # Uniformly distributed depth over an object's length has a standard deviation of 0.29 of it.
        if extent < 0.5 * low_m or extent > high_m or spread > 0.4 * high_m:
            continue
        weights[k] = scores[k] * fit / readings


@kernel
def accumulate_heat(rectangles, starts, covered, weights, heat):
    """Add each proposal's weight to the candidates that it covers; see `weigh` for the parameters."""
    for k in range(weights.size):
        if weights[k] <= 0.0:
            continue
        x0, y0, x1, y1 = rectangles[k]
        at = starts[k]
        for v in range(y0, y1):
            covers, row = covered[at : at + x1 - x0], heat[v, x0:x1]
            for u in range(covers.size):
                row[u] += weights[k] * np.float32(covers[u])
            at += x1 - x0
