"""A frame's own boxes and the map of objects: which is which."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.geometry.box import Box
from cuboid.geometry.overlap import overlaps, pack
from cuboid.objects.entry import MapObject
from cuboid.objects.matching import assign
from cuboid.surfaces.clusters import FrameCluster

# A frame's box is an object's when their overlap, or the share of common points, is at least this.
SAME = 0.25
# A part of an object is seen when so much of the frame's box lies in the object's.
PART = 0.5


@dataclass(frozen=True, slots=True)
class Match:
    """What a frame's cluster was matched to.

    Attributes
    ----------
    entry : MapObject or None
    iou : float
        3D IoU of the frame's box with the object's.
    primary : bool
        Whether it is the object's one match; a further part of it otherwise.
    """

    entry: MapObject | None
    iou: float
    primary: bool


def associate(
    clusters: Sequence[FrameCluster],
    boxes: Sequence[Box],
    objects: Sequence[MapObject],
    pixel_owner: npt.NDArray[np.int32],
) -> list[Match]:
    """Match a frame's clusters to objects: one to one first, then partial views.

    The likeness of a cluster and an object is the larger of their boxes' IoU and the share of the cluster's pixels
    that lie on the object's own points of the map. What is left over is a part of the object that holds most of it.

    Parameters
    ----------
    clusters, boxes : of the frame, alike in number
    objects : those that may be seen
    pixel_owner : (h, w) int32
        Number of the object that each working pixel belongs to, 0 none.
    """
    if not clusters or not objects:
        return [Match(None, 0.0, False) for _ in clusters]
    iou, inside = overlaps(pack(boxes), pack([o.box for o in objects]))
    common = _common_points(clusters, objects, pixel_owner)
    likeness = np.maximum(iou, common)
    partner = dict(assign(likeness, SAME))
    matches = []
    for k in range(len(clusters)):
        j = partner.get(k)
        if j is not None:
            matches.append(Match(objects[j], float(iou[k, j]), True))
            continue
        part = np.maximum(common[k], np.where(inside[k] >= PART, inside[k], 0.0))
        j = int(part.argmax())
        matches.append(Match(objects[j] if part[j] >= SAME else None, float(iou[k, j]), False))
    return matches


def _common_points(
    clusters: Sequence[FrameCluster], objects: Sequence[MapObject], pixel_owner: npt.NDArray[np.int32]
) -> npt.NDArray[np.float64]:
    owner = pixel_owner.ravel()
    place = np.zeros(max(o.number for o in objects) + 1, np.int64)
    place[[o.number for o in objects]] = np.arange(1, len(objects) + 1)
    sizes = np.array([len(cluster.pixels) for cluster in clusters])
    numbers = owner[np.concatenate([cluster.pixels for cluster in clusters])]
    numbers = np.where((numbers > 0) & (numbers < len(place)), numbers, 0)
    columns = len(objects) + 1
    cells = np.repeat(np.arange(len(clusters)) * columns, sizes) + place[numbers]
    table = np.bincount(cells, minlength=len(clusters) * columns).reshape(-1, columns)
    return np.asarray(table[:, 1:] / sizes[:, None])
