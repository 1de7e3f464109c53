"""Proposals from depth alone: compact surfaces that depth jumps and concave creases separate from their surroundings.

Large planes (tables, floors, walls) are found in the frame itself and treated as background. The remaining surfaces are
cut at depth jumps and at concave creases, because separate solids meet in concave creases while a single solid is
mostly convex (Hoffman and Richards, "Parts of recognition", 1984). Bowls and mugs are not convex and are cut into
pieces, so neighbouring pieces are joined again step by step, weakest outline first. Every union is a proposal too, and
so is every pair of neighbours.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.depth import DepthImage, cell_pixels, shrunk
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.kernels import patches, regions, segments
from cuboid.ground.core.kernels.cells import CELL_COLUMNS
from cuboid.ground.core.kernels.holes import fill_holes
from cuboid.ground.core.tolerances import BIAS_M, DEPTH_NOISE_PER_M, JUMP_SIGMAS, MIN_SIGMA_M
from cuboid.ground.core.working import COLOR_LEVELS, HOLE_M
from cuboid.method.proposals.kernels import unions
from cuboid.method.proposals.registry import SOURCES
from cuboid.method.proposals.types import JoinedMasks, Proposals, ProposalSource

# Images are halved until they are no wider than this, pixels, unless the user sets another limit: at 1.5 m a pixel of
# 320 is then 6 mm.
WIDEST = 480
MIN_WIDTH_PX = 120
# Errors of neighbouring readings are correlated: over a region the noise is this times the nominal one. The standard
# deviation of depth is this times z squared; in 1/z it is the same at all distances.
REGION_NOISE = 2.2e-3 / DEPTH_NOISE_PER_M
# A plane this large is a table, a floor or a wall, not the side of an object, square metres: a cereal box has 0.06.
PLANE_AREA_M2 = 0.1
PLANES = 12
# Systematic depth error along a plane (lens, baseline) divided by z squared, metres at 1 m.
PLANE_BOW_M = 0.008
# How many cells a plane extends beyond the cells in which it was found.
PLANE_REACH = 2
# Error of readings on a plane of the same frame in addition to noise, metres: of the reading and of the plane.
MIN_BIAS_M = 2.0 * MIN_SIGMA_M
# Depth steps below this plus JUMP_SIGMAS standard deviations of noise do not separate surfaces, metres.
REGION_JUMP_M = 0.012
# Smallest depth of a crease behind the chord over it, in arm lengths: 0.4 is a bend of 44 degrees; the inside of a bowl
# with 7 cm radius has 0.11.
CREASE_SAG = 0.4
# The same for a groove: a right angle, seen from the middle. Faces of one solid rarely meet at less; two solids that
# touch do.
GROOVE_SAG = 1.0
# Color difference of two segments that probably belong to different surfaces, levels over three channels; one surface
# in light and in half shadow differs by half of it.
SAME_COLOR_LEVELS = 25.0
# The same for the two sides of a groove: the inside of a cup and its outside may differ by light and shadow.
GROOVE_COLOR_LEVELS = 50.0
# Exponents of closure and roundness in a score. Closure has more weight, because long things are objects too, and their
# parts are rounder than the whole.
CLOSURE_POWER, ROUNDNESS_POWER = 1.25, 0.4
# Smallest segment, pixels.
MIN_SEGMENT_PIXELS = 10
# Largest number of segments.
SEGMENTS = 100
# Largest number of pairs of neighbouring regions, per region of an image (Euler's formula).
PAIRS_PER_REGION = 3
# Smallest region as a fraction of the smallest object: an object seen at an angle looks narrower.
MIN_SIZE = 5.0 / 6.0
# Number of proposals per frame: several for each object on a crowded desk. More cost time in later stages.
BEST = 140
# Regions with a lower score have almost no object border in their outline.
MIN_REGION_SCORE = 0.2
# A region with this many readings does not come from noise.
SOLID_PIXELS = 120
# Regions with a larger IoU are duplicates.
SAME_REGION = 0.8

Int16Array = npt.NDArray[np.int16]


class _Regions(NamedTuple):
    """Segments, then their unions, then the large planes.

    labels (h, w); members (N, S); measures (N, regions.COLUMNS); parts (N, 2).
    """

    labels: Int16Array
    members: UInt8Array
    measures: Float64Array
    parts: npt.NDArray[np.int32]


class DepthSegmentation:
    """Proposes compact surfaces and unions of neighbouring ones as masks, from a depth image alone.

    Parameters
    ----------
    widest : int
        Images are halved until they are no wider than this, pixels.
    config : TrackerConfig
        Sizes of objects; range and noise of the sensor.
    """

    def __init__(self, widest: int, config: TrackerConfig) -> None:
        self._widest = widest
        self._config = config

    def __call__(self, frame: Frame, intrinsics: Intrinsics) -> Proposals:
        """Return the proposals of `frame`, the best first."""
        depth, step = shrunk(frame, intrinsics, self._widest)
        found = _regions(depth, frame.color, step, self._config)
        scores = _scores(found.measures, depth.camera.fx, self._config)
        return _as_proposals(found, scores, _best(scores, found), step)


def _regions(depth: DepthImage, color: UInt8Array, step: int, config: TrackerConfig) -> _Regions:
    shape, noise, camera = depth.depth_m.shape, REGION_NOISE * config.depth_noise_per_m, depth.camera
    # Surfaces behind an object at the end of the range, up to the length of an object farther, bound its segments.
    inverse, kind, on, planes = _segment_planes(depth, noise, config.max_depth_m + config.max_size_m)
    # After halving, the standard deviation of 1/z is half that of one reading; the first Kinect's is used for both.
    smooth, marks = np.empty(shape, np.float32), np.empty(shape, np.uint8)
    labels, queue = np.empty(shape, np.int16), np.empty(depth.depth_m.size, np.int32)
    # The crease arm is half the smallest object. A depth step of twice the smallest object certainly separates two
    # objects.
    segments.mark(
        inverse, kind, camera.fx, noise, REGION_JUMP_M, config.min_size_m / 2.0, CREASE_SAG, GROOVE_SAG, smooth, marks
    )
    last = segments.label_surfaces(kind, marks, MIN_SEGMENT_PIXELS, SEGMENTS, labels, queue)
    fill_holes(kind, on, np.ascontiguousarray(color), step, COLOR_LEVELS, HOLE_M, camera.fx, labels, inverse)
    segment_measures = np.empty((last + 1, regions.COLUMNS))
    borders = regions.Borders(*np.empty((4, last + 1, last + 1), np.float32))
    plane_measures = np.empty((planes, regions.COLUMNS))
    certain_m = 2.0 * config.min_size_m
    regions.measure(
        kind, labels, inverse, marks, noise, REGION_JUMP_M, certain_m, segment_measures, borders, plane_measures
    )
    _weaken(labels, color, step, segment_measures, borders)
    capacity = 2 * last + 1 + PAIRS_PER_REGION * last
    members = np.zeros((capacity + planes, last + 1 + planes), np.uint8)
    measures = np.empty((capacity + planes, regions.COLUMNS))
    parts = np.full((capacity + planes, 2), -1, np.int32)
    limits, joined = (last, camera.fx, config.max_size_m), regions.Borders(*(one.copy() for one in borders))
    n = unions.join(segment_measures.copy(), joined, *limits, members, measures, parts)
    n = unions.pair(segment_measures, borders, *limits, n, members[:capacity], measures, parts)
    # Planes are appended after the segments: they bound these, and each is a proposal by itself.
    members[n + np.arange(planes), -1 - np.arange(planes)] = 1
    measures[n : n + planes] = plane_measures
    n += planes
    return _Regions(labels, members[:n], measures[:n], parts[:n])


def _weaken(labels: Int16Array, color: UInt8Array, step: int, measures: Float64Array, borders: regions.Borders) -> None:
    """Weaken the borders between segments of similar color, where depth does not jump.

    A crease alone may be a bend of one solid, noise, or the border of two solids; different colors indicate two solids.
    Grooves between similar colors are left out likewise.

    Parameters
    ----------
    labels : (h, w) int16
    color : (step h, step w, 3) uint8
    step : int
    measures : (S, COLUMNS) float64, in and out
    borders : Borders, in and out
    """
    means = np.empty((len(measures), 3))
    regions.mean_colors(labels, np.ascontiguousarray(color), step, means)
    color_distance = np.linalg.norm(means[:, None] - means, axis=2)
    weakened = np.exp(-((color_distance / SAME_COLOR_LEVELS) ** 2)) * borders.level
    borders.weight[:] -= weakened.astype(np.float32)
    measures[:, regions.STRENGTH] -= weakened.sum(1)
    borders.grooves[:] *= 1.0 - np.exp(-((color_distance / GROOVE_COLOR_LEVELS) ** 2))


def _segment_planes(
    depth: DepthImage, noise: float, max_depth_m: float
) -> tuple[Float32Array, UInt8Array, npt.NDArray[np.int8], int]:
    """Return 1/z, the kind (none, large plane, other surface, far) and plane of each pixel, and the plane count."""
    depth_m, pinhole, size = depth.depth_m, depth.camera.pinhole, cell_pixels(depth.camera)
    cells = depth.cells(max_depth_m)
    shape, cells = cells.shape[:2], cells.reshape(-1, CELL_COLUMNS)
    planes, member = np.empty((PLANES, 3)), np.empty(shape, np.int16)
    flat = JUMP_SIGMAS * noise
    count = patches.grow_planes(cells, shape, pinhole, noise, PLANE_BOW_M, flat, PLANE_AREA_M2, planes, member)
    inverse, kind = np.empty(depth_m.shape, np.float32), np.empty(depth_m.shape, np.uint8)
    on = np.empty(depth_m.shape, np.int8)
    grown, limits = patches.Grown(cells, planes, count, member), (PLANE_REACH, noise, BIAS_M, MIN_BIAS_M, max_depth_m)
    patches.classify(depth_m, grown, pinhole, size, *limits, inverse, kind, on)
    return inverse, kind, on, count


def _scores(measures: Float64Array, focal_px: float, config: TrackerConfig) -> Float32Array:
    """Return how likely each region is an object, from the strength of its outline, its compactness and its size."""
    m = measures.T
    outline = np.maximum(m[regions.OUTLINE], 1.0)
    # The sides of a groove within a region are outlines too, of its parts, and do not close the region.
    closure = np.maximum(0.0, m[regions.STRENGTH]) / (outline + 2.0 * m[regions.GROOVES])
    # The length along pixel edges overestimates an outline by 4/pi on average over directions: a disc has roundness 1.
    roundness = 4.0 * np.pi * m[regions.PIXELS] / (outline * np.pi / 4.0) ** 2
    wide = m[regions.RIGHTMOST] - m[regions.LEFTMOST] + 1.0
    high = m[regions.BOTTOM] - m[regions.TOP] + 1.0
    metres_per_pixel = m[regions.READINGS] / np.maximum(m[regions.INVERSE], 1e-9) / focal_px
    long_m = np.maximum(wide, high) * metres_per_pixel
    min_m = MIN_SIZE * config.min_size_m
    fits = (long_m >= min_m) & (long_m <= config.max_size_m) & (m[regions.READINGS] > 0)
    # Regions with few readings, or near the smallest size, are often caused by noise.
    solid = np.clip(m[regions.READINGS] / SOLID_PIXELS, 0.0, 1.0) * np.clip(long_m / (2.0 * min_m), 0.0, 1.0)
    score = closure**CLOSURE_POWER * np.minimum(roundness, 1.0) ** ROUNDNESS_POWER * np.sqrt(solid)
    return np.where(fits, np.clip(score, 0.0, 1.0), 0.0).astype(np.float32)


def _best(scores: Float32Array, found: _Regions) -> npt.NDArray[np.int64]:
    """Return the regions to propose, best first, without near duplicates of better ones."""
    order = np.argsort(-scores, kind="stable")
    order = order[scores[order] >= MIN_REGION_SCORE]
    pixels = found.measures[:, regions.PIXELS].astype(np.int64)
    # Pixels of each segment, taken from the regions that consist of one segment.
    single = found.parts[:, 0] < 0
    weight, kept = np.zeros(found.members.shape[1], np.int64), np.empty(BEST, np.int64)
    weight[found.members[single].argmax(1)] = pixels[single]
    return kept[: unions.distinct(order, found.members, pixels, weight, SAME_REGION, kept)]


def _as_proposals(found: _Regions, scores: Float32Array, order: npt.NDArray[np.int64], step: int) -> Proposals:
    corners = [regions.LEFTMOST, regions.TOP, regions.RIGHTMOST, regions.BOTTOM]
    boxes = found.measures[order][:, corners].astype(np.int32) + np.array([0, 0, 1, 1], np.int32)
    sizes = boxes[:, 2:] - boxes[:, :2]
    flat = np.empty(sizes.prod(1).sum(), np.uint8)
    unions.cut_masks(found.labels, found.members, order, boxes, flat)
    return Proposals(boxes * np.int32(step), scores[order], JoinedMasks(flat, sizes.tolist()), step)


@SOURCES.register("depth")
def depth_source(options: str | None, config: TrackerConfig) -> ProposalSource:
    """Return the depth segmentation; `depth:N` halves images until they are at most N pixels wide.

    Raises
    ------
    InputError
        If N is not a whole number from 120 up: smaller images do not resolve objects.
    """
    if options is None:
        return DepthSegmentation(WIDEST, config)
    if not options.isdecimal() or int(options) < MIN_WIDTH_PX:
        raise InputError(f"proposal source 'depth:N' takes a width in pixels from {MIN_WIDTH_PX} up, got '{options}'")
    return DepthSegmentation(int(options), config)
