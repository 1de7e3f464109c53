"""The segments of one frame: its pixels assigned to its proposals, and the surroundings of each segment."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.kernels.pixels import back_project
from cuboid.ground.core.limits import MAX_SEGMENTS
from cuboid.ground.core.observation import Observation
from cuboid.ground.core.tolerances import JUMP_M, MIN_READINGS
from cuboid.ground.core.working import WorkingImage
from cuboid.method.heatmap.kernels.claims import assign_pixels
from cuboid.method.heatmap.pixel_heat import WeighedProposals, proposal_iou
from cuboid.method.surfaces.kernels.borders import borders
from cuboid.method.surfaces.kernels.outlines import KINDS, Picture, outlines
from cuboid.method.surfaces.kernels.pieces import gather_regions, judge_regions, label_regions

# Smallest segment, working pixels; fewer are noise: a 3 cm object at 2 m covers about this many.
MIN_PIXELS = 24
# Size of the square around a marked pixel within which it touches a segment, working pixels.
TOUCHING_PX = 7
# A proposal is dropped if a smaller fraction of it is free of stronger proposals.
FREE_FRACTION = 0.7
# If several segments come from one proposal, each belongs to the proposal with the largest IoU, if that is at least
# this: objects in a box have proposals of their own.
OWN_IOU = 0.7
# A depth jump separates surfaces of one proposal, as the inside and the outside of a mug. They belong to one object if
# each has at least MAJOR_FRACTION of the size of the largest one, and differs from it in depth by at most DEEP_FRACTION
# of its length. Smaller ones are slivers of the background; farther ones are the background itself.
MAJOR_FRACTION, DEEP_FRACTION = 0.4, 0.5
# Beyond a hole in the depth image the next surface is searched over this distance, metres: the width of a sensor shadow
# at an outline.
GAP_M = 0.08
# Evidence of the border of two segments that they are one thing, log-odds: an intercept, the weights of the
# `border_quantities`, and its limit. `benchmarks/fit_borders.py` fits them on eleven kinds of made places.
BORDER_INTERCEPT, BORDER_CONTINUES, BORDER_LENGTH, MAX_BORDER_LOG_ODDS = 3.47, 1.34, 1.06, 2.0
# Smallest length of a border over the root of an area; also of segments without a border.
MIN_LENGTH = 1e-3


@dataclass(frozen=True, slots=True)
class FrameSegment:
    """A segment of a frame.

    Attributes
    ----------
    pixels : (N,) int64
        Indices of its readings in the flattened working image.
    supports : dict of int to int
        Number of its pixels, filled ones included, above each plane, by the identity of the plane.
    heat : float
        Mean heat, 0..1.
    score : float
        Weight of its proposal, 0..1.
    rect_xyxy : (4,) float64
        Rectangle in pixels of the full image, end exclusive.
    outline : (4, KINDS) int64
        Number of outline pixels by side and by kind of neighbour; see `kernels.outlines.outlines`.
    read : float
        Fraction of its pixels that are readings, 0..1; the others are filled holes.
    """

    pixels: npt.NDArray[np.int64]
    supports: dict[int, int]
    heat: float
    score: float
    rect_xyxy: Float64Array
    outline: npt.NDArray[np.int64]
    read: float


@dataclass(frozen=True, slots=True)
class FrameSegments:
    """The segments of a frame.

    Attributes
    ----------
    segments : list of FrameSegment
    claim : (h, w) int32
        Index in `segments` of the segment of each working pixel, -1: none.
    contact : (n, n) int64
        [i, j]: number of outline pixels of i at which j begins.
    log_odds_one : (n, n) float64
        [i, j], i < j: evidence of the border of two segments that they are one thing; see `border_evidence`. NaN where
        most of the border parts, or is too coarse to show a shape.
    proposal : (n,) int64
        The proposal of each segment, by strength; see `_own_proposals`.
    touched : (n,) bool
        Segments at which something moves, or of a body that moves elsewhere: their outlines are no evidence.
    left_out : int
        Number of segments dropped because of the limit per frame.
    whole : (n,) float64 or None
        Log-odds that each segment shows one whole thing, by the fitted score; NaN: not known. None: a frame without
        scores.
    whole_weight : float
        Weight of these log-odds: that of the frames since the last scores, at most 1.
    """

    segments: list[FrameSegment]
    claim: npt.NDArray[np.int32]
    contact: npt.NDArray[np.int64]
    log_odds_one: Float64Array
    proposal: npt.NDArray[np.int64]
    touched: npt.NDArray[np.bool_]
    left_out: int = 0
    whole: Float64Array | None = None
    whole_weight: float = 0.0


@dataclass(frozen=True, slots=True)
class PixelPlanes:
    """The supporting planes at each working pixel.

    Attributes
    ----------
    on_plane : (h, w) int32
        Plane on which each pixel lies, 0..P-1, -1: none.
    support : (h, w) int32
        Plane beneath each pixel, or on which it lies.
    identities : (P,) int64
        Identities of the planes, ascending.
    """

    on_plane: npt.NDArray[np.int32]
    support: npt.NDArray[np.int32]
    identities: npt.NDArray[np.int64]

    @classmethod
    def none(cls, shape: tuple[int, ...]) -> PixelPlanes:
        """Return the planes of an image of this shape when no plane is known."""
        nowhere = np.full(shape, -1, np.int32)
        return cls(nowhere, nowhere, np.zeros(0, np.int64))


def segment_frame(
    seen: Observation,
    planes: PixelPlanes,
    heat: Float32Array,
    weighed: WeighedProposals,
    prior: Float64Array,
    side_of: npt.NDArray[np.int64],
    config: TrackerConfig,
) -> FrameSegments:
    """Assign the pixels of a frame to its proposals, strongest first, and split them into segments.

    Parameters
    ----------
    seen : Observation
    planes : PixelPlanes
    heat : (h, w) float32
    weighed : WeighedProposals
    prior : (N,) float64
        Factor for the weight of each proposal, from the objects in the map.
    side_of : (4,) int64
        See `kernels.outlines.outlines`.
    config : TrackerConfig
    """
    image, solid, identities = seen.image, seen.solid, planes.identities
    strength = weighed.weights * prior
    order = np.argsort(-strength, kind="stable")
    order = order[strength[order] > 0]
    claim = np.empty(heat.shape, np.int32)
    assign_pixels(order, weighed.rectangles, weighed.starts, weighed.covered, MIN_PIXELS, FREE_FRACTION, claim)
    labels, parent = np.empty(claim.shape, np.int32), np.empty(claim.size, np.int32)
    number = label_regions(solid.depth_m, claim, config.depth_noise_per_m, JUMP_M, parent, labels)
    become, sizes, owner = (np.empty(number + 1, kind) for kind in (np.int32, np.int64, np.int64))
    judged_by = MIN_READINGS, image.camera.fx, MAJOR_FRACTION, DEEP_FRACTION
    judge_regions(labels, claim, solid.depth_m, image.depth_m, *judged_by, become, sizes, owner)
    left_out = _drop_excess(sizes, owner)
    first, pixels = np.empty((number + 1, 2), np.int64), np.empty(claim.size, np.int64)
    segment_of = np.empty_like(claim)
    corners, warmth = np.empty((number, 4), np.int64), np.empty(number)
    beneath = np.empty((number, len(identities)), np.int64)
    outputs = first, pixels, corners, segment_of, warmth, beneath
    kept = gather_regions(labels, become, sizes, MIN_PIXELS, image.depth_m, heat, planes.support, *outputs)
    corners, beneath, large = corners[:kept], beneath[:kept], sizes >= MIN_PIXELS
    proposal_of, sizes, c = owner[large], sizes[large], image.camera
    # The plane beneath most pixels; of equal ones the oldest.
    plane_of = np.where(beneath.any(1), beneath.argmax(1), -1) if len(identities) else np.full(kept, -1)
    outline, contact = np.empty((kept, 4, KINDS), np.int64), np.empty((kept, kept), np.int64)
    picture, noise = (
        Picture(solid.depth_m, image.depth_m, image.color, segment_of, planes.on_plane),
        config.depth_noise_per_m,
    )
    outlines(picture, corners, plane_of, side_of, c.fx, noise, JUMP_M, GAP_M, outline, contact)
    rects = image.full_rectangles(corners)
    scores, warm = weighed.weights[order[proposal_of]].tolist(), (warmth[:kept] / sizes).tolist()
    beneath_lists, names, read = beneath.tolist(), identities.tolist(), (np.diff(first[:kept])[:, 0] / sizes).tolist()
    segments = []
    for k, (begin, end) in enumerate(first[:kept].tolist()):
        supports = {name: count for name, count in zip(names, beneath_lists[k], strict=True) if count}
        segments.append(FrameSegment(pixels[begin:end], supports, warm[k], scores[k], rects[k], outline[k], read[k]))
    proposal_of = _own_proposals(segment_of, proposal_of, weighed, order)
    touched = _touched(segment_of, kept, seen, planes, config.depth_noise_per_m)
    shared, parting, continuing, coarse = (np.empty((kept, kept), np.int64) for _ in range(4))
    borders(solid.depth_m, segment_of, c.fx, noise, JUMP_M, shared, parting, continuing, coarse)
    log_odds_one = border_evidence(shared, parting, continuing, sizes)
    log_odds_one[(2 * coarse > shared) | (parting > continuing)] = np.nan
    return FrameSegments(segments, segment_of, contact, log_odds_one, proposal_of, touched, left_out)


def border_quantities(
    shared: npt.NDArray[np.int64],
    parting: npt.NDArray[np.int64],
    continuing: npt.NDArray[np.int64],
    sizes: npt.NDArray[np.int64],
) -> Float64Array:
    """Return two quantities of each border, (2, n, n); the parameters are those of `border_evidence`.

    Logarithms of the fraction of the border where the surface continues, and of its length over the root of the area of
    the smaller segment.
    """
    fraction = (continuing + 0.5) / (parting + continuing + 1.0)
    length = shared / np.sqrt(np.minimum(sizes, sizes[:, None]))
    return np.stack([np.log(fraction), np.log(np.maximum(length, MIN_LENGTH))])


def border_evidence(
    shared: npt.NDArray[np.int64],
    parting: npt.NDArray[np.int64],
    continuing: npt.NDArray[np.int64],
    sizes: npt.NDArray[np.int64],
) -> Float64Array:
    """Return the log-odds (n, n) that two segments side by side are one thing, from the shape of their border.

    Parameters
    ----------
    shared, parting, continuing : (n, n) int64
        Pixels of each border; see `kernels.borders.borders`.
    sizes : (n,) int64
        Pixels of each segment.
    """
    continues, length = border_quantities(shared, parting, continuing, sizes)
    evidence = BORDER_INTERCEPT + BORDER_CONTINUES * continues + BORDER_LENGTH * length
    return np.asarray(np.clip(evidence, -MAX_BORDER_LOG_ODDS, MAX_BORDER_LOG_ODDS))


def _own_proposals(
    segment_of: npt.NDArray[np.int32],
    proposal_of: npt.NDArray[np.int64],
    weighed: WeighedProposals,
    order: npt.NDArray[np.int64],
) -> npt.NDArray[np.int64]:
    """Return the proposal of each segment (n,): if several have the same one, a better one for each if there is one.

    A box and the objects in it have one closed outline, so that one proposal may cover them all; depth jumps separate
    its segments.

    Parameters
    ----------
    segment_of : (h, w) int32
        Segment of each working pixel, -1: none.
    proposal_of : (n,) int64
        The proposal from which each segment was cut, as an index in `order`.
    weighed : WeighedProposals
    order : (m,) int64
        The proposals by strength.
    """
    count = len(proposal_of)
    shared = np.bincount(proposal_of)[proposal_of] > 1 if count else np.zeros(0, bool)
    if not shared.any():
        return proposal_of
    iou = proposal_iou(weighed, segment_of + np.int32(1), np.array([count, *range(count)]), count)[order]
    return np.where(shared & (iou.max(0) >= OWN_IOU), iou.argmax(0), proposal_of)


def _touched(
    segment_of: npt.NDArray[np.int32], count: int, seen: Observation, planes: PixelPlanes, noise_per_m: float
) -> npt.NDArray[np.bool_]:
    """Return which segments (n,) touch moving pixels or belong to a body that moves elsewhere.

    A body is a connected region off the planes: a hand that rests is a part of the arm that moves.
    """
    touched = np.zeros(count, bool)
    if seen.moving is None:
        return touched
    depth_m = seen.solid.depth_m
    off_planes = np.where((planes.on_plane < 0) & (depth_m > 0), np.int32(0), np.int32(-1))
    body, parent = np.empty(depth_m.shape, np.int32), np.empty(depth_m.size, np.int32)
    moves = np.zeros(1 + label_regions(depth_m, off_planes, noise_per_m, JUMP_M, parent, body), bool)
    moves[body[seen.moving > 0]] = True
    moves[0] = False
    near_motion = cv2.dilate(seen.moving, np.ones((TOUCHING_PX, TOUCHING_PX), np.uint8))
    touched[np.unique(segment_of[((near_motion > 0) | moves[body]) & (segment_of >= 0)])] = True
    return touched


def points_of(pixels: npt.NDArray[np.int64], image: WorkingImage, T_world_camera: Float64Array) -> Float64Array:
    """Return the world coordinates (N, 3) float64, metres, of flat pixel indices (N,) with a reading."""
    places = np.empty((len(pixels), 3))
    back_project(pixels, image.depth_m, image.camera.pinhole, np.ascontiguousarray(T_world_camera), places)
    return places


def _drop_excess(sizes: npt.NDArray[np.int64], owner: npt.NDArray[np.int64]) -> int:
    """Keep at most `MAX_SEGMENTS` regions: those of the strongest proposals, and of one proposal the largest ones.

    Return the number of dropped regions that were large enough for a segment. `sizes` (N,) are the pixels of each
    region, 0 afterwards for dropped ones; `owner` (N,) is its proposal.
    """
    large = np.flatnonzero(sizes >= MIN_PIXELS)
    if len(large) <= MAX_SEGMENTS:
        return 0
    sizes[large[np.lexsort((-sizes[large], owner[large]))[MAX_SEGMENTS:]]] = 0
    return len(large) - MAX_SEGMENTS
