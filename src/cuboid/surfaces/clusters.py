"""The things that one frame shows: its pixels shared out among its proposals, and what bounds each share."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from cuboid.config import TrackerConfig
from cuboid.frame import Float32Array, Float64Array
from cuboid.heatmap.pixel_heat import WeighedProposals
from cuboid.kernels.claims import share_out
from cuboid.kernels.outlines import KINDS, outlines
from cuboid.kernels.pieces import (
    drop_filled,
    drop_unread,
    gather_regions,
    join_surfaces,
    label_regions,
    sum_regions,
)
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
    points : (N, 3) float64
        World, metres.
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
    points: Float64Array
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
    T_world_camera: Float64Array,
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
    T_world_camera : (4, 4) float64
    config : TrackerConfig
    """
    strength = weighed.weights * prior
    order = np.argsort(-strength, kind="stable")
    order = order[strength[order] > 0]
    claim = np.empty(heat.shape, np.int32)
    share_out(order, weighed.rectangles, weighed.starts, weighed.covered, LEAST_PIXELS, FREE_SHARE, claim)
    regions, parent = np.empty(claim.shape, np.int32), np.empty(claim.size, np.int32)
    number = label_regions(solid.depth_m, claim, config.depth_noise_per_m, JUMP_M, parent, regions)
    join_surfaces(regions, number, claim, solid.depth_m, image.camera.fx, MAJOR_SHARE, DEEP_SHARE)
    sizes = np.empty(number + 1, np.int64)
    drop_unread(regions, image.depth_m, LEAST_READINGS, sizes)
    left_out = _leave_out(regions, claim, sizes)
    pixels, points = np.empty(claim.size, np.int64), np.empty((claim.size, 3))
    first, corners = np.empty(number + 1, np.int64), np.empty((number, 4), np.int64)
    c = image.camera
    pinhole, things = np.array([c.fx, c.fy, c.cx, c.cy]), np.empty_like(claim)
    kept = gather_regions(
        regions, number, LEAST_PIXELS, solid.depth_m, pinhole, np.ascontiguousarray(T_world_camera), first, pixels,
        points, corners, things,
    )  # fmt: skip
    first, corners = first[: kept + 1], corners[:kept]
    shares = claim.ravel()[pixels[first[:-1]]]
    warmth, beneath = np.empty(kept), np.empty((kept, len(identities)), np.int64)
    sum_regions(first, pixels, heat, support, warmth, beneath)
    # Of planes that are beneath as much the oldest.
    plane_of = np.where(beneath.any(1), beneath.argmax(1), -1) if len(identities) else np.full(kept, -1)
    outline, contact = np.empty((kept, 4, KINDS), np.int64), np.empty((kept, kept), np.int64)
    outlines(
        solid.depth_m, image.depth_m, image.color, things, on_plane, corners,
        plane_of, side_of, c.fx, config.depth_noise_per_m, JUMP_M, GAP_M, outline, contact,
    )  # fmt: skip
    rects = (corners + np.array([0, 0, 1, 1])) * float(image.step) + np.array([*image.phase, *image.phase])
    rects = np.minimum(rects, np.array([c.width, c.height] * 2) * image.step)
    scores = weighed.weights[order[shares]].tolist()
    warm = (warmth / np.diff(first)).tolist()
    ends = np.empty(kept, np.int64)
    drop_filled(first, pixels, points, image.depth_m, ends)
    above, names = beneath.tolist(), identities.tolist()
    clusters = []
    for k, ((begin, end), own) in enumerate(zip(pairwise(first.tolist()), ends.tolist(), strict=True)):
        supports = {name: count for name, count in zip(names, above[k], strict=True) if count}
        mine, share = slice(begin, own), (own - begin) / (end - begin)
        clusters.append(
            FrameCluster(pixels[mine], points[mine], supports, warm[k], scores[k], rects[k], outline[k], share)
        )
    return FrameClusters(clusters, things, contact, shares.astype(np.int64), left_out)


def _leave_out(regions: npt.NDArray[np.int32], claim: npt.NDArray[np.int32], sizes: npt.NDArray[np.int64]) -> int:
    """Clear all regions (h, w) but the most that a frame may have: those of the strongest shares, of these the largest.

    Returns how many were cleared that are large enough for a cluster; `sizes` are the pixels of each region.
    """
    large = 1 + np.flatnonzero(sizes[1:] >= LEAST_PIXELS)
    if len(large) <= MOST_CLUSTERS:
        return 0
    share = np.zeros(len(sizes), np.int64)
    share[regions.ravel()] = claim.ravel()
    kept = large[np.lexsort((-sizes[large], share[large]))[:MOST_CLUSTERS]]
    stays = np.zeros(len(sizes), np.bool_)
    stays[kept] = True
    regions[~stays[regions]] = 0
    return len(large) - MOST_CLUSTERS
