"""What a scene's state is made of: the classes whose objects are parts of it, and those that are values within one."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy.typing as npt

from cuboid.config import TrackerConfig
from cuboid.frame import Intrinsics
from cuboid.geometry.box import Box
from cuboid.heatmap.anchors import Anchor, Anchors
from cuboid.heatmap.row_blocks import RowBlocks
from cuboid.heatmap.voxel_map import VoxelMap
from cuboid.objects.affinity import Affinity
from cuboid.objects.boxing import Boxing
from cuboid.objects.entry import MapObject, State
from cuboid.objects.object_map import ObjectMap
from cuboid.objects.store import ObjectStore
from cuboid.poses.alignment import Points, Reference
from cuboid.poses.atlas import Atlas
from cuboid.poses.estimator import PoseEstimator
from cuboid.poses.graph import Edge
from cuboid.poses.keyframes import Keyframe
from cuboid.poses.places import Appearance
from cuboid.poses.pyramid import SmallImage
from cuboid.posing import EstimatedPoses
from cuboid.scene.localisation import ScenePoses
from cuboid.surfaces.grid import GroundPlan
from cuboid.surfaces.plane import Plane
from cuboid.surfaces.planes import PlaneTracker
from cuboid.surfaces.up import UpVote
from cuboid.surfaces.windows import Windows
from cuboid.tracker import Tracker

AnyArray = npt.NDArray[Any]


@dataclass(frozen=True, slots=True)
class Kind:
    """A class whose objects are parts.

    Attributes
    ----------
    cls : type
    key : callable
        Returns what tells an object from others of its class; none where there is only one.
    excluded : frozenset of str
        Attributes that are saved elsewhere, are given anew, or follow from others.
    many : bool
        There may be many, of which few change. What their attributes hold is only replaced, never changed: those that
        hold the same things as before are as they were, and nothing of them needs a copy.
    stamp : callable or None
        Returns what is another one as soon as anything in an object has changed: what has not is not looked into.
    """

    cls: type
    key: Callable[[Any], object] = lambda item: ""
    excluded: frozenset[str] = frozenset()
    many: bool = False
    stamp: Callable[[Any], object] | None = None


# Rows of the map are saved in blocks: see `saving`.
_ROWS = frozenset(
    {
        *(
            "memory_mb",
            "_row_memory",
            "_block_store",
            "_points",
            "_cubes",
            "_seen",
            "_marks",
            "_unindexed",
            "_last_viewed",
            "_ready",
        ),
        "before_visit",
    }
)

KINDS = {
    kind.cls: kind
    for kind in (
        Kind(Tracker, excluded=frozenset({"intrinsics", "_propose", "_memory_mb"})),
        Kind(PlaneTracker),
        Kind(UpVote),
        Kind(Windows),
        Kind(Plane, key=lambda plane: plane.identity, stamp=lambda plane: (plane.stamp, plane.plan.stamp)),
        Kind(VoxelMap, excluded=_ROWS),
        Kind(RowBlocks),
        Kind(Anchors, excluded=frozenset({"pending", "motions", "_keyframes", "_of", "_pairs"})),
        Kind(Anchor, key=lambda anchor: anchor.number, many=True),
        Kind(ObjectMap),
        Kind(Boxing),
        Kind(ObjectStore, excluded=frozenset({"_bounds", "_changed"})),
        Kind(Affinity),
        Kind(MapObject, key=lambda entry: entry.number, many=True),
        Kind(ScenePoses, excluded=frozenset({"intrinsics"})),
        Kind(EstimatedPoses),  # of files from before there were parts
        Kind(PoseEstimator, excluded=frozenset({"intrinsics"})),
        Kind(Atlas),
        Kind(Keyframe, key=lambda keyframe: keyframe.number, excluded=frozenset({"_reference"}), many=True),
    )
}

# Values: they lie within the part that has them.
VALUES: tuple[type, ...] = (
    Box, TrackerConfig, Intrinsics, GroundPlan, SmallImage, Points, Reference, Appearance, Edge,
)  # fmt: skip
# Of these, also the arrays are never changed.
UNCHANGED = frozenset({SmallImage, Points, Reference, Appearance, Edge})
ENUMS = {"State": State}


@dataclass(frozen=True, slots=True)
class Part:
    """An object as it is saved.

    Attributes
    ----------
    kind : str
        Its class.
    fields : dict of str to values
        None, truth values, numbers, texts; a list is any other thing: its first item says what.
    arrays : dict of str to (str, array)
        The large ones, by their path in the fields, each with its form. One that is the same object as before has not
        changed.
    """

    kind: str
    fields: dict[str, Any]
    arrays: dict[str, tuple[str, AnyArray]] = field(default_factory=dict)


def attributes(item: object) -> Sequence[str]:
    """Return the names of all attributes that an object has, in order."""
    cls: Any = type(item)
    return fields_of(cls) or list(vars(item))


@cache
def fields_of(cls: Any) -> tuple[str, ...]:
    """Return the names of the fields of a dataclass, in order; none of any other class."""
    return tuple(one.name for one in dataclasses.fields(cls)) if dataclasses.is_dataclass(cls) else ()
