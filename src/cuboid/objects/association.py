"""The things that a frame shows and the objects of the map: which is which."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.frame import Float64Array
from cuboid.geometry.overlap import iou_matrix
from cuboid.kernels.claims import shared
from cuboid.objects.entry import MapObject
from cuboid.objects.matching import assign
from cuboid.surfaces.clusters import FrameClusters
from cuboid.tolerances import MOST, SOME

# A thing is an object when their overlap, in space or of what is seen, is at least this.
SAME = 0.25


@dataclass(frozen=True, slots=True)
class Association:
    """Which thing of a frame is which object.

    Attributes
    ----------
    objects : sequence of MapObject
        Those that may be seen.
    match : (n,) int64
        Place in `objects` of each thing's, -1 none.
    part : (n,) int64
        Of a thing without a match the object that most of it lies in, -1 none.
    iou : (n, m) float64
        3D IoU of the boxes.
    likeness : (n,) float64
        Of each thing to what it was matched to, 0..1.
    common : (n, m) int64
        Pixels of a thing that belong to an object.
    sight : (m,) int64
        Pixels that belong to an object, in any thing or none.
    """

    objects: Sequence[MapObject]
    match: npt.NDArray[np.int64]
    part: npt.NDArray[np.int64]
    iou: Float64Array
    likeness: Float64Array
    common: npt.NDArray[np.int64]
    sight: npt.NDArray[np.int64]


def associate(
    frame: FrameClusters,
    boxes: Float64Array,
    objects: Sequence[MapObject],
    theirs: Float64Array,
    pixel_owner: npt.NDArray[np.int32],
    known: npt.NDArray[np.bool_],
) -> Association:
    """Match the things of a frame to objects one to one; what is left over may be a part of one.

    The likeness of a thing and an object is the larger of their boxes' IoU and of the IoU of the pixels that they
    have: of the object those that it shows in this frame, of the thing those that the map knew before.

    Parameters
    ----------
    frame : FrameClusters
    boxes : (n, 15) float64
        Of the frame's things, see `pack`.
    objects : sequence of MapObject
        Those that may be seen.
    theirs : (m, 15) float64
        Their boxes.
    pixel_owner : (h, w) int32
        Number of the object that each working pixel belongs to, 0 none.
    known : (h, w) bool
        Where the map knew something before this frame.
    """
    n, m = len(frame.clusters), len(objects)
    common, size = _common_pixels(frame, objects, pixel_owner, known)
    nobody = np.full(n, -1, np.int64)
    if n == 0 or m == 0:
        return Association(objects, nobody, nobody, np.zeros((n, m)), np.zeros(n), common[:n], common[-1])
    iou = iou_matrix(boxes, theirs)
    mine, sight = common[:n], common.sum(0)
    # Of a thing at least some counts as known before: of what is all but new its known part tells little.
    whole = np.array([len(cluster.pixels) for cluster in frame.clusters])
    seen = mine / np.maximum(np.maximum(size, SOME * whole)[:, None] + sight[None] - mine, 1)
    match, part = nobody.copy(), nobody.copy()
    like, likeness = np.maximum(iou, seen), np.zeros(n)
    for i, j in assign(like, SAME):
        match[i], likeness[i] = j, like[i, j]
    held = mine / whole[:, None]
    best = held.argmax(1)
    lies = held[np.arange(n), best] >= MOST
    part[(match < 0) & lies] = best[(match < 0) & lies]
    return Association(objects, match, part, iou, likeness, mine, sight)


def _common_pixels(
    frame: FrameClusters,
    objects: Sequence[MapObject],
    pixel_owner: npt.NDArray[np.int32],
    known: npt.NDArray[np.bool_],
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return pixels by thing and object (n + 1, m), the last row for those of no thing, and each thing's known ones."""
    n, m = len(frame.clusters), len(objects)
    place = places_of([o.number for o in objects], int(pixel_owner.max()))
    table, size = np.empty((n + 1, m + 1), np.int64), np.empty(n + 1, np.int64)
    shared(frame.claim, pixel_owner, known, place, table, size)
    return table[:, :m], size[:n]


def places_of(numbers: Sequence[int], highest: int) -> npt.NDArray[np.int64]:
    """Return for each number up to at least the highest where it is in `numbers`, their count where it is not."""
    place = np.full(max([highest, *numbers]) + 1, len(numbers))
    place[list(numbers)] = np.arange(len(numbers))
    return place
