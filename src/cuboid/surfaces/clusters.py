"""The things that one frame shows: its pixels shared out among its proposals, and what bounds each share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.config import TrackerConfig
from cuboid.frame import Float32Array, Float64Array
from cuboid.heatmap.pixel_heat import WeighedProposals
from cuboid.kernels.claims import share_out
from cuboid.kernels.outlines import KINDS, outlines
from cuboid.kernels.pieces import gather_regions, judge_regions, label_regions
from cuboid.kernels.pixels import places_of
from cuboid.limits import MOST_CLUSTERS
from cuboid.tolerances import JUMP_M, LEAST_READINGS, MOST
from cuboid.working import WorkingImage

# A share of fewer working pixels is noise: a 3 cm object at 2 m covers about this many.
LEAST_PIXELS = 24
# A proposal is left out when less than this of it is free of stronger ones.
FREE_SHARE = 0.7
# Surfaces of one proposal that a jump in depth parts, as the inside and the outside of a mug, are one thing when each
# is at least this share of the largest one, and no deeper away from it than this share of its length. Smaller ones are
# slivers of what is behind, farther ones that itself.
MAJOR_SHARE, DEEP_SHARE = 0.4, MOST
# What is beyond a hole in the depth image is looked for over so much, metres: the shadow at an outline is as wide.
GAP_M = 0.08


@dataclass(frozen=True, slots=True)
class FrameCluster:
    """A thing as one frame shows it.

    Attributes
    ----------
    pixels : (N,) int64
        Numbers of its readings in the flattened working image.
    supports : dict of int to int
        How many of its pixels, filled ones too, are above each plane, by the plane's identity.
    heat : float
        Mean heat, 0..1.
    score : float
        Weight of its proposal, 0..1.
    rect_xyxy : (4,) float64
        In pixels of the full image, end exclusive.
    outline : (4, KINDS) int64
        Pixels of its outline by side and by what is beyond them; see `kernels.outlines.outlines`.
    read : float
        Share of its pixels that are readings, 0..1; the others are holes, filled.
    """

    pixels: npt.NDArray[np.int64]
    supports: dict[int, int]
    heat: float
    score: float
    rect_xyxy: Float64Array
    outline: npt.NDArray[np.int64]
    read: float


@dataclass(frozen=True, slots=True)
class FrameClusters:
    """The things that a frame shows.

    Attributes
    ----------
    clusters : list of FrameCluster
    claim : (h, w) int32
        Place in `clusters` of each working pixel's, -1 none.
    contact : (n, n) int64
        [i, j]: pixels of the outline of i beyond which j begins.
    share : (n,) int64
        The proposal that each was a piece of.
    left_out : int
        How many more there were than a frame may have.
    """

    clusters: list[FrameCluster]
    claim: npt.NDArray[np.int32]
    contact: npt.NDArray[np.int64]
    share: npt.NDArray[np.int64]
    left_out: int = 0


def frame_clusters(
    image: WorkingImage,
    solid: WorkingImage,
    heat: Float32Array,
    weighed: WeighedProposals,
    prior: Float64Array,
    on_plane: npt.NDArray[np.int32],
    support: npt.NDArray[np.int32],
    identities: npt.NDArray[np.int64],
    side_of: npt.NDArray[np.int64],
    config: TrackerConfig,
) -> FrameClusters:
    """Share the pixels of a frame out among its proposals, the strongest first.

    Parameters
    ----------
    image : WorkingImage
    solid : WorkingImage
        The same with its holes filled.
    heat : (h, w) float32
    weighed : WeighedProposals
    prior : (N,) float64
        What a proposal's weight is multiplied by, for what the map knows already.
    on_plane : (h, w) int32
        Plane that each pixel lies on, 0..P-1, -1 none.
    support : (h, w) int32
        The plane beneath it, or that it lies on.
    identities : (P,) int64
        Of the planes, ascending.
    side_of : (4,) int64
        See `kernels.outlines.outlines`.
    config : TrackerConfig
    """
    strength = weighed.weights * prior
    order = np.argsort(-strength, kind="stable")
    order = order[strength[order] > 0]
    claim = np.empty(heat.shape, np.int32)
    share_out(order, weighed.rectangles, weighed.starts, weighed.covered, LEAST_PIXELS, FREE_SHARE, claim)
    labels, parent = np.empty(claim.shape, np.int32), np.empty(claim.size, np.int32)
    number = label_regions(solid.depth_m, claim, config.depth_noise_per_m, JUMP_M, parent, labels)
    become, sizes, owner = (np.empty(number + 1, kind) for kind in (np.int32, np.int64, np.int64))
    judge_regions(
        labels, claim, solid.depth_m, image.depth_m, LEAST_READINGS, image.camera.fx, MAJOR_SHARE, DEEP_SHARE, become,
        sizes, owner,
    )  # fmt: skip
    left_out = _leave_out(sizes, owner)
    first, pixels, things = np.empty((number + 1, 2), np.int64), np.empty(claim.size, np.int64), np.empty_like(claim)
    corners, warmth = np.empty((number, 4), np.int64), np.empty(number)
    beneath = np.empty((number, len(identities)), np.int64)
    kept = gather_regions(
        labels, become, sizes, LEAST_PIXELS, image.depth_m, heat, support, first, pixels, corners, things, warmth,
        beneath,
    )  # fmt: skip
    corners, beneath, large = corners[:kept], beneath[:kept], sizes >= LEAST_PIXELS
    shares, sizes, c = owner[large], sizes[large], image.camera
    # Of planes that are beneath as much the oldest.
    plane_of = np.where(beneath.any(1), beneath.argmax(1), -1) if len(identities) else np.full(kept, -1)
    outline, contact = np.empty((kept, 4, KINDS), np.int64), np.empty((kept, kept), np.int64)
    outlines(
        solid.depth_m, image.depth_m, image.color, things, on_plane, corners,
        plane_of, side_of, c.fx, config.depth_noise_per_m, JUMP_M, GAP_M, outline, contact,
    )  # fmt: skip
    rects = (corners + np.array([0, 0, 1, 1])) * float(image.step) + np.array([*image.phase, *image.phase])
    rects = np.minimum(rects, np.array([c.width, c.height] * 2) * image.step)
    scores, warm = weighed.weights[order[shares]].tolist(), (warmth[:kept] / sizes).tolist()
    above, names, read = beneath.tolist(), identities.tolist(), (np.diff(first[:kept])[:, 0] / sizes).tolist()
    clusters = []
    for k, (begin, end) in enumerate(first[:kept].tolist()):
        supports = {name: count for name, count in zip(names, above[k], strict=True) if count}
        clusters.append(FrameCluster(pixels[begin:end], supports, warm[k], scores[k], rects[k], outline[k], read[k]))
    return FrameClusters(clusters, things, contact, shares, left_out)


def points_of(pixels: npt.NDArray[np.int64], image: WorkingImage, T_world_camera: Float64Array) -> Float64Array:
    """Return where in the world pixels (N,) of the flattened image are that have a reading: (N, 3) float64, metres."""
    c, places = image.camera, np.empty((len(pixels), 3))
    pinhole = np.array([c.fx, c.fy, c.cx, c.cy])
    places_of(pixels, image.depth_m, pinhole, np.ascontiguousarray(T_world_camera), places)
    return places


def _leave_out(sizes: npt.NDArray[np.int64], owner: npt.NDArray[np.int64]) -> int:
    """Let all regions but the most that a frame may have be none: those of the strongest shares, of these the largest.

    Returns how many are left out that are large enough for a cluster; `sizes` (N,) are the pixels of each region,
    `owner` (N,) its share.
    """
    large = np.flatnonzero(sizes >= LEAST_PIXELS)
    if len(large) <= MOST_CLUSTERS:
        return 0
    sizes[large[np.lexsort((-sizes[large], owner[large]))[MOST_CLUSTERS:]]] = 0
    return len(large) - MOST_CLUSTERS
