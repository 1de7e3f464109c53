"""Data association: the segments of a frame and the objects of the map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.core.frame import Float64Array
from cuboid.geometry.overlap import iou_matrix
from cuboid.heatmap.kernels.claims import proposal_overlaps, segment_overlaps
from cuboid.heatmap.pixel_heat import WeighedProposals
from cuboid.heatmap.voxel_map import PixelVoxels
from cuboid.objects.entry import MapObject
from cuboid.objects.matching import assign
from cuboid.surfaces.frame_segments import FrameSegments

# At least this fraction of a segment counts as mapped before.
MIN_MAPPED_FRACTION = 0.2
# A segment without a match is part of the object in which at least this fraction of it lies.
PART_FRACTION = 0.5
# Gate of the association: 3D IoU of the boxes, or IoU of the masks.
SAME = 0.25


@dataclass(frozen=True, slots=True)
class Association:
    """Which segment of a frame is which object.

    Attributes
    ----------
    objects : sequence of MapObject
        Those that may be seen.
    match : (n,) int64
        Index in `objects` of each segment's match, -1 none.
    part : (n,) int64
        Of a segment without a match the object that contains most of it, -1 none.
    iou : (n, m) float64
        3D IoU of the boxes.
    similarity : (n,) float64
        Of each segment to its match, 0..1.
    overlap : (n, m) int64
        Pixels of a segment that belong to an object.
    object_pixels : (m,) int64
        Pixels that belong to an object, in any segment or none.
    """

    objects: Sequence[MapObject]
    match: npt.NDArray[np.int64]
    part: npt.NDArray[np.int64]
    iou: Float64Array
    similarity: Float64Array
    overlap: npt.NDArray[np.int64]
    object_pixels: npt.NDArray[np.int64]


def associate(
    frame: FrameSegments,
    boxes: Float64Array,
    objects: Sequence[MapObject],
    theirs: Float64Array,
    voxels: PixelVoxels,
) -> Association:
    """Match the segments of a frame to objects one to one; what is left over may be a part of one.

    The similarity of a segment and an object is the larger of the 3D IoU of their boxes and of the IoU of their masks:
    of the object the pixels whose voxels it owns, of the segment those whose voxels were mapped before.

    Parameters
    ----------
    frame : FrameSegments
    boxes : (n, 15) float64
        Of the frame's segments, see `pack`.
    objects : sequence of MapObject
        Those that may be seen.
    theirs : (m, 15) float64
        Their boxes.
    voxels : PixelVoxels
        Of the working pixels.
    """
    n, m = len(frame.segments), len(objects)
    overlap, size = _mask_overlaps(frame, objects, voxels)
    nobody = np.full(n, -1, np.int64)
    if n == 0 or m == 0:
        return Association(objects, nobody, nobody, np.zeros((n, m)), np.zeros(n), overlap[:n], overlap[-1])
    iou = iou_matrix(boxes, theirs)
    mine, object_pixels = overlap[:n], overlap.sum(0)
    # The mapped part of an almost new segment is no evidence.
    whole = np.array([len(segment.pixels) for segment in frame.segments])
    seen = mine / np.maximum(np.maximum(size, MIN_MAPPED_FRACTION * whole)[:, None] + object_pixels[None] - mine, 1)
    match, part = nobody.copy(), nobody.copy()
    like, similarity = np.maximum(iou, seen), np.zeros(n)
    for i, j in assign(like, SAME):
        match[i], similarity[i] = j, like[i, j]
    held = mine / whole[:, None]
    best = held.argmax(1)
    lies = held[np.arange(n), best] >= PART_FRACTION
    part[(match < 0) & lies] = best[(match < 0) & lies]
    return Association(objects, match, part, iou, similarity, mine, object_pixels)


def _mask_overlaps(
    frame: FrameSegments,
    objects: Sequence[MapObject],
    voxels: PixelVoxels,
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return pixels by segment and object (n + 1, m), the last row for those of none, and the mapped pixels."""
    n, m = len(frame.segments), len(objects)
    place = index_table([o.number for o in objects], int(voxels.owner.max()))
    table, size = np.empty((n + 1, m + 1), np.int64), np.empty(n + 1, np.int64)
    segment_overlaps(frame.claim, voxels.owner, voxels.known, place, table, size)
    return table[:, :m], size[:n]


def index_table(numbers: Sequence[int], highest: int) -> npt.NDArray[np.int64]:
    """Return for each number up to at least the highest where it is in `numbers`, their count where it is not."""
    place = np.full(max([highest, *numbers]) + 1, len(numbers))
    place[list(numbers)] = np.arange(len(numbers))
    return place


def prior_of(
    objects: Sequence[MapObject], pixel_owner: npt.NDArray[np.int32], weighed: WeighedProposals
) -> Float64Array:
    """Return what each proposal's weight is multiplied by (N,): 1 plus its IoU with an object times how sure that is.

    Parameters
    ----------
    objects : sequence of MapObject
        Those that may be seen; what has no label is not sure.
    pixel_owner : (h, w) int32
        Number of the object that each working pixel belongs to, 0 none.
    weighed : WeighedProposals
    """
    labelled = [o for o in objects if o.confirmed]
    n, m = len(weighed.weights), len(labelled)
    if n == 0 or m == 0:
        return np.ones(n)
    place = index_table([o.number for o in labelled], int(pixel_owner.max()))
    table, object_pixels = np.empty((n, m + 1), np.int64), np.empty(m + 1, np.int64)
    column = np.empty(pixel_owner.shape, np.int32)
    proposal_overlaps(
        pixel_owner, place, weighed.rectangles, weighed.starts, weighed.covered, column, table, object_pixels
    )
    mine = table[:, :m]
    iou = mine / np.maximum(table.sum(1)[:, None] + object_pixels[:m] - mine, 1)
    return np.asarray(1.0 + (iou * np.array([o.score for o in labelled])).max(1))
