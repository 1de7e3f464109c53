"""Proposals by EdgeBoxes (Zitnick and Dollar, ECCV 2014): boxes that enclose many whole edges of depth and color."""

from __future__ import annotations

import numpy as np

from cuboid.ground.arrays import Float32Array
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.method.detection.boxes import MAX_BOXES
from cuboid.method.proposals.boxes import boxes_as_proposals, refuse_options
from cuboid.method.proposals.edges import find_edges
from cuboid.method.proposals.registry import SOURCES
from cuboid.method.proposals.types import Proposals, ProposalSource

# EdgeBoxes score of a likely object; a score s becomes 1 - exp(-s / LIKELY_EDGEBOXES_SCORE).
LIKELY_EDGEBOXES_SCORE = 0.3
# Smallest area of a box, pixels of the working image: 5 cm at 1.1 m, squared. Half of it doubles the time and adds
# boxes of patterns printed on objects.
MIN_AREA = 150.0
# Weaker edges and worse boxes are dropped: without either limit the search takes three times as long.
MIN_EDGE = 0.4
# Largest fraction of pixels that may be edges; the strongest are kept. A cluttered desk has an eighth; noise has a
# third and takes seconds.
MAX_EDGE_FRACTION = 0.15
MIN_EDGEBOXES_SCORE = 0.1
# Overlap of neighbouring windows in the sliding search.
ALPHA = 0.6
# Overlap above which the worse box is suppressed, and the decay of that limit: this spreads the boxes over the image.
BETA = 0.6
ETA = 0.98
# Largest aspect ratio of a box: the method's own default.
LONGEST_ASPECT = 3.0


class EdgeBoxes:
    """Proposes boxes from thinned edges at half resolution; edges that are not thinned take seconds."""

    def __init__(self, noise_per_m: float) -> None:
        self._noise_per_m = noise_per_m

    def __call__(self, frame: Frame, intrinsics: Intrinsics) -> Proposals:
        """Return the proposals of `frame`, the best first."""
        import cv2

        edges = find_edges(frame, self._noise_per_m)
        finder = cv2.ximgproc.createEdgeBoxes()
        finder.setMaxBoxes(MAX_BOXES)
        finder.setMinBoxArea(MIN_AREA)
        finder.setEdgeMinMag(MIN_EDGE)
        finder.setMinScore(MIN_EDGEBOXES_SCORE)
        finder.setAlpha(ALPHA)
        finder.setBeta(BETA)
        finder.setEta(ETA)
        finder.setMaxAspectRatio(LONGEST_ASPECT)
        boxes, scores = finder.getBoundingBoxes(_strongest(edges.strength), edges.angle)
        xywh = np.asarray(boxes, dtype=np.float64).reshape(-1, 4) * edges.step
        xyxy = np.hstack([xywh[:, :2], xywh[:, :2] + xywh[:, 2:]])
        values = 1.0 - np.exp(-np.asarray(scores, dtype=np.float64).ravel() / LIKELY_EDGEBOXES_SCORE)
        return boxes_as_proposals(xyxy, values, intrinsics.width, intrinsics.height)


def _strongest(strength: Float32Array) -> Float32Array:
    """Return the strongest edges (H, W), at most `MAX_EDGE_FRACTION` of the pixels; ties are sampled everywhere."""
    places = np.flatnonzero(strength >= MIN_EDGE)
    max_edges = int(MAX_EDGE_FRACTION * strength.size)
    if len(places) <= max_edges:
        return strength
    scattered = places * 2_654_435_761 % 2**32
    kept = places[np.lexsort((scattered, -strength.ravel()[places]))[:max_edges]]
    result = np.zeros_like(strength)
    result.ravel()[kept] = strength.ravel()[kept]
    return result


@SOURCES.register("edgeboxes")
def edgeboxes_source(options: str | None, config: TrackerConfig) -> ProposalSource:
    """Return EdgeBoxes; it takes no options.

    Raises
    ------
    InputError
        If options are given.
    """
    refuse_options("edgeboxes", options)
    return EdgeBoxes(config.depth_noise_per_m)
