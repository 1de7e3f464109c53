"""The tracker: one frame in, what was seen in it out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from cuboid.boxes.fit import Resting, fit_boxes
from cuboid.boxes.quantiles import quantile
from cuboid.compiletime import working_s
from cuboid.config import TrackerConfig
from cuboid.errors import FrameError
from cuboid.frame import Float32Array, Float64Array, Frame, Intrinsics, UInt8Array
from cuboid.geometry.box import Box
from cuboid.geometry.se3 import inverse, moved_beyond
from cuboid.heatmap.anchors import LAST_KEYFRAME
from cuboid.heatmap.pixel_heat import pixel_heat, weigh
from cuboid.heatmap.voxel_map import VoxelMap
from cuboid.kernels.outlines import BOTTOM, LEFT, RIGHT, TOP
from cuboid.kernels.pixels import assign_planes
from cuboid.limits import MAX_PROPOSALS, MEMORY_MB
from cuboid.object_table import ObjectTable
from cuboid.objects.association import Association
from cuboid.objects.entry import MapObject
from cuboid.objects.object_map import ObjectMap
from cuboid.objects.prior import prior_of
from cuboid.objects.validity import too_large
from cuboid.objects.visibility import blended_rectangle, measure_visibility
from cuboid.proposals import make_source
from cuboid.proposals.types import Proposals, ProposalSource
from cuboid.results import FrameResult, MapPoints, Proposal3D, Sighting, SupportPlane, TrackedObject
from cuboid.sensor import excess_noise, resolves_m
from cuboid.surfaces.cells import find_cells, find_voting_cells, patch_pixels, with_level_patches
from cuboid.surfaces.frame_segments import FrameSegment, FrameSegments, points_of, segment_frame
from cuboid.surfaces.grid import CELL_M
from cuboid.surfaces.planes import PlaneTracker
from cuboid.tolerances import BIAS_M, DRIFT_M, DRIFT_RAD, SAMPLE, STRAYS
from cuboid.working import WorkingImage, filled, thin


class Stopwatch:
    """Milliseconds of each stage of one frame, in the order of work."""

    def __init__(self) -> None:
        self.milliseconds: dict[str, float] = {}
        self._last = working_s()

    def lap(self, stage: str) -> None:
        """Charge the time since the last lap to a stage."""
        now = working_s()
        self.milliseconds[stage] = (now - self._last) * 1e3
        self._last = now


class Tracker:
    """Finds the objects of a static scene in a stream of posed RGB-D frames, and keeps their labels.

    Parameters
    ----------
    intrinsics : Intrinsics
        Of every frame.
    config : TrackerConfig, optional
    proposals : str or ProposalSource, optional
        Name of a 2D proposal source, or any callable from (frame, intrinsics) to `Proposals`.
    memory_mb : float
        Memory of the process, in units of 2**20 bytes, beyond which parts of the map that are out of view are evicted,
        and loaded again when they are accessed.

    Raises
    ------
    InputError
        If no proposal source has that name.
    """

    def __init__(
        self,
        intrinsics: Intrinsics,
        config: TrackerConfig | None = None,
        proposals: str | ProposalSource | None = None,
        *,
        memory_mb: float = MEMORY_MB,
    ) -> None:
        self.intrinsics = intrinsics
        self.config = config or TrackerConfig()
        self._memory_mb = memory_mb
        self._propose = make_source(proposals, self.config)
        self._begin()
        self._count = 0
        self._place: Float64Array | None = None
        self._looked_from: Float64Array | None = None
        self._due = True

    def _begin(self) -> None:
        c = self.config
        self._planes = PlaneTracker(c)
        self._voxels = VoxelMap(c.voxel_m, c.depth_noise_per_m, c.max_depth_m, self._memory_mb)
        self._map = ObjectMap(c, self._voxels, self._planes)

    def update(self, frame: Frame, anchor: int = 0) -> FrameResult:
        """Take in a frame.

        Parameters
        ----------
        frame : Frame
        anchor : int
            Keyframe that the frame's pose is anchored to, where poses are estimated; see `apply_correction`. After
            hours of video there are more than are distinguished.

        Raises
        ------
        FrameError
            If the frame has no pose, or one farther away than the map reaches, or its size is not that of the
            intrinsics.
        """
        T_world_camera = self._check(frame)
        anchor = anchor if anchor <= LAST_KEYFRAME else 0
        T_camera_world = inverse(T_world_camera)
        watch = Stopwatch()
        image = thin(frame, self.intrinsics, self.config.working_width_px, self._count)
        if self._count == 0:
            self._estimate_noise(image)
        every = self._proposals(frame)
        proposals = every.best(MAX_PROPOSALS)
        watch.lap("proposals")
        solid = filled(image)
        new_viewpoint = self._is_new_viewpoint(T_world_camera)
        on_plane, support, planes = self._find_planes(
            image, solid, T_world_camera, frame.up_camera, anchor, new_viewpoint
        )
        watch.lap("planes")
        candidate = self._candidates(solid, on_plane)
        c = self.config
        weighed = weigh(solid, candidate, proposals, c)
        heat = pixel_heat(solid, weighed)
        watch.lap("heat")
        # Deferred to the next frame: a frame from a new viewpoint has planes and boxes to update already.
        due, self._due = self._due, new_viewpoint
        # On a later visit every frame may show a change: nothing is deferred.
        refresh_map = due or self._voxels.revisited
        slots = self._voxels.fuse(image, heat, T_world_camera, frame.index, anchor, refresh_map)
        self._voxels.carve_free_space(image, T_camera_world, refresh_map)
        watch.lap("fuse")
        in_frustum = self._map.objects_in_frustum(image, T_camera_world)
        objects = self._map.prune_candidates(in_frustum)
        left_out = len(in_frustum) - len(objects)
        pixel_owner, known = self._voxels.owner_of(slots)
        prior = prior_of(objects, pixel_owner, weighed)
        frame_segments = segment_frame(
            image, solid, heat, weighed, prior, on_plane, support, planes, self._sides(T_world_camera),
            c,
        )  # fmt: skip
        boxes = self._boxes(frame_segments.segments, image, T_world_camera)
        watch.lap("boxes")
        found = self._map.update(
            frame.index, frame_segments, boxes, objects, slots, pixel_owner, known, candidate,
            self._viewpoint_angle(image, T_world_camera), new_viewpoint, anchor, T_world_camera[:3, 3],
        )  # fmt: skip
        in_frustum = self._map.objects_in_frustum(image, T_camera_world)
        if due:
            self._refine(frame.index, image, heat, slots, in_frustum, T_world_camera, anchor)
        watch.lap("map")
        sightings = self._frame_sightings(frame.index, image, slots, in_frustum, frame_segments, found, T_camera_world)
        own = self._frame_boxes(frame_segments, boxes, found)
        watch.lap("matching")
        self._count += 1
        return FrameResult(
            index=frame.index,
            timestamp_s=frame.timestamp_s,
            T_world_camera=T_world_camera,
            sightings=sightings,
            proposals=own,
            objects_known=self._map.store.labelled,
            heat=heat,
            milliseconds=watch.milliseconds,
            left_out={
                "proposals": len(every) - len(proposals),
                "clusters": frame_segments.left_out,
                "candidates": left_out,
            },
            size=(self.intrinsics.width, self.intrinsics.height),
        )

    def apply_correction(self, moved: Mapping[int, Float64Array]) -> None:
        """Move the map, its planes and its objects after a pose correction (loop closure, relocalisation).

        What was last observed from a keyframe moves with it; objects that meet merge under the older label. Planes and
        objects move at once. Points move lazily, when their region is next accessed: the cost of a correction depends
        on the number of keyframes, planes and objects, not of points.

        Parameters
        ----------
        moved : mapping of int to (4, 4) float64
            T_new_old in the world, of each keyframe that moved.
        """
        self._planes.apply_correction(moved)
        self._map.apply_correction(moved)

    def _estimate_noise(self, image: WorkingImage) -> None:
        """Estimate from the first frame how much noisier the sensor is than configured."""
        nominal = self.config.depth_noise_per_m
        excess = excess_noise(image.depth_m, image.camera, nominal, self.config.max_depth_m)
        if excess > 1.0:
            self.config = self.config.within_range(depth_noise_per_m=excess * nominal)
            self._begin()

    def _check(self, frame: Frame) -> Float64Array:
        expected = (self.intrinsics.height, self.intrinsics.width)
        if frame.depth_m.shape != expected:
            raise FrameError(
                f"frame {frame.index} is {frame.depth_m.shape[1]} x {frame.depth_m.shape[0]} pixels, "
                f"expected {expected[1]} x {expected[0]}"
            )
        if frame.T_world_camera is None:
            raise FrameError(f"frame {frame.index} has no camera pose")
        far_m, reach_m = np.abs(frame.T_world_camera[:3, 3]).max(), self._voxels.reach_m
        if far_m + self.config.max_depth_m >= reach_m:
            raise FrameError(
                f"frame {frame.index} is {far_m:.0f} m from the origin of its poses, the map reaches {reach_m:.0f} m"
            )
        return frame.T_world_camera

    def _proposals(self, frame: Frame) -> Proposals:
        proposals, c = self._propose(frame, self.intrinsics), self.intrinsics
        if len(proposals) and (proposals.boxes_xyxy[:, 2:] > (c.width, c.height)).any():
            raise ValueError(f"proposals of frame {frame.index} lie outside its {c.width} x {c.height} pixels")
        return proposals

    def _find_planes(
        self,
        image: WorkingImage,
        solid: WorkingImage,
        T_world_camera: Float64Array,
        up_camera: Float64Array | None,
        keyframe: int,
        new_viewpoint: bool,
    ) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32], npt.NDArray[np.int64]]:
        """Track the supporting planes; return the ones that pixels lie on, those beneath them, all identities."""
        c, planes = self.config, self._planes
        seen_by = image.depth_m, image.camera, T_world_camera, c.depth_noise_per_m, c.max_depth_m
        if planes.vote_is_due() and planes.vote_up(find_voting_cells(*seen_by), T_world_camera, up_camera):
            self._map.reset_supports()
        patch = patch_pixels(image.camera)
        patches = np.full([n // patch for n in image.depth_m.shape], -1, np.int32)
        renew = new_viewpoint or not planes.known
        if renew:
            cells = find_cells(*seen_by)
            if planes.up is not None:
                cells = with_level_patches(cells, planes.up, *seen_by)
            patches = planes.update(self._count, cells, keyframe)
        if planes.T_plan_world is None or not planes.planes:
            nowhere = np.full(image.depth_m.shape, -1, np.int32)
            return nowhere, nowhere, np.zeros(0, np.int64)
        k, on_plane, support = image.camera, *(np.empty(image.depth_m.shape, np.int32) for _ in range(2))
        view = planes.planes_in_frustum(k, min(c.max_depth_m, float(image.depth_m.max())), T_world_camera)
        assign_planes(
            solid.depth_m, np.array([k.fx, k.fy, k.cx, k.cy]), planes.T_plan_world @ T_world_camera,
            planes.in_camera(view, T_world_camera), view.numbers, view.ground,
            view.origin, CELL_M, patches, patch, c.depth_noise_per_m, c.min_height_m, BIAS_M,
            c.max_depth_m, on_plane, support, view.seen,
        )  # fmt: skip
        if renew:
            planes.add_readings(view, keyframe)
        return on_plane, support, view.identities

    def _candidates(self, image: WorkingImage, on_plane: npt.NDArray[np.int32]) -> UInt8Array:
        """Return which readings may belong to an object: all within range but those on a supporting plane."""
        within = (image.depth_m > 0) & (image.depth_m <= self.config.max_depth_m)
        return np.asarray(within & (on_plane < 0), dtype=np.uint8)

    def _sides(self, T_world_camera: Float64Array) -> npt.NDArray[np.int64]:
        """Return which side of a segment lies below, above, right and left of it in the image, for any up."""
        up = T_world_camera[:3, :3].T @ self._planes.likely_up
        if abs(up[0]) <= abs(up[1]):
            return np.array([TOP, BOTTOM, LEFT, RIGHT] if up[1] > 0 else [BOTTOM, TOP, RIGHT, LEFT])
        return np.array([LEFT, RIGHT, TOP, BOTTOM] if up[0] > 0 else [RIGHT, LEFT, BOTTOM, TOP])

    def _is_new_viewpoint(self, T_world_camera: Float64Array) -> bool:
        """Tell whether the camera has moved beyond the pose error since the last frame for which this was true.

        Below that the map cannot tell the two viewpoints apart: planes, boxes and free space seen from there need not
        be updated again.
        """
        last = self._looked_from
        if last is not None and not moved_beyond(last, T_world_camera, DRIFT_M, DRIFT_RAD):
            return False
        self._looked_from = T_world_camera
        return True

    def _viewpoint_angle(self, image: WorkingImage, T_world_camera: Float64Array) -> float:
        """Return the change of viewing angle since the last frame, radians: baseline over depth; infinite at first."""
        last, self._place = self._place, T_world_camera[:3, 3]
        distance_m = 0.0 if last is None else _median_depth_m(image.depth_m)
        return math.inf if last is None or distance_m == 0.0 else math.dist(self._place, last) / distance_m

    def _boxes(self, segments: Sequence[FrameSegment], image: WorkingImage, T_world_camera: Float64Array) -> list[Box]:
        if not segments:
            return []
        some = [c.pixels[:: 1 + len(c.pixels) // (SAMPLE // 2)] for c in segments]
        points = points_of(np.concatenate(some), image, T_world_camera)
        found = {identity: self._planes.find(identity) for identity in {k for c in segments for k in c.supports}}
        rests = {identity: self._planes.in_world(plane) for identity, plane in found.items() if plane is not None}
        unknown = self._planes.likely_up, None
        planes = [_main_support(c.supports, rests) or unknown for c in segments]
        return fit_boxes(points, [len(pixels) for pixels in some], planes, STRAYS)

    def _refine(
        self,
        frame: int,
        image: WorkingImage,
        heat: Float32Array,
        slots: npt.NDArray[np.int32],
        in_frustum: Sequence[MapObject],
        T_world_camera: Float64Array,
        anchor: int,
    ) -> None:
        """Fuse small labelled objects at the fine resolution as well, as far as the sensor resolves it."""
        voxels, c = self._voxels, image.camera
        small = [o.number for o in in_frustum if o.confirmed and max(o.box.size.tolist()) <= voxels.small_m]
        if small:
            # The phases of thinned frames make up for a step of two.
            far_m = resolves_m(voxels.fine_m, self.config.depth_noise_per_m, min(image.step, 2) * c.fx)
            numbers = np.zeros(max(small) + 1, bool)
            numbers[small] = True
            voxels.refine(image, heat, T_world_camera, frame, anchor, slots, numbers, far_m)

    def _frame_sightings(
        self,
        frame: int,
        image: WorkingImage,
        slots: npt.NDArray[np.int32],
        in_frustum: Sequence[MapObject],
        frame_segments: FrameSegments,
        found: Association,
        T_camera_world: Float64Array,
    ) -> tuple[Sighting, ...]:
        """Return the sightings of the map's visible objects; candidates that meet all criteria are confirmed."""
        objects = [o for o in in_frustum if len(o.points)]
        visibilities = measure_visibility(
            objects, self._map.store.boxes_of(objects), image, slots, self._voxels.owner, T_camera_world,
            self.config.depth_noise_per_m,
        )  # fmt: skip
        self._map.confirm_seen([entry for entry, view in zip(objects, visibilities, strict=True) if view.seen])
        matched = [(found.objects[j].survivor.number, i, j) for i, j in enumerate(found.match.tolist()) if j >= 0]
        iou = {number: float(found.iou[i, j]) for number, i, j in matched}
        rect = {number: frame_segments.segments[i].rect_xyxy for number, i, _ in matched}
        sightings = []
        for entry, view in zip(objects, visibilities, strict=True):
            if not view.seen:
                continue
            first = entry.frames_seen == 0
            entry.frames_seen += 1
            entry.last_frame = frame
            if entry.confirmed:
                own = None if first else iou.get(entry.number)
                rect_xyxy = blended_rectangle(view.rect_xyxy, rect.get(entry.number))
                sightings.append(Sighting(entry.label, entry.box, own, view.visible, rect_xyxy))
        return tuple(sorted(sightings, key=lambda s: s.label))

    def _frame_boxes(
        self, frame_segments: FrameSegments, boxes: Sequence[Box], found: Association
    ) -> tuple[Proposal3D, ...]:
        """Return the boxes of this frame's segments, none larger than an object, with the labels of their objects."""
        place = np.where(found.match >= 0, found.match, found.part).tolist()
        now = [found.objects[j].survivor if j >= 0 else None for j in place]
        labels = [o.label if o is not None and o.confirmed else 0 for o in now]
        return tuple(
            [
                Proposal3D(label, box, segment.heat, segment.rect_xyxy)
                for label, box, segment in zip(labels, boxes, frame_segments.segments, strict=True)
                if not too_large(box, self.config)
            ]
        )

    @property
    def objects(self) -> ObjectTable:
        """The confirmed objects of the map, by label: a list, and a table for notebooks and pandas."""
        used = [plane for plane in self._planes.planes if plane.in_use]
        place = {plane.identity: k for k, plane in enumerate(used)}
        return ObjectTable(self._tracked(entry, place) for entry in self._map.store.confirmed())

    def _tracked(self, entry: MapObject, place: Mapping[int, int]) -> TrackedObject:
        plane = self._planes.find(entry.plane)
        return TrackedObject(
            label=entry.label,
            box=entry.box,
            score=entry.score,
            heat=entry.heat,
            first_frame=entry.first_frame,
            last_frame=entry.last_frame,
            frames_seen=entry.frames_seen,
            points=len(self._voxels.rows_of(entry.number)),
            mean_color=entry.mean_color,
            plane=None if plane is None else place[plane.identity],
            merged_labels=tuple(entry.merged_labels),
        )

    @property
    def planes(self) -> list[SupportPlane]:
        """The supporting planes in use."""
        return [
            SupportPlane(*self._planes.in_world(plane), self._planes.outline_in_world(plane))
            for plane in self._planes.planes
            if plane.in_use
        ]

    @property
    def plane_identities(self) -> list[int]:
        """What `MapObject.plane` calls each of `planes`."""
        return [plane.identity for plane in self._planes.planes if plane.in_use]

    @property
    def up(self) -> Float64Array | None:
        """Up in the world, (3,); None while unknown."""
        return self._planes.up

    def ever_labelled(self) -> list[MapObject]:
        """Return all objects that have a label, retired ones too, by label."""
        return self._map.store.ever_labelled()

    def merge(self, one: MapObject, two: MapObject) -> MapObject:
        """Make one object of two that are one, as somebody says; return it, under the older label."""
        return self._map.merge(one, two)

    def retire(self, entry: MapObject) -> None:
        """End an object: it is none, as somebody says, or stands there no more. Its label is never given again."""
        self._map.store.retire(entry)

    def begin_visit(self) -> None:
        """Expect the place at another time: things may have been moved, taken and brought."""
        self._map.begin_visit()
        self._place = self._looked_from = None
        self._due = True

    def adopt(self, entry: MapObject, old: MapObject) -> None:
        """Let a labelled object be one that was retired: it was moved, and its older label stays."""
        self._map.store.adopt(entry, old)

    @property
    def support(self) -> PlaneTracker:
        """The supporting planes and their ground plans."""
        return self._planes

    def begin_labels(self, first: int) -> None:
        """Give no label below one."""
        self._map.store.begin_labels(first)

    @property
    def voxels(self) -> VoxelMap:
        """The global voxel map."""
        return self._voxels

    @property
    def points_known(self) -> int:
        """How many points the global point map holds."""
        return self._voxels.alive

    @property
    def map_bytes(self) -> int:
        """Memory of the global point map, room for more points included, bytes."""
        return self._voxels.nbytes

    def map_points(self) -> MapPoints:
        """Return the global point map; of small objects its fine points, where there are such."""
        rows = self._voxels.living()
        label_of = np.zeros(max((o.number for o in self._map.store.living()), default=0) + 1, np.int32)
        for entry in self._map.store.confirmed():
            label_of[entry.number] = entry.label
        xyz, of = self._voxels.spread(rows)
        owner = self._voxels.owner[rows[of]]
        label = label_of[np.where(owner < len(label_of), owner, 0)]
        fine, whole = self._voxels.fine_replacements(xyz, label > 0)
        kept = np.ones(len(xyz), bool)
        kept[whole] = False
        every = np.concatenate([rows[of][kept], fine])
        return MapPoints(
            xyz=np.concatenate([xyz[kept], self._voxels.xyz(fine)]),
            rgb=self._voxels.rgb(every),
            heat=self._voxels.heat(every),
            label=np.concatenate([label[kept], label[whole]]),
        )


def _median_depth_m(depth_m: Float32Array) -> float:
    """Return the median of readings, one in sixteen: 0 where there is none."""
    some = depth_m[::4, ::4]
    known = some[some > 0]
    return quantile(known, 0.5) if len(known) else 0.0


def _main_support(supports: Mapping[int, int], rests: Mapping[int, Resting]) -> Resting | None:
    """Return the plane of `rests` that is beneath most pixels, of equals the older; None where there is none."""
    known = [identity for identity in supports if identity in rests]
    return rests[min(known, key=lambda k: (-supports[k], k))] if known else None
