"""The map of a tracker between two frames: its objects, planes and points, and the changes that a user asks for."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.results import MapPoints, SupportPlane, TrackedObject
from cuboid.ground.core.working import step_of
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.se3 import transform
from cuboid.method.boxes.measured_sides import measured
from cuboid.method.boxes.uncertainty import Uncertainty, uncertainty_of
from cuboid.method.heatmap.voxel_map import VoxelMap
from cuboid.method.objects.box_without_depth import Planes
from cuboid.method.objects.boxing import usual_distance_m
from cuboid.method.objects.entry import MapObject
from cuboid.method.objects.object_map import ObjectMap
from cuboid.method.relations.furniture import find_furniture
from cuboid.method.surfaces.plane import Plane
from cuboid.method.surfaces.planes import PlaneTracker
from cuboid.results.files.object_table import ObjectTable
from cuboid.results.files.queries import MapQueries
from cuboid.runs.tracking.detecting import Detecting, same_fields
from cuboid.runs.tracking.furniture import Labels, furniture_entry, labels_of


class TrackedMap(MapQueries):
    """The voxels, planes, objects and furniture that posed frames have built; `PosedTracker` adds the frames.

    The map is stored in the frame of the first camera. All results are in the world; `support`, `voxels` and the
    entries of `ever_labelled` are in the frame of the map.

    Parameters
    ----------
    intrinsics : Intrinsics
    config : TrackerConfig
    memory_mb : float
        Memory limit of the process, in units of 2**20 bytes, above which parts of the map out of view are evicted; they
        are loaded again when accessed.
    """

    def __init__(self, intrinsics: Intrinsics, config: TrackerConfig, memory_mb: float) -> None:
        self.intrinsics = intrinsics
        self.config = config
        self._memory_mb = memory_mb
        self._T_world_map: Float64Array | None = None
        # Boxes of each object in the map and in the world: the world box is reused while the map box is the same.
        self._world_boxes: dict[int, tuple[Box, Box]] = {}
        # How sure each object is, with the values from which it follows.
        self._sure: dict[int, tuple[tuple[object, ...], Uncertainty]] = {}
        self._detecting = Detecting()
        self._furniture_labels: Labels = {}
        self._begin()

    def _begin(self) -> None:
        """Begin an empty map with the present configuration."""
        c = self.config
        self._planes = PlaneTracker(c)
        self._voxels = VoxelMap(c.voxel_m, c.depth_noise_per_m, c.max_depth_m, self._memory_mb)
        self._map = ObjectMap(c, self._voxels, self._planes)
        self._detecting.begin(self._map.store, c)

    @property
    def T_world_map(self) -> Float64Array:
        """Pose of the map in the world, (4, 4): `ever_labelled`, `voxels` and `support` are in the frame of the map."""
        return np.eye(4) if self._T_world_map is None else self._T_world_map

    def in_world(self, box: Box) -> Box:
        """Transform a box from the map to the world."""
        return box.moved(self.T_world_map)

    def _box_in_world(self, label: int, box: Box) -> Box:
        """Transform the box of the object with a label from the map to the world, or return the last result again."""
        boxes = self._world_boxes.get(label)
        if boxes is None or boxes[0] is not box:
            boxes = self._world_boxes[label] = box, self.in_world(box)
        return boxes[1]

    @property
    def objects(self) -> ObjectTable:
        """The objects of the map with a label and at least the probability `config.min_probability`, by label."""
        index_of = {identity: k for k, identity in enumerate(self.plane_identities)}
        reported = self._reported()
        items = [self._tracked(entry, index_of) for entry in reported]
        self._sure = {entry.label: self._sure[entry.label] for entry in reported}
        without_depth = self.objects_without_depth()
        items += without_depth
        return ObjectTable(sorted(items, key=lambda item: item.label) if without_depth else items)

    def _reported(self) -> list[MapObject]:
        """Return the objects with depth readings that results contain, by label."""
        return [entry for entry in self._map.store.confirmed() if entry.is_reported(self.config.min_probability)]

    def _tracked(self, entry: MapObject, index_of: Mapping[int, int]) -> TrackedObject:
        """Return an object as results contain it; `index_of` gives the index of a plane by its identity."""
        plane, sure = self._planes.find(entry.plane), self.uncertainty(entry)
        return TrackedObject(
            **same_fields(entry),
            box=self._box_in_world(entry.label, entry.box),
            heat=entry.heat,
            points=len(self._voxels.stored.rows_of(entry.number)),
            mean_color=entry.mean_color,
            plane=None if plane is None else index_of[plane.identity],
            size_sigma_m=tuple(sure.size_sigma_m.tolist()),
            center_sigma_m=tuple(sure.center_sigma_m.tolist()),
            sides_seen=sure.sides_seen,
        )

    def uncertainty(self, entry: MapObject) -> Uncertainty:
        """Return how sure the box of an object with a label is, or the last result while its values are the same."""
        last = self._sure.get(entry.label)
        values = entry.box, entry.points, entry.directions, entry.plane, entry.sides_m
        if last is None or any(old is not new for old, new in zip(last[0], values, strict=True)):
            voxel_m, k = self._voxels.voxel_m, self.intrinsics
            focal_px = k.fx / step_of(k, self.config.working_width_px)
            distance_m = usual_distance_m(entry.noise_m, self._voxels.noise_per_m, voxel_m * focal_px)
            found = uncertainty_of(
                entry.box,
                entry.points,
                entry.directions,
                entry.noise_m,
                distance_m,
                distance_m / focal_px,
                voxel_m,
                level_sigma_m=measured(entry.box, entry.sides_m, voxel_m)[1],
                rests=entry.plane is not None,
                R_world_map=self.T_world_map[:3, :3],
            )
            last = self._sure[entry.label] = values, found
        return last[1]

    def _support_planes(self) -> Planes:
        return Planes(self._planes.likely_up, [self._planes.in_world(plane) for plane in self._planes.in_use])

    @property
    def planes(self) -> list[SupportPlane]:
        """The supporting planes in use."""
        return [self._plane_in_world(plane) for plane in self._planes.in_use]

    def _plane_in_world(self, plane: Plane) -> SupportPlane:
        T, (normal, offset) = self.T_world_map, self._planes.in_world(plane)
        up = T[:3, :3] @ normal
        return SupportPlane(up, offset - float(up @ T[:3, 3]), transform(T, self._planes.outline_in_world(plane)))

    @property
    def plane_identities(self) -> list[int]:
        """Identities of `planes`, as in `MapObject.plane`."""
        return [plane.identity for plane in self._planes.in_use]

    @property
    def furniture_planes(self) -> dict[int, tuple[int, ...]]:
        """Indices of the planes that each piece of furniture with a label bears, by label, ended labels included."""
        found: dict[int, tuple[int, ...]] = {}
        labels_of_plane = self._furniture_labels_of_planes()
        for k, identity in enumerate(self.plane_identities):
            found |= {label: (*found.get(label, ()), k) for label in labels_of_plane.get(identity, ())}
        return found

    def _furniture_labels_of_planes(self) -> Labels:
        """Return the labels of furniture by identity of the present planes; some planes have absorbed others."""
        labels_of_plane: Labels = {}
        for identity, labels in self._furniture_labels.items():
            plane = self._planes.find(identity)
            if plane is not None:
                labels_of_plane[plane.identity] = tuple(sorted({*labels_of_plane.get(plane.identity, ()), *labels}))
        return labels_of_plane

    def find_furniture(self, points: MapPoints, *, labelled: bool = False) -> ObjectTable:
        """Return the furniture that bears the supporting planes, by label.

        A piece keeps the label that the furniture beneath its planes had before; otherwise it gets a new label.

        Parameters
        ----------
        points : MapPoints
            The present global point map.
        labelled : bool
            Return only pieces that already have a label; no piece gets a new one.
        """
        if labelled and not self._furniture_labels:
            return ObjectTable()
        in_use = self._planes.in_use
        pieces = find_furniture(self.planes, points, self.up)
        borne = [[in_use[k] for k in piece.planes] for piece in pieces]
        labels_of_plane = self._furniture_labels_of_planes()
        new_label = None if labelled else self._map.store.next_label
        labels = labels_of([[plane.identity for plane in planes] for planes in borne], labels_of_plane, new_label)
        entries = []
        for piece, planes, labels_of_piece in zip(pieces, borne, labels, strict=True):
            if labels_of_piece:
                labels_of_plane |= {plane.identity: labels_of_piece for plane in planes}
                entries.append(furniture_entry(piece, labels_of_piece, planes, points))
        self._furniture_labels = labels_of_plane
        return ObjectTable(sorted(entries, key=lambda item: item.label))

    @property
    def up(self) -> Float64Array | None:
        """Up in the world, (3,); None while unknown."""
        up = self._planes.up
        return None if up is None else np.asarray(self.T_world_map[:3, :3] @ up)

    def ever_labelled(self) -> list[MapObject]:
        """Return all objects with a label, including retired ones, by label."""
        return self._map.store.ever_labelled()

    def merge(self, first: MapObject, second: MapObject) -> MapObject:
        """Merge two objects because a user says that they are one; return the result, under the older label."""
        return self._map.merge(first, second)

    def retire(self, entry: MapObject, last_box: Box | None = None) -> None:
        """Retire an object because a user asks for it, or because it was taken away; its label is never reused.

        Parameters
        ----------
        entry : MapObject
        last_box : Box, optional
            Box at which it was last known to be, if its present one shows something else.
        """
        self._map.store.retire(entry)
        if last_box is not None:
            self._map.store.place(entry, last_box)

    def keep_points(self, entry: MapObject, kept: npt.NDArray[np.bool_]) -> None:
        """Keep only some points (N,) of an object, because the others were lost with a damaged file."""
        self._map.store.keep_points(entry, kept)

    def objects_without_depth(self) -> list[TrackedObject]:
        """Return the labelled objects without depth readings, by label."""
        return self._detecting.objects(self._support_planes(), self.T_world_map)

    def merge_without_depth(self, label: int, other: int) -> int:
        """Merge two objects of which one or both have no depth readings; return the older label, which stays."""
        return self._detecting.without_depth.merge(label, other, self._support_planes())

    def retire_without_depth(self, label: int) -> bool:
        """Retire an object without depth readings because a user asks for it; return whether one had the label."""
        return self._detecting.without_depth.retire(label)

    def take_over(self, entry: MapObject, old: MapObject) -> None:
        """Let a labelled object take over the older label of a retired one, because that one was moved there."""
        self._map.store.take_over(entry, old)

    @property
    def support(self) -> PlaneTracker:
        """The supporting planes and their ground plans."""
        return self._planes

    def begin_labels(self, first: int) -> None:
        """Set the smallest label for new objects."""
        self._map.store.begin_labels(first)

    @property
    def voxels(self) -> VoxelMap:
        """The global voxel map."""
        return self._voxels

    @property
    def points_known(self) -> int:
        """Number of points in the global point map."""
        return self._voxels.stored.alive

    @property
    def map_bytes(self) -> int:
        """Memory of the points and tables of the global point map that are loaded, bytes."""
        return self._voxels.stored.nbytes

    def map_points(self) -> MapPoints:
        """Return the global point map, with the labels of `objects`.

        Points of small objects are replaced by their fine points, if there are any.
        """
        stored = self._voxels.stored
        label_of = np.zeros(max((o.number for o in self._map.store.living()), default=0) + 1, np.int32)
        for entry in self._reported():
            label_of[entry.number] = entry.label
        rows = stored.living()
        xyz, index = stored.spread(rows)
        rows = rows[index]
        owner = stored.owner[rows]
        label = label_of[np.where(owner < len(label_of), owner, 0)]
        fine, replaced = self._voxels.fine.fine_replacements(xyz, label > 0)
        kept = np.ones(len(xyz), bool)
        kept[replaced] = False
        rows = np.concatenate([rows[kept], fine])
        xyz = transform(self.T_world_map, np.concatenate([xyz[kept], stored.xyz(fine)])).astype(np.float32)
        label = np.concatenate([label[kept], label[replaced]])
        return MapPoints(xyz, stored.rgb(rows), stored.heat(rows), label)
