"""A tracker whose map lies in the frame of the first camera: results do not depend on the world of the poses.

Voxels, cells of ground plans and the order of sums follow the axes of the map. In the first camera's frame, turned as
images are turned, these are the same for a recording whose poses were multiplied by a rigid transform, or whose images
were rolled; and the numbers stay small where poses are those of a map of the earth.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from cuboid.core.config import TrackerConfig
from cuboid.core.frame import Float64Array, Frame, Intrinsics
from cuboid.core.results import FrameResult, MapPoints, SupportPlane, TrackedObject
from cuboid.geometry.box import Box
from cuboid.geometry.se3 import inverse, transform
from cuboid.tracking.posed_tracker import PosedTracker
from cuboid.tracking.rolling import Roll, farther_up

# Poses in the map have this many decimals, metres: the last bits, which another world changes, are cut off.
POSE_DECIMALS = 9


class FirstCameraTracker:
    """Gives a tracker of posed frames their poses in the frame of the first camera, and its results in the world.

    Parameters
    ----------
    intrinsics : Intrinsics
        Of every frame.
    tracker : PosedTracker
        One that has no frames yet.
    """

    def __init__(self, intrinsics: Intrinsics, tracker: PosedTracker) -> None:
        self._intrinsics, self._tracker = intrinsics, tracker
        # The map's frame in the world; None before the first frame.
        self._T_world_map: Float64Array | None = None
        # Of each object the box in the map, and in the world: one that did not change stays the same object.
        self._boxes: dict[int, tuple[Box, Box]] = {}

    def update(self, frame: Frame, anchor: int = 0) -> FrameResult:
        """Take in one frame, whose pose is anchored to a keyframe; see `PosedTracker.update`."""
        T_world_camera = frame.T_world_camera
        if T_world_camera is None:
            return self._tracker.update(frame, anchor)
        T_world_map = self._T_world_map
        if T_world_map is None:
            T_world_map = Roll(self._intrinsics, farther_up(frame.depth_m) or 0).pose(T_world_camera)
        T_map_camera = np.round(inverse(T_world_map) @ T_world_camera, POSE_DECIMALS)
        result = self._tracker.update(frame.at(T_map_camera), anchor)
        self._T_world_map = T_world_map
        return dataclasses.replace(
            result,
            T_world_camera=T_world_camera,
            sightings=tuple(
                [dataclasses.replace(one, box=self._box_of(one.label, one.box)) for one in result.sightings]
            ),
            proposals=tuple([dataclasses.replace(one, box=one.box.moved(T_world_map)) for one in result.proposals]),
        )

    def apply_correction(self, moved: Mapping[int, Float64Array]) -> None:
        """Apply a pose correction; see `PosedTracker.apply_correction`."""
        T = self._T
        self._tracker.apply_correction({k: inverse(T) @ T_new_old @ T for k, T_new_old in moved.items()})

    @property
    def config(self) -> TrackerConfig:
        """The configuration in use."""
        return self._tracker.config

    @property
    def _T(self) -> Float64Array:
        return np.eye(4) if self._T_world_map is None else self._T_world_map

    def _box_of(self, label: int, box: Box) -> Box:
        """Return an object's box in the world."""
        known = self._boxes.get(label)
        if known is None or known[0] is not box:
            known = self._boxes[label] = box, box.moved(self._T)
        return known[1]

    @property
    def objects(self) -> list[TrackedObject]:
        """The confirmed objects."""
        return [dataclasses.replace(one, box=self._box_of(one.label, one.box)) for one in self._tracker.objects]

    @property
    def planes(self) -> list[SupportPlane]:
        """The supporting planes."""
        T, found = self._T, self._tracker.planes
        normals = [T[:3, :3] @ plane.normal for plane in found]
        return [
            SupportPlane(normal, plane.offset - float(normal @ T[:3, 3]), transform(T, plane.extent))
            for normal, plane in zip(normals, found, strict=True)
        ]

    @property
    def up(self) -> Float64Array | None:
        """Up in the world, (3,); None while unknown."""
        up = self._tracker.up
        return None if up is None else self._T[:3, :3] @ up

    @property
    def points_known(self) -> int:
        """Points of the global point map."""
        return self._tracker.points_known

    @property
    def map_bytes(self) -> int:
        """Memory of the global point map, bytes."""
        return self._tracker.map_bytes

    def map_points(self) -> MapPoints:
        """Return the global point map."""
        points = self._tracker.map_points()
        return dataclasses.replace(points, xyz=transform(self._T, points.xyz).astype(np.float32))
