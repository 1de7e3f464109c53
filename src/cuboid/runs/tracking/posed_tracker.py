"""The tracker of posed frames: from a frame to its sightings, one call per stage."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.depth import excess_noise, resolves_m
from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.kernels.pixels import PlanesInView, assign_planes
from cuboid.ground.core.limits import MAX_PROPOSALS, MEMORY_MB, SAMPLE_POINTS
from cuboid.ground.core.observation import Observation, weight_of
from cuboid.ground.core.results import FrameResult, Proposal3D, Sighting
from cuboid.ground.core.state import Record
from cuboid.ground.core.tolerances import BIAS_M, DETECT_EVERY, DRIFT_M, DRIFT_RAD, OUTLIER_FRACTION
from cuboid.ground.core.working import WorkingImage
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.se3 import inverse, moved_beyond
from cuboid.method.boxes.fit import Resting, fit_boxes
from cuboid.method.boxes.hidden import with_hidden_foot
from cuboid.method.boxes.quantiles import quantile
from cuboid.method.boxes.top_edges import Picture
from cuboid.method.detection.types import Detector
from cuboid.method.heatmap.anchors import LAST_KEYFRAME
from cuboid.method.heatmap.pixel_heat import pixel_heat, weigh
from cuboid.method.heatmap.voxel_map import PixelVoxels, VoxelMap, VoxelMapState
from cuboid.method.objects.association import Association, SegmentedFrame, prior_of
from cuboid.method.objects.by_regions import ByRegions, region_views
from cuboid.method.objects.entry import MapObject, ObjectWithoutDepth
from cuboid.method.objects.following import Following
from cuboid.method.objects.object_map import ObjectMap, ObjectMapState
from cuboid.method.objects.support import seen_part
from cuboid.method.objects.validity import fits_object, too_large
from cuboid.method.objects.visibility import Visibility, measure_visibility, sightings_of
from cuboid.method.proposals import make_source
from cuboid.method.proposals.region_maps import ReducedFrame
from cuboid.method.proposals.regions import RegionSource
from cuboid.method.proposals.segment_scores import MIN_SCORED_WIDTH_PX, segment_log_odds
from cuboid.method.proposals.types import Proposals, ProposalSource
from cuboid.method.surfaces.cells import find_cells, patch_pixels, with_level_patches
from cuboid.method.surfaces.frame_segments import (
    FrameSegment,
    FrameSegments,
    PixelPlanes,
    points_of,
    segment_frame,
)
from cuboid.method.surfaces.grid import CELL_M
from cuboid.method.surfaces.kernels.outlines import BOTTOM, LEFT, RIGHT, TOP
from cuboid.method.surfaces.planes import PlaneTracker, PlaneTrackerState
from cuboid.method.surfaces.standing import find_flat_areas
from cuboid.runs.tracking.camera_memory import CameraMemory
from cuboid.runs.tracking.detecting import same_fields
from cuboid.runs.tracking.measuring import FrameClock
from cuboid.runs.tracking.preparing import PreparedImages, Preparer
from cuboid.runs.tracking.rolling import Roll, farther_up
from cuboid.runs.tracking.tracked_map import TrackedMap

# Poses in the map are rounded to this many decimals, metres: this removes rounding errors that depend on the world.
POSE_DECIMALS = 9
# The segments of a frame are scored if the weight of the frames since the last scores is at least this: half a view.
SCORED_WEIGHT = 0.5
# The next look for what only regions show is due when the weight of the frames since the last one is this: two views. A
# look takes as long as two or three frames.
LOOK_WEIGHT = 2.0
# While up is unknown, two cameras look the same way if the angle between their optical axes is less than this, radians:
# the cameras of a moving pair that overlap, and no two cameras 90 degrees apart around a table that look down by up to
# 60 degrees.
SAME_VIEW_RAD = math.radians(41.0)


@dataclass(frozen=True, slots=True)
class PosedTrackerState(Record):
    """State of a `PosedTracker`: everything it needs to continue, except for the rows of the voxel map.

    Attributes
    ----------
    config : TrackerConfig
        The configuration in use.
    turns : int or None
        Number of quarter turns by which images are rolled; None before the first frame with depth.
    T_world_map : (4, 4) float64 or None
        Pose of the map in the world; None before the first frame.
    count : int
        Number of frames so far.
    position : (3,) float64 or None
        Position of the camera in the last frame.
    viewpoint : (4, 4) float64 or None
        T_world_camera of the last frame from a new viewpoint.
    due : bool
        Whether the next frame refreshes the map.
    planes : PlaneTrackerState
    voxels : VoxelMapState
    map : ObjectMapState
    unread : tuple of ObjectWithoutDepth
        Objects without depth readings, found by a detector.
    furniture_labels : dict of int to tuple of int
        Labels of the furniture that bears a plane, by identity of the plane, oldest first.
    time_s : float or None
        Time of the last frame; None before the first.
    unscored : float
        Weight of the frames since the last one whose segments were scored.
    unlooked : float
        Weight of the frames since the last look for what only regions show.
    """

    config: TrackerConfig
    turns: int | None
    T_world_map: Float64Array | None
    count: int
    position: Float64Array | None
    viewpoint: Float64Array | None
    due: bool
    planes: PlaneTrackerState
    voxels: VoxelMapState
    map: ObjectMapState
    unread: tuple[ObjectWithoutDepth, ...] = ()
    furniture_labels: dict[int, tuple[int, ...]] = dataclasses.field(default_factory=dict)
    time_s: float | None = None
    unscored: float = 0.0
    unlooked: float = 0.0


class PosedTracker(TrackedMap):
    """Finds the objects of a static scene in a stream of posed RGB-D frames, and keeps their labels.

    The map is stored in the frame of the first camera, rotated like the images: voxels, ground plans and the order of
    sums do not depend on the world of the poses. Poses multiplied by a rigid transform therefore give the same labels
    and boxes, and poses far from their origin lose no accuracy. All results are in the world; `support`, `voxels` and
    the entries of `ever_labelled` are in the frame of the map.

    Parameters
    ----------
    intrinsics : Intrinsics
        Intrinsics of every frame that does not come with a camera of a rig.
    config : TrackerConfig, optional
    proposals : str or ProposalSource, optional
        Name of a 2D proposal source, or any callable from (frame, intrinsics) to `Proposals`.
    memory_mb : float
        Memory limit of the process, in units of 2**20 bytes, above which parts of the map out of view are evicted; they
        are loaded again when accessed.

    Raises
    ------
    InputError
        If no proposal source has that name.
    """

    NOT_SAVED = frozenset(
        {
            *("intrinsics", "_memory_mb", "_propose", "_preparer", "_world_boxes", "_sure", "_nominal"),
            # A detector must be set again; objects without depth readings are saved in the field `unread`.
            "_detecting",
            # Moving objects are followed only within a recording.
            "_following",
            # Of the memories of cameras, only that of a single camera is saved.
            *("_cameras", "_camera"),
        }
    )

    def __init__(
        self,
        intrinsics: Intrinsics,
        config: TrackerConfig | None = None,
        proposals: str | ProposalSource | None = None,
        *,
        memory_mb: float = MEMORY_MB,
    ) -> None:
        # Before the first frame of a camera, its depth noise is that of this configuration.
        self._nominal = config or TrackerConfig()
        # Memories of the cameras by name, and that of the present frame; without a rig there is one, without a name.
        self._camera = CameraMemory(intrinsics, self._nominal)
        self._cameras = {"": self._camera}
        super().__init__(intrinsics, self._nominal, memory_mb)
        self._propose = make_source(proposals, self.config)
        self._preparer = Preparer(intrinsics, self.config, self._propose)
        # Number of frames of all cameras.
        self._count = 0

    def use_detector(self, detector: str | Detector | None, every: int = DETECT_EVERY) -> None:
        """Use a detector on each n-th frame; objects get names, and objects without depth readings get labels.

        Parameters
        ----------
        detector : str or Detector or None
            As for `make_detector`.
        every : int

        Raises
        ------
        InputError
            If no detector has that name, or the model cannot be used.
        MissingExtraError
            If a required package is not installed.
        """
        self._detecting.use(detector, every)

    @property
    def vocabulary(self) -> tuple[str, ...]:
        """Classes of the detector, after it has processed a frame."""
        return self._detecting.vocabulary

    @property
    def gone_names(self) -> dict[int, str]:
        """Names from the detector of objects that left, by label."""
        found = ((entry.label, same_fields(entry)["name"]) for entry in self._following.gone)
        return {label: name for label, name in found if name}

    def _begin(self) -> None:
        super()._begin()
        self._begin_motion()

    def _begin_motion(self) -> None:
        """Reset the detection and tracking of motion."""
        for camera in self._cameras.values():
            camera.begin_motion()
        self._following = Following(self.config, self._map.store, self._voxels, self._planes)

    def state(self) -> PosedTrackerState:
        """Return the current state; see `ObjectStore.state`."""
        camera = self._cameras[""]
        return PosedTrackerState(
            config=self.config,
            turns=camera.turns,
            T_world_map=self._T_world_map,
            count=self._count,
            position=camera.position,
            viewpoint=camera.viewpoint,
            due=camera.due,
            planes=self._planes.state(),
            voxels=self._voxels.state(),
            map=self._map.state(),
            unread=self._map.store.state_without_depth(),
            furniture_labels=dict(self._furniture_labels),
            time_s=camera.time_s,
            unscored=camera.unscored,
            unlooked=camera.unlooked,
        )

    @classmethod
    def from_state(
        cls,
        state: PosedTrackerState,
        intrinsics: Intrinsics,
        proposals: str | ProposalSource | None = None,
        *,
        memory_mb: float = MEMORY_MB,
    ) -> PosedTracker:
        """Return a tracker that continues from a state; the rows of its voxel map must be restored separately."""
        tracker, c = cls(intrinsics, state.config, proposals, memory_mb=memory_mb), state.config
        tracker._planes = PlaneTracker.from_state(state.planes, c)
        tracker._voxels = VoxelMap.from_state(state.voxels, c.voxel_m, c.depth_noise_per_m, c.max_depth_m, memory_mb)
        tracker._map = ObjectMap.from_state(state.map, c, tracker._voxels, tracker._planes)
        tracker._begin_motion()
        tracker._detecting.begin(tracker._map.store, c)
        tracker._map.store.restore_without_depth(state.unread)
        tracker._furniture_labels = dict(state.furniture_labels)
        tracker._T_world_map, tracker._count = state.T_world_map, state.count
        camera = tracker._cameras[""]
        camera.turns, camera.count, camera.due = state.turns, state.count, state.due
        camera.position, camera.viewpoint, camera.time_s = state.position, state.viewpoint, state.time_s
        camera.unscored, camera.unlooked = state.unscored, state.unlooked
        return tracker

    def prepare(self, frame: Frame) -> PreparedImages:
        """Do the part of a frame's work that needs no map; a thread may do this for the next frames, in their order."""
        return self._preparer.ahead(frame)

    def update(self, frame: Frame, anchor: int = 0, prepared: PreparedImages | None = None) -> FrameResult:
        """Process a frame; an exact repetition of the last one, with the same pose, changes nothing.

        Parameters
        ----------
        frame : Frame
            Its images must not change later: the next frame of its camera is compared with them.
        anchor : int
            Keyframe to which the frame's pose is anchored, if poses are estimated; see `apply_correction`. Numbers
            beyond `LAST_KEYFRAME`, after hours of video, are not distinguished.
        prepared : PreparedImages, optional
            What `prepare` returned for this frame; the result does not depend on it.

        Raises
        ------
        FrameError
            If the frame has no pose, a pose beyond the reach of the map, or another size than the intrinsics.
        """
        camera = self._camera = self._memory_of(frame)
        T_world_camera = self._checked_pose(frame)
        if camera.last is not None and frame.repeats(camera.last[0]):
            camera.last = frame, self._repeat(frame, camera.last[1])
            return camera.last[1]
        if camera.turns is None:
            camera.turns = self._turns_of(frame, T_world_camera)
        roll = self._roll
        if self._T_world_map is None:
            self._T_world_map = roll.pose(T_world_camera)
        T_map_camera = np.round(inverse(self._T_world_map) @ T_world_camera, POSE_DECIMALS)
        self._check_reach(frame.index, T_map_camera)
        result = roll.result(self._update(frame, frame.at(T_map_camera), anchor, prepared))
        result = dataclasses.replace(
            result,
            T_world_camera=T_world_camera,
            sightings=tuple(
                [dataclasses.replace(item, box=self._box_in_world(item.label, item.box)) for item in result.sightings]
            ),
            proposals=tuple([dataclasses.replace(item, box=self.in_world(item.box)) for item in result.proposals]),
            events=tuple([event.moved(self.T_world_map) for event in result.events]),
            agents=tuple([self.in_world(box) for box in result.agents]),
        )
        camera.last = frame, result
        return result

    def _memory_of(self, frame: Frame) -> CameraMemory:
        """Return the memory of the camera of a frame."""
        name = frame.camera_name
        if name not in self._cameras:
            self._cameras[name] = CameraMemory(frame.intrinsics_or(self.intrinsics), self._nominal)
        return self._cameras[name]

    def _turns_of(self, frame: Frame, T_world_camera: Float64Array) -> int | None:
        """Return the quarter turns of a camera: those for which up in its images is up in the map.

        Before up is known: as another camera that looks its way has them, else by its depth. Such cameras have one idea
        of up: two guesses that contradict each other would mislead the search for up.
        """
        up = self.up
        for other in self._cameras.values():
            if up is not None or other.turns is None or other.last is None:
                continue
            T_world_other = other.last[1].T_world_camera
            if T_world_other[:3, 2] @ T_world_camera[:3, 2] >= math.cos(SAME_VIEW_RAD):
                up = Roll(other.intrinsics, other.turns).image_up(T_world_other)
        if up is None:
            return farther_up(frame.depth_m)
        rolls = (Roll(self._camera.intrinsics, turns) for turns in range(4))
        return int(np.argmax([roll.image_up(T_world_camera) @ up for roll in rolls]))

    def _repeat(self, frame: Frame, last: FrameResult) -> FrameResult:
        """Return the result of the last frame for an exact repetition of it: it shows the same objects again."""
        self._map.store.record_seen(self._map.store.seen_in(last.index), frame.index)
        return dataclasses.replace(
            last, index=frame.index, timestamp_s=frame.timestamp_s, milliseconds={}, left_out={}, events=()
        )

    @property
    def _roll(self) -> Roll:
        return Roll(self._camera.intrinsics, self._camera.turns or 0)

    def _update(self, given: Frame, in_map: Frame, anchor: int, prepared: PreparedImages | None) -> FrameResult:
        """Process a frame, rotated by `_roll`; `in_map` is the same frame with its pose in the map. See `update`."""
        clock, time_s = FrameClock(), given.timestamp_s
        images = self._preparer.fitted(prepared, given, self._roll, self._camera.count)
        frame = self._roll.placed(images.turned, in_map)
        seen = self._observe(frame, images, anchor if anchor <= LAST_KEYFRAME else 0)
        proposed = self._proposals(given) if images.proposals is None else images.proposals
        proposals = proposed.best(MAX_PROPOSALS)
        clock.lap("proposals")
        seen = self._find_motion(seen, time_s)
        clock.lap("motion")
        planes = self._find_planes(seen)
        clock.lap("planes")
        candidate = self._candidates(seen, planes)
        weighed = weigh(seen.solid, candidate, proposals, self._camera.config)
        heat = pixel_heat(seen.solid, weighed)
        clock.lap("heat")
        # The map is refreshed one frame later: a frame from a new viewpoint already updates planes and boxes.
        due, self._camera.due = self._camera.due, seen.new_viewpoint
        slots = self._fuse(seen, heat, due)
        voxels = self._voxels.look_up(slots)
        clock.lap("fuse")
        in_frustum = self._map.objects_in_frustum(seen.image, seen.T_camera_world)
        objects = self._map.prune_candidates(in_frustum)
        prior = prior_of(objects, voxels.owner, weighed)
        segments = segment_frame(
            seen, planes, heat, weighed, prior, self._sides(seen.T_world_camera), self._camera.config
        )
        reduced = ReducedFrame(frame, self._roll.camera)
        segments = self._scored(segments, reduced, seen, proposals)
        boxes = self._boxes(segments.segments, voxels, seen)
        clock.lap("boxes")
        left_out = {
            "proposals": len(proposed) - len(proposals),
            "clusters": segments.left_out,
            "candidates": len(in_frustum) - len(objects),
        }
        segmented = SegmentedFrame(segments, boxes, voxels, candidate)
        noise_per_m = self._camera.config.depth_noise_per_m
        picture = Picture(frame.color, frame.depth_m, self._roll.camera, seen.T_camera_world, noise_per_m)
        found = self._map.update(seen, segmented, objects, picture)
        in_frustum = self._map.objects_in_frustum(seen.image, seen.T_camera_world)
        if due:
            self._refine(seen, heat, slots, in_frustum)
        clock.lap("map")
        self._following.note_touched(found.numbers_of(segments.touched), time_s)
        visible = self._visible(seen, slots, in_frustum, time_s)
        sightings = self._following.sightings(
            sightings_of(visible, segments, found, self.config.min_probability), seen, slots
        )
        frame_boxes = self._frame_boxes(segmented, found)
        clock.lap("matching")
        sightings = self._detect(given, visible, seen, sightings, clock)
        sightings = self._by_regions(reduced, proposals, seen, slots, visible, sightings)
        clock.lap("regions")
        self._count += 1
        self._camera.count += 1
        return FrameResult(
            index=frame.index,
            timestamp_s=time_s,
            T_world_camera=seen.T_world_camera,
            sightings=sightings,
            proposals=frame_boxes,
            objects_known=len(self._reported()) + self._detecting.labelled,
            heat=heat,
            milliseconds=clock.milliseconds,
            left_out=left_out,
            size=(self._roll.camera.width, self._roll.camera.height),
            events=tuple(self._following.take_events()),
            agents=tuple(self._following.agents),
            camera=frame.camera_name,
        )

    def _scored(
        self, segments: FrameSegments, reduced: ReducedFrame, seen: Observation, proposals: Proposals
    ) -> FrameSegments:
        """Return the segments of a frame with their fitted scores, if the frames since the last scores add enough."""
        camera = self._camera
        camera.unscored += seen.weight
        if camera.unscored < SCORED_WEIGHT or not segments.segments:
            return segments
        weight, camera.unscored = min(camera.unscored, 1.0), 0.0
        count = len(segments.segments)
        whole = segment_log_odds(reduced, seen.image, segments.claim, count, proposals)
        return dataclasses.replace(segments, whole=whole, whole_weight=weight)

    def _by_regions(
        self,
        reduced: ReducedFrame,
        proposals: Proposals,
        seen: Observation,
        slots: npt.NDArray[np.int32],
        visible: Sequence[tuple[MapObject, Visibility]],
        sightings: tuple[Sighting, ...],
    ) -> tuple[Sighting, ...]:
        """Return the sightings with those of objects that only regions show; look for these if it is time."""
        camera, c = self._camera, self.config
        camera.unlooked += seen.weight
        wide_enough = max(self._roll.camera.width, self._roll.camera.height) >= MIN_SCORED_WIDTH_PX
        due = wide_enough and (camera.unlooked >= LOOK_WEIGHT or camera.count == 0)
        if c.region_probability >= 1.0 or not (due or self._map.store.by_regions()):
            return sightings
        by_regions = ByRegions(self._map.store, c, self._planes, self._support_planes())
        if due:
            camera.unlooked = 0.0
            shown = [(o, view) for o, view in visible if o.confirmed and o.score >= c.min_probability]
            found = RegionSource(camera.config).choose(reduced, proposals)
            owner = self._voxels.look_up(slots).owner
            regions = region_views(found, owner, seen, [o.number for o, _ in shown], self._planes.likely_up)
            by_regions.update(regions, shown, seen)
        return by_regions.sightings(sightings, seen)

    def _fuse(self, seen: Observation, heat: Float32Array, due: bool) -> npt.NDArray[np.int32]:
        """Fuse a frame into the map and carve free space; return the row (h, w) of the map of each working pixel."""
        # On a later visit any frame may show a change: nothing is deferred.
        refresh_map = due or self._voxels.stored.revisited or seen.moving is not None
        slots = self._voxels.fuse(seen.still, heat, seen.T_world_camera, seen.frame, seen.keyframe, refresh_map)
        self._voxels.carve_free_space(seen.image, seen.T_camera_world, refresh_map, seen.camera)
        self._following.claim(slots, seen)
        return slots

    def _detect(
        self,
        given: Frame,
        visible: Sequence[tuple[MapObject, Visibility]],
        seen: Observation,
        sightings: tuple[Sighting, ...],
        clock: FrameClock,
    ) -> tuple[Sighting, ...]:
        """Run the detector, if it is due; return the sightings with those of objects without depth readings."""
        if self._detecting.is_due(self._camera.count):
            self._detecting.detect(given, self._roll, visible, seen)
            clock.lap("detector")
        if self._detecting.is_used:
            sightings = self._detecting.sightings(sightings, seen, self._support_planes(), self.config.min_probability)
            clock.lap("without depth")
        return sightings

    def _observe(self, frame: Frame, images: PreparedImages, keyframe: int) -> Observation:
        """Return a frame as all stages see it; the first frame of a camera also gives the noise of its sensor."""
        T_world_camera, image = frame.T_world_camera, images.image
        assert T_world_camera is not None
        if self._camera.count == 0:
            self._estimate_noise(image)
        new_viewpoint, viewpoint = self._is_new_viewpoint(T_world_camera), self._camera.viewpoint
        assert viewpoint is not None
        return Observation(
            frame=frame.index,
            image=image,
            solid=images.solid,
            T_world_camera=T_world_camera,
            up_camera=frame.up_camera,
            keyframe=keyframe,
            new_viewpoint=new_viewpoint,
            weight=self._weight(image, T_world_camera, frame.timestamp_s),
            camera=frame.camera_name,
            fixed=not new_viewpoint and np.array_equal(T_world_camera, viewpoint),
        )

    def _find_motion(self, seen: Observation, time_s: float) -> Observation:
        """Return a frame with its moving readings marked; moving objects are followed."""
        moving = self._camera.motion.find(seen.image, seen.T_world_camera, time_s)
        if moving is not None:
            seen = dataclasses.replace(seen, moving=moving)
        return self._following.begin_frame(seen, time_s)

    def apply_correction(self, moved: Mapping[int, Float64Array]) -> None:
        """Move the map, its planes and its objects after a pose correction (loop closure, relocalisation).

        Everything moves with the keyframe from which it was last seen; objects that meet are merged under the older
        label. Planes and objects move at once. Points move lazily, when their region is next accessed: the cost of a
        correction depends on the number of keyframes, planes and objects, not on the number of points.

        Parameters
        ----------
        moved : mapping of int to (4, 4) float64
            T_new_old in the world for each keyframe that moved.
        """
        T = self.T_world_map
        in_map = {keyframe: inverse(T) @ T_new_old @ T for keyframe, T_new_old in moved.items()}
        self._planes.apply_correction(in_map)
        self._map.apply_correction(in_map)
        self._detecting.apply_correction(in_map)
        self._begin_motion()
        for camera in self._cameras.values():
            camera.last = None

    def _estimate_noise(self, image: WorkingImage) -> None:
        """Estimate from the first frame of a camera how much its noise exceeds the configured noise.

        Stages that compare with the map use the noise of the noisiest camera of a rig.
        """
        nominal = self._nominal.depth_noise_per_m
        excess = excess_noise(image.depth, nominal, self.config.max_depth_m)
        self._camera.set_noise(max(excess, 1.0) * nominal)
        if self._camera.config.depth_noise_per_m <= self.config.depth_noise_per_m:
            return
        self.config = self._camera.config
        if self._count == 0:
            self._begin()
        else:
            self._voxels.noise_per_m = self.config.depth_noise_per_m
            self._following.raise_noise(self.config)

    def _checked_pose(self, frame: Frame) -> Float64Array:
        """Return the pose of a frame; raises FrameError if it has no pose, or another size."""
        expected = (self._camera.intrinsics.height, self._camera.intrinsics.width)
        if frame.depth_m.shape != expected:
            raise FrameError(
                f"frame {frame.index} is {frame.depth_m.shape[1]} x {frame.depth_m.shape[0]} pixels, "
                f"expected {expected[1]} x {expected[0]}"
            )
        if frame.T_world_camera is None:
            raise FrameError(f"frame {frame.index} has no camera pose")
        return frame.T_world_camera

    def _check_reach(self, index: int, T_map_camera: Float64Array) -> None:
        far_m, reach_m = np.abs(T_map_camera[:3, 3]).max(), self._voxels.fine.reach_m
        if far_m + self.config.max_depth_m >= reach_m:
            raise FrameError(f"frame {index} is {far_m:.0f} m from the first one, the map reaches {reach_m:.0f} m")

    def _proposals(self, given: Frame) -> Proposals:
        """Return the proposals of a source that gets the unrotated frame: any but the depth segmentation."""
        c = self._camera.intrinsics
        proposals = self._propose(given, c)
        if len(proposals) and (proposals.boxes_xyxy[:, 2:] > (c.width, c.height)).any():
            raise ValueError(f"proposals of frame {given.index} lie outside its {c.width} x {c.height} pixels")
        return self._roll.proposals(proposals)

    def _find_planes(self, seen: Observation) -> PixelPlanes:
        """Track the supporting planes; return the planes on and beneath which pixels lie."""
        c, planes, image, T_world_camera = self._camera.config, self._planes, seen.still, seen.T_world_camera
        source = image.depth, T_world_camera, c.depth_noise_per_m, c.max_depth_m
        if planes.vote_is_due(seen.weight):
            areas = find_flat_areas(image.depth, c)
            if planes.vote_up(areas, T_world_camera, seen.up_camera):
                self._map.reset_supports()
        patch = patch_pixels(image.camera)
        patches = np.full([n // patch for n in image.depth_m.shape], -1, np.int32)
        renew = seen.new_viewpoint or not planes.well_known(seen.camera)
        if renew:
            cells = find_cells(*source)
            if planes.up is not None:
                cells = with_level_patches(cells, planes.up, *source)
            patches = planes.update(self._count, cells, seen.keyframe, seen.camera)
        if planes.T_plan_world is None or not planes.planes:
            return PixelPlanes.none(image.depth_m.shape)
        k, on_plane, support = image.camera, *(np.empty(image.depth_m.shape, np.int32) for _ in range(2))
        view = planes.planes_in_frustum(k, min(c.max_depth_m, float(image.depth_m.max())), T_world_camera)
        in_camera = planes.in_camera(view, T_world_camera, seen.camera)
        in_view = PlanesInView(in_camera, view.numbers, view.ground, view.origin, CELL_M, patches, patch)
        T_plan_camera = planes.T_plan_world @ T_world_camera
        limits = c.depth_noise_per_m, c.min_height_m, BIAS_M, c.max_depth_m
        assign_planes(seen.solid.depth_m, k.pinhole, T_plan_camera, in_view, *limits, on_plane, support, view.seen)
        if renew:
            planes.add_readings(view, seen.keyframe)
        return PixelPlanes(on_plane, support, view.identities)

    def _candidates(self, seen: Observation, planes: PixelPlanes) -> UInt8Array:
        """Return which readings may belong to an object: within range, on no supporting plane, not moving."""
        depth_m = seen.solid.depth_m
        found = (depth_m > 0) & (depth_m <= self.config.max_depth_m) & (planes.on_plane < 0)
        if seen.moving is not None:
            found &= seen.moving == 0
        return np.asarray(found, dtype=np.uint8)

    def _sides(self, T_world_camera: Float64Array) -> npt.NDArray[np.int64]:
        """Return the side of a segment for neighbours below, above, right and left in the image, for any up."""
        up = T_world_camera[:3, :3].T @ self._planes.likely_up
        if abs(up[0]) <= abs(up[1]):
            return np.array([TOP, BOTTOM, LEFT, RIGHT] if up[1] > 0 else [BOTTOM, TOP, RIGHT, LEFT])
        return np.array([LEFT, RIGHT, TOP, BOTTOM] if up[0] > 0 else [RIGHT, LEFT, BOTTOM, TOP])

    def _is_new_viewpoint(self, T_world_camera: Float64Array) -> bool:
        """Return whether the camera has moved by more than the pose error since the last new viewpoint.

        Within the pose error the map cannot distinguish the two viewpoints: planes, boxes and free space need no
        update.
        """
        last = self._camera.viewpoint
        if last is not None and not moved_beyond(last, T_world_camera, DRIFT_M, DRIFT_RAD):
            return False
        self._camera.viewpoint = T_world_camera
        return True

    def _weight(self, image: WorkingImage, T_world_camera: Float64Array, time_s: float) -> float:
        """Return the weight of a frame as evidence; the first one has full weight."""
        camera = self._camera
        last, camera.position = camera.position, T_world_camera[:3, 3]
        last_s, camera.time_s = camera.time_s, time_s
        distance_m = 0.0 if last is None else _median_depth_m(image.depth_m)
        if last is None or last_s is None or distance_m == 0.0:
            return 1.0
        return weight_of(time_s - last_s, math.dist(camera.position, last) / distance_m)

    def _boxes(self, segments: Sequence[FrameSegment], voxels: PixelVoxels, seen: Observation) -> list[Box]:
        """Return the boxes of a frame's segments, from a sample of their points, each on the surface beneath.

        Parameters
        ----------
        segments : sequence of FrameSegment
        voxels : PixelVoxels
            The voxels of the frame's pixels.
        seen : Observation
        """
        if not segments:
            return []
        sampled = [s.pixels[:: 1 + len(s.pixels) // (SAMPLE_POINTS // 2)] for s in segments]
        points = points_of(np.concatenate(sampled), seen.image, seen.T_world_camera)
        found = {identity: self._planes.find(identity) for s in segments for identity in s.supports}
        rests = {identity: self._planes.in_world(plane) for identity, plane in found.items() if plane is not None}
        unknown = self._planes.likely_up, None
        planes = [_main_support(s.supports, rests) or unknown for s in segments]
        boxes = fit_boxes(points, [len(pixels) for pixels in sampled], planes, OUTLIER_FRACTION)
        for k, (normal, offset) in enumerate(planes):
            # Masks match the other segments; a foot decides only whether a thin box has the size of an object.
            if offset is not None and not fits_object(boxes[k], self.config):
                owner = _most_frequent(voxels.owner.ravel()[sampled[k]])
                boxes[k] = self._with_hidden_foot(boxes[k], normal, offset, owner)
        return boxes

    def _with_hidden_foot(self, box: Box, normal: Float64Array, offset: float, owner: int) -> Box:
        """Return the box of a segment extended down to the surface below; `owner` is the number of its own object."""
        foot_m = box.foot_m(normal, offset)
        whole = Box(box.center - 0.5 * foot_m * normal, box.size + np.array([0.0, 0.0, foot_m]), box.rotation)
        near = [o for o in self._map.store.near(whole, 0.0) if o.confirmed and o.number != owner]
        parts, max_height_m = [seen_part(o, normal) for o in near], self.config.max_size_m
        return with_hidden_foot(box, normal, offset, parts, self._voxels, max_height_m)

    def _refine(
        self, seen: Observation, heat: Float32Array, slots: npt.NDArray[np.int32], in_frustum: Sequence[MapObject]
    ) -> None:
        """Fuse small labelled objects at the fine resolution too, within the range in which the sensor resolves it."""
        voxels, step, fx = self._voxels, seen.image.step, seen.image.camera.fx
        small = [o.number for o in in_frustum if o.confirmed and max(o.box.size.tolist()) <= voxels.fine.small_m]
        if small:
            # The phases of subsampled frames compensate a step of two.
            far_m = resolves_m(voxels.fine.fine_m, self._camera.config.depth_noise_per_m, min(step, 2) * fx)
            numbers = np.zeros(max(small) + 1, bool)
            numbers[small] = True
            voxels.fine.refine(seen, heat, slots, numbers, far_m)

    def _visible(
        self, seen: Observation, slots: npt.NDArray[np.int32], in_frustum: Sequence[MapObject], time_s: float
    ) -> list[tuple[MapObject, Visibility]]:
        """Record the objects of the map that the frame shows, and return them with their visibility."""
        objects = [o for o in in_frustum if len(o.points)]
        boxes, owner = self._map.store.boxes_of(objects), self._voxels.stored.owner
        visibilities = measure_visibility(objects, boxes, seen, slots, owner, self._camera.config.depth_noise_per_m)
        visible = [(entry, view) for entry, view in zip(objects, visibilities, strict=True) if view.seen]
        labelled = self._map.record_seen(
            seen.frame, [entry for entry, _ in visible], lambda entry: self._following.has_rested(entry, time_s)
        )
        self._following.note_labels(labelled, seen.frame, time_s)
        return visible

    def _frame_boxes(self, frame: SegmentedFrame, found: Association) -> tuple[Proposal3D, ...]:
        """Return the boxes of this frame's segments, except those too large for an object, with their labels."""
        survivors = [found.objects[j].survivor if j >= 0 else None for j in found.object_of.tolist()]
        minimum = self.config.min_probability
        labels = [o.label if o is not None and o.is_reported(minimum) else 0 for o in survivors]
        return tuple(
            [
                Proposal3D(label, box, segment.heat, segment.rect_xyxy)
                for label, box, segment in zip(labels, frame.boxes, frame.segments.segments, strict=True)
                if not too_large(box, self.config)
            ]
        )

    def begin_visit(self) -> None:
        """Begin a later visit to the place: objects may have been moved, taken away or added."""
        self._map.begin_visit()
        for camera in self._cameras.values():
            camera.begin_visit()
        self._begin_motion()


def _median_depth_m(depth_m: Float32Array) -> float:
    """Return the median of the readings in a subsample of one in sixteen, metres; 0 if there is none."""
    sampled = depth_m[::4, ::4]
    readings = sampled[sampled > 0]
    return quantile(readings, 0.5) if len(readings) else 0.0


def _most_frequent(numbers: npt.NDArray[np.int32]) -> int:
    """Return the most frequent of non-negative numbers (N,), the lowest one if equal."""
    return int(np.bincount(numbers).argmax())


def _main_support(supports: Mapping[int, int], rests: Mapping[int, Resting]) -> Resting | None:
    """Return the plane of `rests` beneath most pixels, the older one if equal; None if there is none."""
    candidates = [identity for identity in supports if identity in rests]
    return rests[min(candidates, key=lambda k: (-supports[k], k))] if candidates else None
