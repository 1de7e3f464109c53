"""Supporting planes: several parallel horizontal planes, found online, tracked and grown.

Up is the normal of the surfaces on which objects stand. If no inertial unit measures it, it is the normal of the flat
areas from which most objects are seen to rise; see `up`.

A frame updates only the planes whose windows it sees; the other planes cost nothing, however many there are.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.state import Record, snapshot
from cuboid.ground.core.tolerances import DRIFT_M, DRIFT_RAD, SIGMAS
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.se3 import inverse, level_rotation, transform
from cuboid.method.surfaces import seats
from cuboid.method.surfaces.cells import MIN_CELLS, Cells
from cuboid.method.surfaces.frustum_planes import FrustumPlanes, crop_planes, frustum
from cuboid.method.surfaces.plane import ON_PLANE_M, REACH_M, Plane
from cuboid.method.surfaces.plane_rules import is_lid, largest_level, merge_duplicates
from cuboid.method.surfaces.standing import SAME_COS, FlatAreas
from cuboid.method.surfaces.up import UpVote
from cuboid.method.surfaces.windows import Windows, window_of

# Well-known planes are updated once in this many frames.
REFRESH_FRAMES = 8
# A plane that is not in use is removed when it was not seen for more frames than this.
MAX_UNSEEN_FRAMES = 60
# The plan frame is rotated when the plane with most evidence is tilted in it by more than half the rotation error of
# poses.
LEVEL_COS = float(np.cos(DRIFT_RAD / 2.0))
# A level area supports objects after this many frames; at once if it is this many times the smallest plane, or if
# objects have nothing else to stand on.
FRAMES_IN_USE = 3
# A plane lies on top of a box if its distance from the top is at most REACH_M plus this fraction of the box's height.
ON_TOP_FRACTION = 0.1
# A plane extends beyond a box whose footprint is less than this fraction of the plane.
BEYOND_FRACTION = 0.5


@dataclass(frozen=True, slots=True)
class LevelCells:
    """The level flat cells of a frame.

    Attributes
    ----------
    frame, keyframe : int
        The frame that shows the cells, and the keyframe to which its pose is anchored.
    centers : (N, 3) float64
        In the plan frame, metres.
    area_m2, sigma_m : (N,) float64
        As in `Cells`.
    """

    frame: int
    keyframe: int
    centers: Float64Array
    area_m2: Float64Array
    sigma_m: Float64Array

    @property
    def weights(self) -> Float64Array:
        """Weight of each cell in the fit of a plane, (N,)."""
        return self.area_m2 / self.sigma_m**2


@dataclass(frozen=True, slots=True)
class PlaneTrackerState(Record):
    """State of a `PlaneTracker`; other records refer to planes by identity.

    Attributes
    ----------
    vote : UpVote
    next_identity : int
        Identity of the next plane.
    T_plan_world : (4, 4) float64 or None
        Pose of the world in the plan frame; None while up is unknown.
    planes : dict of int to Plane
        The planes, in the order of their indices.
    of : dict of int to int
        Identity of the plane for each identity ever given: the same one, or that of the plane that absorbed it.
        Identities of removed planes are left out.
    windows : Windows
    main : int or None
        Identity of the plane with the most evidence.
    last_update : int
        Number of the last frame whose cells were used.
    as_seen : dict of int to (4,) float64
        Normal and offset of the planes at that frame, in the plan frame, by identity.
    stale : tuple of int
        Planes with unprocessed readings.
    changed : tuple of int
        Planes that were processed since the last search for duplicates.
    """

    vote: UpVote
    next_identity: int
    T_plan_world: Float64Array | None
    planes: dict[int, Plane]
    of: dict[int, int]
    windows: Windows
    main: int | None
    last_update: int
    as_seen: dict[int, Float64Array]
    stale: tuple[int, ...]
    changed: tuple[int, ...]


class PlaneTracker:
    """Finds and tracks the supporting planes of a scene.

    Attributes
    ----------
    T_plan_world : (4, 4) float64 or None
        Transform from the world to the plan frame, whose third axis is up; None while up is unknown.
    planes : list of Plane
        In the plan frame, each at its `index`.
    """

    NOT_SAVED = frozenset({"_config"})

    def __init__(self, config: TrackerConfig) -> None:
        self._config = config
        self._vote = UpVote()
        self._next_identity = 0
        self.T_plan_world: Float64Array | None = None
        self._clear()

    def _clear(self) -> None:
        self.planes: list[Plane] = []
        # The planes by identity; a plane that absorbed others is found by their identities too.
        self._of: dict[int, Plane] = {}
        self._windows = Windows(MAX_UNSEEN_FRAMES)
        self._main: Plane | None = None
        # The last frame whose cells were used, and the planes as that frame saw them, by identity: normal and offset in
        # the plan frame.
        self._last_update = -1
        # By camera of the rig: its last processed frame decides.
        self._as_seen: dict[str, dict[int, Float64Array]] = {}
        # Planes with unprocessed readings, and planes processed since the last search for duplicates.
        self._stale: set[Plane] = set()
        self._changed: set[Plane] = set()

    def state(self) -> PlaneTrackerState:
        """Return the current state; later updates do not change it."""
        return PlaneTrackerState(
            vote=snapshot(self._vote),
            next_identity=self._next_identity,
            T_plan_world=self.T_plan_world,
            planes={plane.identity: snapshot(plane) for plane in self.planes},
            of={identity: plane.identity for identity, plane in self._of.items()},
            windows=snapshot(self._windows),
            main=None if self._main is None else self._main.identity,
            last_update=self._last_update,
            as_seen=dict(self._as_seen.get("", {})),
            stale=tuple(sorted(plane.identity for plane in self._stale)),
            changed=tuple(sorted(plane.identity for plane in self._changed)),
        )

    @classmethod
    def from_state(cls, state: PlaneTrackerState, config: TrackerConfig) -> PlaneTracker:
        """Return a plane tracker that continues from a state."""
        tracker, planes = cls(config), state.planes
        tracker._vote, tracker._next_identity = state.vote, state.next_identity
        tracker.T_plan_world = state.T_plan_world
        tracker.planes = list(planes.values())
        tracker._of = {identity: planes[absorber] for identity, absorber in state.of.items()}
        tracker._windows, tracker._last_update = state.windows, state.last_update
        tracker._as_seen = {"": state.as_seen}
        tracker._main = None if state.main is None else planes[state.main]
        tracker._stale = {planes[identity] for identity in state.stale}
        tracker._changed = {planes[identity] for identity in state.changed}
        return tracker

    def vote_is_due(self, weight: float) -> bool:
        """Add the weight of a frame and return whether it should vote for up."""
        return self._vote.is_due(weight)

    def vote_up(self, areas: FlatAreas, T_world_camera: Float64Array, up_camera: Float64Array | None = None) -> bool:
        """Update the vote for up with a frame's flat areas; if up changes, reset all planes and return True."""
        up = self._vote.update(areas, T_world_camera, up_camera)
        if up is None:
            self.T_plan_world = None
            self._clear()
        elif self.T_plan_world is None or self._vote.changed:
            self.T_plan_world = np.eye(4)
            self.T_plan_world[:3, :3] = level_rotation(up)
            self._clear()
            return True
        return self._vote.changed

    def update(self, frame: int, cells: Cells, keyframe: int = 0, camera: str = "") -> npt.NDArray[np.int32]:
        """Update the planes with the flat cells of a frame of a camera that is anchored to a keyframe.

        Returns
        -------
        (rows, columns) int32
            Index of the plane on which each patch lies, -1: none.
        """
        rows, columns = cells.image_shape
        owner = np.full(rows * columns, -1, np.int32)
        if self.T_plan_world is None:
            return owner.reshape(rows, columns)
        self._level()
        R = self.T_plan_world[:3, :3]
        flat = np.flatnonzero(cells.normal @ R[2] > SAME_COS)
        level = LevelCells(frame, keyframe, cells.center[flat] @ R.T, cells.area_m2[flat], cells.sigma_m[flat])
        matched = self._match(level)
        before = len(self.planes)
        self._refit(level, matched)
        self._discover(level, matched)
        removed = self._maintain(frame, level.centers)
        if removed or len(self.planes) > before:
            matched = self._match(level)
        owner[cells.places[flat]] = matched[:, None]
        self._last_update = frame
        self._as_seen[camera] = self._adapted(level, matched)
        return owner.reshape(rows, columns)

    def _adapted(self, cells: LevelCells, matched: npt.NDArray[np.int32]) -> dict[int, Float64Array]:
        """Return each plane adapted to the cells of the frame that show it, by identity; see `Plane.adapted`."""
        enough = np.flatnonzero(np.bincount(matched[matched >= 0]) >= MIN_CELLS).tolist()
        return {
            self.planes[k].identity: self.planes[k].adapted(cells.centers[matched == k], cells.sigma_m[matched == k])
            for k in enough
        }

    def well_known(self, camera: str = "") -> bool:
        """Whether the last processed frame of a camera shows planes, and all these planes are well known.

        Then further frames from the same viewpoint need no processing: until the camera has moved by the pose error,
        the planes keep their places, and newly visible parts of them are smaller than the rim that extends beyond the
        seen area, see `grid.RIM_M`.
        """
        seen = [self._of.get(identity) for identity in self._as_seen.get(camera, ())]
        return bool(seen) and all(plane is not None and plane.frames >= REFRESH_FRAMES for plane in seen)

    def in_camera(self, view: FrustumPlanes, T_world_camera: Float64Array, camera: str = "") -> Float64Array:
        """Return the planes in view as current frames of a camera see them, (K, 4): normal and offset in its frame.

        Because of pose drift, a table in the frame may be a centimetre off its plane in the map. Each plane is shifted
        and tilted to its cells in the last processed frame, as far as the priors of drift allow.
        """
        assert self.T_plan_world is not None
        T, planes = self.T_plan_world @ T_world_camera, np.empty((len(view.planes), 4))
        as_seen = self._as_seen.get(camera, {})
        for row, plane in zip(planes, view.planes, strict=True):
            adapted = as_seen.get(plane.identity)
            normal, offset = (plane.normal, plane.offset) if adapted is None else (adapted[:3], adapted[3])
            row[:3], row[3] = normal @ T[:3, :3], normal @ T[:3, 3] + offset
        return planes

    def planes_in_frustum(self, camera: Intrinsics, depth_m: float, T_world_camera: Float64Array) -> FrustumPlanes:
        """Return the planes that may be visible in a frame with readings up to a depth."""
        window = window_of(self.to_plan(transform(T_world_camera, frustum(camera, depth_m))))
        window += np.array([-1, -1, 1, 1])
        return crop_planes([self.planes[k] for k in self._windows.within(window)], window)

    def add_readings(self, view: FrustumPlanes, keyframe: int = 0) -> None:
        """Add a frame's readings on the planes in view to their ground plans; the frame is anchored to `keyframe`."""
        for plane, readings in zip(view.planes, view.seen, strict=True):
            plane.plan.add(readings, view.window[:2], keyframe)
            if plane.plan.stale:
                self._stale.add(plane)
                self._windows.update(plane)

    def apply_correction(self, moved: Mapping[int, Float64Array]) -> None:
        """Move the planes with the keyframes that saw them.

        Parameters
        ----------
        moved : mapping of int to (4, 4) float64
            T_new_old in the world for each keyframe that moved.
        """
        if self.T_plan_world is None:
            self._as_seen = {}
            return
        T = self.T_plan_world
        self._move({keyframe: T @ T_new_old @ inverse(T) for keyframe, T_new_old in moved.items()})

    def _move(self, in_plan: Mapping[int, Float64Array]) -> None:
        """Move the planes by T_new_old (4, 4) in the plan frame, for each keyframe."""
        self._as_seen = {}
        for plane in self.planes:
            if plane.apply_correction(in_plan):
                self._changed.add(plane)
                self._windows.update(plane)
                if plane.plan.stale:
                    self._stale.add(plane)

    def _level(self) -> None:
        """Rotate the plan frame so that the plane with most evidence is level in it."""
        main = self._main
        if self.T_plan_world is None or main is None or main.frames < REFRESH_FRAMES or main.normal[2] >= LEVEL_COS:
            return
        T_new_old = np.eye(4)
        first = np.cross([0.0, 1.0, 0.0], main.normal)
        first /= np.linalg.norm(first)
        T_new_old[:3, :3] = np.stack([first, np.cross(main.normal, first), main.normal])
        self._move({k: T_new_old for plane in self.planes for k in plane.keyframes.tolist()})
        self.T_plan_world = T_new_old @ self.T_plan_world

    def _match(self, cells: LevelCells) -> npt.NDArray[np.int32]:
        """Return the index of the plane on which each cell (N,) lies, -1: none."""
        centers, sigma_m = cells.centers, cells.sigma_m
        best = np.full(len(centers), np.inf)
        owner = np.full(len(centers), -1, np.int32)
        for k in self._windows.at(centers):
            plane = self.planes[k]
            off = np.abs(plane.height(centers))
            fits = (off < np.maximum(ON_PLANE_M, SIGMAS * sigma_m)) & (off < best)
            if not fits.any():
                continue
            fits[fits] = plane.plan.near(centers[fits])
            owner[fits], best[fits] = k, off[fits]
        return owner

    def _refit(self, cells: LevelCells, matched: npt.NDArray[np.int32]) -> None:
        """Refit the planes of which the frame shows enough cells."""
        for k in np.flatnonzero(np.bincount(matched[matched >= 0]) >= 3).tolist():
            plane, members = self.planes[k], matched == k
            plane.add(cells.centers[members], cells.weights[members], cells.keyframe)
            plane.fit()
            plane.frames += 1
            plane.last_frame = cells.frame

    def _discover(self, cells: LevelCells, matched: npt.NDArray[np.int32]) -> None:
        """Start planes from connected level areas that are large enough, largest first."""
        centers, area_m2 = cells.centers, cells.area_m2
        for _ in range(3):
            free = np.flatnonzero(matched < 0)
            if len(free) < MIN_CELLS:
                return
            members = largest_level(centers, area_m2, free, self._config.max_size_m)
            if len(members) < MIN_CELLS or area_m2[members].sum() < 0.5 * self._config.min_plane_area_m2:
                return
            plane = Plane(
                len(self.planes), self._next_identity, frames=1, first_frame=cells.frame, last_frame=cells.frame
            )
            self._of[plane.identity] = plane
            self._next_identity += 1
            plane.add(centers[members], cells.weights[members], cells.keyframe)
            plane.fit()
            plane.plan.begin(centers[members], area_m2[members], cells.keyframe)
            self.planes.append(plane)
            self._windows.update(plane)
            matched[members] = plane.index

    def _maintain(self, frame: int, centers: Float64Array) -> bool:
        """Activate planes in view, remove noise, merge duplicates; return True if any plane was removed."""
        min_area_m2 = self._config.min_plane_area_m2
        in_use = any(plane.in_use for plane in self.planes)
        near = {self.planes[k] for k in self._windows.at(centers)} | self._stale
        for plane in sorted(near, key=lambda p: p.index):
            # The ground plan is updated before objects are found on it; wide plans are updated in turn.
            if not plane.plan.wide or self._is_scheduled(frame, plane.index):
                plane.plan.refresh()
                self._stale.discard(plane)
            area_m2 = plane.plan.area_m2()
            if plane.in_use or area_m2 >= min_area_m2:
                if is_lid(plane, self._config.max_size_m**2, partial(self._at, plane.mean[None])):
                    plane.in_use = False
                elif not plane.in_use:
                    large = area_m2 >= FRAMES_IN_USE * min_area_m2
                    plane.in_use = large or plane.frames >= FRAMES_IN_USE or not in_use
                    in_use |= plane.in_use
            self._windows.update(plane)
        self._changed |= near
        gone = self._windows.expired(frame)
        if self._is_scheduled(frame, 0):
            merged, self._changed = merge_duplicates(self.planes, self._windows, self._changed)
            gone += merged
        self._remove(set(gone))
        main = self._windows.heaviest()
        self._main = None if main is None else self.planes[main]
        return bool(gone)

    def _is_scheduled(self, frame: int, index: int) -> bool:
        """Return whether a plane's turn, once in `REFRESH_FRAMES` frames, has come since the last processed frame."""
        return (frame - index) // REFRESH_FRAMES > (self._last_update - index) // REFRESH_FRAMES

    def _remove(self, gone: set[int]) -> None:
        if not gone:
            return
        keep = [plane.index for plane in self.planes if plane.index not in gone]
        for k in gone:
            self.planes[k].index = -1
        self.planes = [self.planes[k] for k in keep]
        for k, plane in enumerate(self.planes):
            plane.index = k
        self._windows.retain(keep)
        survivors = {identity: _survivor(plane) for identity, plane in self._of.items()}
        self._of = {identity: plane for identity, plane in survivors.items() if plane is not None}
        self._stale, self._changed = ({p for p in planes if p.index >= 0} for planes in (self._stale, self._changed))

    def find(self, identity: int | None) -> Plane | None:
        """Return the plane with an identity, or the plane that absorbed it; None if there is none in use."""
        plane = None if identity is None else _survivor(self._of.get(identity))
        return plane if plane is not None and plane.in_use else None

    @property
    def in_use(self) -> list[Plane]:
        """The planes on which objects may stand, by index."""
        return [plane for plane in self.planes if plane.in_use]

    @property
    def up(self) -> Float64Array | None:
        """Up in the world, (3,): the normal of the plane with most evidence; None while unknown."""
        if self.T_plan_world is None:
            return None
        normal = np.array([0.0, 0.0, 1.0]) if self._main is None else self._main.normal
        return np.asarray(normal @ self.T_plan_world[:3, :3])

    @property
    def likely_up(self) -> Float64Array:
        """Up in the world, (3,), or the up direction of the images while up is unknown."""
        return self._vote.image_up if self.up is None else self.up

    def has_plane_on_top(self, box: Box) -> bool:
        """Return whether a supporting plane lies on top of an upright box: the box is furniture or a part of it."""
        return any(True for _ in self._planes_on_top_of(box, REACH_M + ON_TOP_FRACTION * box.size[2]))

    def is_extended_by_plane(self, box: Box) -> bool:
        """Return whether a plane at the height of an upright box's top extends beyond it, as at the side of a shelf."""
        footprint_m2 = box.size[0] * box.size[1]
        return any(
            footprint_m2 < BEYOND_FRACTION * plane.plan.area_m2() for plane in self._planes_on_top_of(box, DRIFT_M)
        )

    def _planes_on_top_of(self, box: Box, off_m: float) -> Iterator[Plane]:
        """Yield the planes over the middle of an upright box whose distance from its top is at most `off_m`, metres."""
        if self.T_plan_world is None or box.size[2] <= 2.0 * REACH_M:
            return
        center = self.to_plan(box.center[None])
        top_m = box.size[2] / 2.0
        for plane in self._at(center):
            if plane.in_use and abs(float(plane.height(center)[0]) + top_m) <= off_m and plane.plan.covers(center)[0]:
                yield plane

    def supporting_plane(self, points: Float32Array, plane: Plane) -> Plane:
        """Return the plane that supports an object with world points (N, 3); see `seats.supporting_plane`."""
        places = self.to_plan(points)
        return seats.supporting_plane(places, plane, partial(self._at, places), self._config.min_plane_area_m2)

    def seat_of(self, points: Float32Array, plane: Plane) -> Float64Array:
        """Return world points (N, 3) of the seats of a floating object; see `seats.seat_of`."""
        assert self.T_plan_world is not None
        places = self.to_plan(points)
        seat = seats.seat_of(places, plane, self._at(places), self._config.min_plane_area_m2)
        return np.asarray(seat @ self.T_plan_world[:3, :3])

    def to_plan(self, points: Float32Array | Float64Array) -> Float64Array:
        """Transform world points (N, 3) to the plan frame."""
        assert self.T_plan_world is not None
        return np.asarray(points, dtype=np.float64) @ self.T_plan_world[:3, :3].T

    def _at(self, plan_points: Float64Array) -> list[Plane]:
        return [self.planes[k] for k in self._windows.at(plan_points)]

    def in_world(self, plane: Plane) -> tuple[Float64Array, float]:
        """Return normal (3,) and offset of a plane in the world: normal.p + offset = 0."""
        assert self.T_plan_world is not None
        return plane.normal @ self.T_plan_world[:3, :3], plane.offset

    def outline_in_world(self, plane: Plane) -> Float64Array:
        """Return the outline (N, 3) of a plane in the world."""
        assert self.T_plan_world is not None
        plan = plane.plan.outline()
        n, d = plane.normal, plane.offset
        height = -(plan @ n[:2] + d) / n[2]
        return np.asarray(np.column_stack([plan, height]) @ self.T_plan_world[:3, :3])


def _survivor(plane: Plane | None) -> Plane | None:
    """Return the plane that absorbed a plane, or the plane itself; None if neither exists any more."""
    while plane is not None and plane.index < 0:
        plane = plane.absorbed_by
    return plane
