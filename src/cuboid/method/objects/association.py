"""Data association: the segments of a frame and the objects of the map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array, UInt8Array
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.overlap import iou_matrix, pack
from cuboid.method.heatmap.kernels.claims import segment_overlaps
from cuboid.method.heatmap.pixel_heat import WeighedProposals, proposal_iou
from cuboid.method.heatmap.voxel_map import PixelVoxels
from cuboid.method.objects.entry import MapObject
from cuboid.method.objects.matching import assign
from cuboid.method.surfaces.frame_segments import FrameSegments

# Smallest fraction of a segment that counts as mapped before.
MIN_MAPPED_FRACTION = 0.2
# Gate of the association: 3D IoU of the boxes, or IoU of the masks.
MIN_MATCH_IOU = 0.25


@dataclass(frozen=True, slots=True)
class SegmentedFrame:
    """The segments of a frame, and the voxels of its pixels.

    Attributes
    ----------
    segments : FrameSegments
    boxes : sequence of Box
        Boxes of the segments.
    voxels : PixelVoxels
        Voxels of the working pixels.
    candidate : (h, w) uint8
        1 for pixels off every supporting plane.
    """

    segments: FrameSegments
    boxes: Sequence[Box]
    voxels: PixelVoxels
    candidate: UInt8Array


@dataclass(frozen=True, slots=True)
class Association:
    """The association of a frame's segments with objects.

    Attributes
    ----------
    objects : sequence of MapObject
        The objects that may be visible.
    match : (n,) int64
        Index in `objects` of the match of each segment, -1: none.
    part : (n,) int64
        For a segment without a match, index of the object that contains most of it, -1: none.
    iou : (n, m) float64
        3D IoU of the boxes.
    similarity : (n,) float64
        Similarity of each segment and its match, 0..1.
    overlap : (n, m) int64
        Number of pixels of a segment that belong to an object.
    object_pixels : (m,) int64
        Number of pixels that belong to an object, inside or outside segments.
    """

    objects: Sequence[MapObject]
    match: npt.NDArray[np.int64]
    part: npt.NDArray[np.int64]
    iou: Float64Array
    similarity: Float64Array
    overlap: npt.NDArray[np.int64]
    object_pixels: npt.NDArray[np.int64]

    @property
    def object_of(self) -> npt.NDArray[np.int64]:
        """Index in `objects` of the object that matches or contains each segment, (n,), -1: none."""
        return np.where(self.match >= 0, self.match, self.part)

    def numbers_of(self, chosen: npt.NDArray[np.bool_]) -> list[int]:
        """Return the numbers of the objects that match or contain the chosen segments (n,)."""
        return [self.objects[j].number for j in self.object_of[chosen].tolist() if j >= 0]


def associate(frame: SegmentedFrame, objects: Sequence[MapObject], boxes: Float64Array) -> Association:
    """Match the segments of a frame to objects one to one; an unmatched segment may be a part of an object.

    The similarity of a segment and an object is the larger one of the 3D IoU of their boxes and the IoU of their masks.
    The mask of an object has the pixels whose voxels it owns; that of a segment has the pixels whose voxels were mapped
    before.

    Parameters
    ----------
    frame : SegmentedFrame
    objects : sequence of MapObject
        The objects that may be visible.
    boxes : (m, 15) float64
        Boxes of the objects, see `pack`.
    """
    segments = frame.segments.segments
    n, m = len(segments), len(objects)
    overlap, size = _mask_overlaps(frame, objects)
    no_match = np.full(n, -1, np.int64)
    if n == 0 or m == 0:
        return Association(objects, no_match, no_match, np.zeros((n, m)), np.zeros(n), overlap[:n], overlap[-1])
    iou = iou_matrix(pack(frame.boxes), boxes)
    pixels, object_pixels = overlap[:n], overlap.sum(0)
    # A small mapped part of a mostly new segment is no evidence: the size has a lower limit.
    segment_pixels = np.array([len(segment.pixels) for segment in segments])
    mask_iou = pixels / np.maximum(
        np.maximum(size, MIN_MAPPED_FRACTION * segment_pixels)[:, None] + object_pixels[None] - pixels, 1
    )
    match, part = no_match.copy(), no_match.copy()
    similarities, similarity = np.maximum(iou, mask_iou), np.zeros(n)
    for i, j in assign(similarities, MIN_MATCH_IOU):
        match[i], similarity[i] = j, similarities[i, j]
    inside = pixels / segment_pixels[:, None]
    best = inside.argmax(1)
    # A segment without a match is a part of an object if at least half of the segment lies in it.
    is_part = inside[np.arange(n), best] >= 0.5
    part[(match < 0) & is_part] = best[(match < 0) & is_part]
    return Association(objects, match, part, iou, similarity, pixels, object_pixels)


def _mask_overlaps(
    frame: SegmentedFrame, objects: Sequence[MapObject]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return the pixel counts by segment and object (n + 1, m), last row: no segment, and the mapped pixels (n,)."""
    n, m, voxels = len(frame.segments.segments), len(objects), frame.voxels
    place = index_table([o.number for o in objects], int(voxels.owner.max()))
    table, size = np.empty((n + 1, m + 1), np.int64), np.empty(n + 1, np.int64)
    segment_overlaps(frame.segments.claim, voxels.owner, voxels.mapped, place, table, size)
    return table[:, :m], size[:n]


def index_table(numbers: Sequence[int], highest: int) -> npt.NDArray[np.int64]:
    """Return the index in `numbers` of each number up to at least `highest`; the length of `numbers` if absent."""
    place = np.full(max([highest, *numbers]) + 1, len(numbers))
    place[list(numbers)] = np.arange(len(numbers))
    return place


def prior_of(
    objects: Sequence[MapObject], pixel_owner: npt.NDArray[np.int32], weighed: WeighedProposals
) -> Float64Array:
    """Return the factor of each proposal's weight (N,): 1 plus its IoU with a labelled object times the object's score.

    Parameters
    ----------
    objects : sequence of MapObject
        The objects that may be visible; those without a label are ignored.
    pixel_owner : (h, w) int32
        Number of the object that owns each working pixel, 0: none.
    weighed : WeighedProposals
    """
    labelled = [o for o in objects if o.confirmed]
    n, m = len(weighed.weights), len(labelled)
    if n == 0 or m == 0:
        return np.ones(n)
    place = index_table([o.number for o in labelled], int(pixel_owner.max()))
    iou = proposal_iou(weighed, pixel_owner, place, m)
    return np.asarray(1.0 + (iou * np.array([o.score for o in labelled])).max(1))
