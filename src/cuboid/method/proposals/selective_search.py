"""Proposals by Selective Search (Uijlings et al., IJCV 2013): rectangles of regions merged by similar color."""

from __future__ import annotations

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.method.detection.boxes import thin_out
from cuboid.method.proposals.boxes import boxes_as_proposals, refuse_options
from cuboid.method.proposals.edges import Edges, find_edges
from cuboid.method.proposals.registry import SOURCES
from cuboid.method.proposals.types import Proposals, ProposalSource

# Scale and smoothing of the first segmentation at a width of 320 pixels: regions of a few centimetres.
SCALE = 100
SIGMA = 0.8
# Boxes that overlap more are duplicates.
SEARCH_DUPLICATE_IOU = 0.85
# Edge strength per pixel of outline of a likely object.
LIKELY_EDGE_STRENGTH = 0.5


class SelectiveSearch:
    """Proposes boxes from color at half resolution.

    The method has no score: it ranks regions by their level in its hierarchy, times a random number. Here a box is
    scored by the edges near its outline but not in its middle, as in EdgeBoxes, so that the score is deterministic.
    """

    def __init__(self, noise_per_m: float) -> None:
        self._noise_per_m = noise_per_m

    def __call__(self, frame: Frame, intrinsics: Intrinsics) -> Proposals:
        """Return the proposals of `frame`, the best first."""
        import cv2

        edges = find_edges(frame, self._noise_per_m)
        h, w = edges.strength.shape
        whole = frame.color[: h * edges.step, : w * edges.step]
        small = cv2.resize(whole, (w, h), interpolation=cv2.INTER_AREA)
        search = cv2.ximgproc.segmentation.createSelectiveSearchSegmentation()
        search.setBaseImage(np.ascontiguousarray(small[..., ::-1]))
        search.switchToSingleStrategy(SCALE, SIGMA)
        xywh = np.asarray(search.process(), dtype=np.float64).reshape(-1, 4)
        xyxy = np.hstack([xywh[:, :2], xywh[:, :2] + xywh[:, 2:]])
        # OpenCV's rank is random: sort the boxes, so that equal input gives equal results.
        xyxy = np.unique(xyxy, axis=0)
        scores = 1.0 - np.exp(-_edges_of(xyxy, edges) / LIKELY_EDGE_STRENGTH)
        kept = thin_out(xyxy, scores, SEARCH_DUPLICATE_IOU)
        return boxes_as_proposals(xyxy[kept] * edges.step, scores[kept], intrinsics.width, intrinsics.height)


def _edges_of(boxes_xyxy: Float64Array, edges: Edges) -> Float64Array:
    """Return the edge strength in each box minus that in its middle, per pixel of outline (less for large boxes)."""
    import cv2

    total = np.asarray(cv2.integral(edges.strength), dtype=np.float64)

    def inside(x0: Float64Array, y0: Float64Array, x1: Float64Array, y1: Float64Array) -> Float64Array:
        a, b, c, d = (np.rint(x).astype(np.intp) for x in (x0, y0, x1, y1))
        return np.asarray(total[d, c] - total[b, c] - total[d, a] + total[b, a])

    x0, y0, x1, y1 = boxes_xyxy.T
    w, h = x1 - x0, y1 - y0
    middle = inside(x0 + w / 4, y0 + h / 4, x1 - w / 4, y1 - h / 4)
    # The exponent keeps large boxes from winning by their area alone (Zitnick and Dollar, kappa = 1.5).
    return np.asarray((inside(x0, y0, x1, y1) - middle) / np.maximum(w + h, 1.0) ** 1.5 * 10.0)


@SOURCES.register("selective-search")
def selective_search_source(options: str | None, config: TrackerConfig) -> ProposalSource:
    """Return Selective Search; it takes no options.

    Raises
    ------
    InputError
        If options are given.
    """
    refuse_options("selective-search", options)
    return SelectiveSearch(config.depth_noise_per_m)
