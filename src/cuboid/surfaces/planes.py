"""Supporting planes: several, horizontal relative to each other, found online, tracked and grown.

Up is the direction in which the scene's horizontal surfaces face. No inertial unit tells it: it is the
direction that collects the most flat area, where surfaces that a camera held upright would see from above
count most.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from cuboid.config import TrackerConfig
from cuboid.frame import Float32Array, Float64Array
from cuboid.surfaces.cells import Cells
from cuboid.surfaces.grid import GroundPlan
from cuboid.surfaces.up import UpVote

# A cell whose normal is within this of up is horizontal.
HORIZONTAL_COS = float(np.cos(np.radians(12.0)))
# A horizontal cell belongs to a plane when it is within this of it, metres, or three standard deviations.
ON_PLANE_M = 0.02
# A plane is used after it was seen in this many frames, or at once when this many times the least area is seen.
USE_AFTER_FRAMES, USE_AT_ONCE = 3, 3.0
# The top of a box: smaller than this, square metres, at most so high above the plane that the box stands on, metres,
# and that plane so many times as large. Seats, shelves and stools are larger or higher.
LID_AREA_M2, LID_HEIGHT_M, LID_RATIO = 0.2, 0.3, 3.0
# A cluster that comes this close below another plane, metres, is what holds that plane up: its rim, its legs.
RIM_DEPTH_M = 0.035
# Under a plane this far above theirs, metres, things that reach this share of the way up are legs or panels, and so
# are those at most so wide, metres, that are so many times as high.
TABLE_CLEARANCE_M, LEG_REACH, LEG_WIDTH_M, LEG_SLENDER = 0.4, 0.6, 0.13, 2.5
# Under a board less high above: what reaches this share of the way up and is as long as a square of the board's area;
# and what reaches this share and is at least so wide, metres.
SPAN_REACH, BACK_REACH, BACK_WIDTH_M = 0.5, 0.75, 0.25
# What lies under a board does so with this share of its points.
UNDER_SHARE = 0.8
# A plane that is not used yet is forgotten after so many frames without a sighting.
FORGET_FRAMES = 60
# What a plane covers is found anew every so many frames, and in its first ones each time.
REFRESH_FRAMES = 8
# Prior spread of how far a frame sees a plane from where the map has it: poses drift by centimetres and degrees.
DRIFT_M, DRIFT_RAD = 0.03, 0.02
# A plane moves with the map when so many of the map's points lie on it.
LEAST_CARRIED = 100
# Planes at most this many are tracked.
MOST_PLANES = 32


@dataclass(slots=True, eq=False)
class Plane:
    """A tracked plane; moments are in the plan frame, weighted by area over variance."""

    weight: float = 0.0
    mean: Float64Array = field(default_factory=lambda: np.zeros(3))
    scatter: Float64Array = field(default_factory=lambda: np.zeros((3, 3)))
    normal: Float64Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    offset: float = 0.0
    frames: int = 0
    last_frame: int = 0
    in_use: bool = False

    def add(self, points: Float64Array, weights: Float64Array) -> None:
        """Take in points (N, 3) of the plane."""
        w = float(weights.sum())
        mean = weights @ points / w
        centred = points - mean
        step = mean - self.mean
        total = self.weight + w
        self.scatter += (centred * weights[:, None]).T @ centred + np.outer(step, step) * (self.weight * w / total)
        self.mean = self.mean + step * (w / total)
        self.weight = total

    def absorb(self, other: Plane) -> None:
        """Take in another plane that turned out to be the same."""
        step = other.mean - self.mean
        total = self.weight + other.weight
        self.scatter += other.scatter + np.outer(step, step) * (self.weight * other.weight / total)
        self.mean = self.mean + step * (other.weight / total)
        self.weight = total
        self.frames = max(self.frames, other.frames)
        self.last_frame = max(self.last_frame, other.last_frame)

    def fit(self) -> None:
        """Find normal and offset: a horizontal plane, tilted as far as its own points demand.

        The slope (a, b) of height over the plan minimises the weighted squared residual plus a prior of 2 degrees
        that a narrow or noisy plane cannot overcome.
        """
        s = self.scatter / max(self.weight, 1e-12)
        spread = 0.01**2 / 0.035**2  # a residual of 1 cm against a slope of 2 degrees
        slope = np.linalg.solve(s[:2, :2] + spread * np.eye(2) * 0.01, s[:2, 2])
        normal = np.array([-slope[0], -slope[1], 1.0])
        self.normal = normal / np.linalg.norm(normal)
        self.offset = -float(self.normal @ self.mean)

    def move(self, points: Float64Array) -> None:
        """Let the plane lie where its points (N, 3), in the plan frame, now are; it stays as sure as it was."""
        self.mean = points.mean(0)
        centred = points - self.mean
        self.scatter = centred.T @ centred * (self.weight / len(points))
        self.fit()

    def height(self, points: Float64Array) -> Float64Array:
        """Return the heights (N,) of points (N, 3) above the plane."""
        return points @ self.normal + self.offset


class PlaneTracker:
    """Finds and tracks the supporting planes of a scene.

    Attributes
    ----------
    T_plan_world : (4, 4) float64 or None
        Carries the world to the plan frame, whose third axis is up; None while up is unknown.
    planes : list of Plane
        In the plan frame, in the order of the plan's layers.
    plan : GroundPlan
    """

    def __init__(self, config: TrackerConfig) -> None:
        self._config = config
        self._vote = UpVote()
        self.T_plan_world: Float64Array | None = None
        self.planes: list[Plane] = []
        self.plan = GroundPlan()

    def vote(self, cells: Cells, T_world_camera: Float64Array) -> None:
        """Let a frame's flat cells say which way is up; all begins anew where that changes."""
        up = self._vote.update(cells, T_world_camera)
        if up is not None and (self.T_plan_world is None or self._vote.changed):
            self._start(up)

    def update(self, frame: int, cells: Cells) -> npt.NDArray[np.int8]:
        """Take in a frame's flat cells.

        Returns
        -------
        (rows, columns) int8
            The plane that each patch lies on, -1 none.
        """
        rows, columns = cells.image_shape
        owner = np.full(rows * columns, -1, np.int8)
        if self.T_plan_world is None:
            return owner.reshape(rows, columns)
        R = self.T_plan_world[:3, :3]
        flat = np.flatnonzero(cells.normal @ R[2] > HORIZONTAL_COS)
        centers = cells.center[flat] @ R.T
        self.plan.reach(centers[:, :2])
        matched = self._match(centers, cells.sigma_m[flat])
        before = list(self.planes)
        self._learn(frame, centers, cells.area_m2[flat], cells.sigma_m[flat], matched)
        self._discover(frame, centers, cells.area_m2[flat], cells.sigma_m[flat], matched)
        self._tidy(frame)
        if self.planes != before:
            matched = self._match(centers, cells.sigma_m[flat])
        owner[cells.places[flat]] = matched[:, None]
        return owner.reshape(rows, columns)

    def carry(self, before: Float32Array, after: Float64Array) -> None:
        """Move the planes with the map.

        Parameters
        ----------
        before, after : (N, 3)
            The map's points in the world before and after.
        """
        if self.T_plan_world is None:
            return
        old, new = self.to_plan(before), self.to_plan(after)
        for k, plane in enumerate(self.planes):
            on = np.flatnonzero(np.abs(plane.height(old)) < ON_PLANE_M)
            on = on[self.plan.covers(k, old[on])]
            if len(on) >= LEAST_CARRIED:
                plane.move(new[on])
                self.plan.move(k, new[on])

    def _start(self, up: Float64Array) -> None:
        side = np.eye(3)[int(np.argmin(np.abs(up)))]
        first = np.cross(side, up)
        first /= np.linalg.norm(first)
        self.T_plan_world = np.eye(4)
        self.T_plan_world[:3, :3] = np.stack([first, np.cross(up, first), up])
        self.planes = []
        self.plan = GroundPlan()

    def _match(self, centers: Float64Array, sigma_m: Float64Array) -> npt.NDArray[np.int8]:
        best = np.full(len(centers), np.inf)
        owner = np.full(len(centers), -1, np.int8)
        for k, plane in enumerate(self.planes):
            off = np.abs(plane.height(centers))
            fits = (off < np.maximum(ON_PLANE_M, 3 * sigma_m)) & (off < best)
            if not fits.any():
                continue
            fits &= self.plan.near(k, centers)
            owner[fits], best[fits] = k, off[fits]
        return owner

    def _learn(
        self,
        frame: int,
        centers: Float64Array,
        area_m2: Float64Array,
        sigma_m: Float64Array,
        matched: npt.NDArray[np.int8],
    ) -> None:
        for k, plane in enumerate(self.planes):
            mine = matched == k
            if np.count_nonzero(mine) < 3:
                continue
            plane.add(centers[mine], area_m2[mine] / sigma_m[mine] ** 2)
            plane.fit()
            plane.frames += 1
            plane.last_frame = frame

    def _discover(
        self,
        frame: int,
        centers: Float64Array,
        area_m2: Float64Array,
        sigma_m: Float64Array,
        matched: npt.NDArray[np.int8],
    ) -> None:
        """Start a plane at the height that collects the most unmatched area."""
        for _ in range(3):
            free = np.flatnonzero(matched < 0)
            if len(free) < 6 or len(self.planes) >= MOST_PLANES:
                return
            order = free[np.argsort(centers[free, 2], kind="stable")]
            heights = centers[order, 2]
            total = np.concatenate([[0.0], np.cumsum(area_m2[order])])
            end = np.searchsorted(heights, heights + 2 * ON_PLANE_M, side="right")
            gain = total[end] - total[:-1]
            first = int(np.argmax(gain))
            members = order[first : end[first]]
            if gain[first] < 0.5 * self._config.min_plane_area_m2 or len(members) < 6:
                return
            plane = Plane(frames=1, last_frame=frame)
            plane.add(centers[members], area_m2[members] / sigma_m[members] ** 2)
            plane.fit()
            self.planes.append(plane)
            self.plan.add_plane(centers[members, :2], area_m2[members])
            matched[members] = len(self.planes) - 1

    def _tidy(self, frame: int) -> None:
        """Put planes to use, forget those that were noise, merge those that are one."""
        least = self._config.min_plane_area_m2
        for k, plane in enumerate(self.planes):
            if frame % REFRESH_FRAMES == k % REFRESH_FRAMES or plane.frames < REFRESH_FRAMES:
                self.plan.refresh(k)
            area = self.plan.area_m2(k)
            if not plane.in_use and area < least:
                continue
            if self._is_lid(k, area):
                plane.in_use = False
            elif not plane.in_use:
                plane.in_use = plane.frames >= USE_AFTER_FRAMES or area >= USE_AT_ONCE * least
        keep = [k for k, p in enumerate(self.planes) if p.in_use or frame - p.last_frame <= FORGET_FRAMES]
        gone = self._merge_twins() if frame % REFRESH_FRAMES == 0 else set()
        keep = [k for k in keep if k not in gone]
        if len(keep) < len(self.planes):
            self.planes = [self.planes[k] for k in keep]
            self.plan.remove_planes(np.array(keep, dtype=np.int64))

    def _is_lid(self, k: int, area_m2: float) -> bool:
        """Tell whether a plane is the top of an object: small, and not high above a far larger plane."""
        if area_m2 >= LID_AREA_M2:
            return False
        center = self.planes[k].mean[None]
        return any(
            other.in_use
            and ON_PLANE_M < float(other.height(center)[0]) <= LID_HEIGHT_M
            and self.plan.area_m2(j) >= LID_RATIO * area_m2
            and bool(self.plan.covers(j, center)[0])
            for j, other in enumerate(self.planes)
            if j != k
        )

    def _merge_twins(self) -> set[int]:
        gone: set[int] = set()
        for a in range(len(self.planes)):
            for b in range(a + 1, len(self.planes)):
                if a in gone or b in gone:
                    continue
                one, two = self.planes[a], self.planes[b]
                apart = max(abs(float(one.height(two.mean[None])[0])), abs(float(two.height(one.mean[None])[0])))
                if apart > 1.5 * ON_PLANE_M or not (self.plan.covered[a] & self.plan.covered[b]).any():
                    continue
                one.absorb(two)
                one.fit()
                one.in_use |= two.in_use
                self.plan.seen[a] += self.plan.seen[b]
                self.plan.refresh(a)
                gone.add(b)
        return gone

    @property
    def up(self) -> Float64Array | None:
        """Up in the world, (3,): the normal of the plane that most is known of; None while unknown."""
        if self.T_plan_world is None:
            return None
        used = [plane for plane in self.planes if plane.in_use]
        normal = max(used, key=lambda p: p.weight).normal if used else np.array([0.0, 0.0, 1.0])
        return np.asarray(normal @ self.T_plan_world[:3, :3])

    @property
    def any_in_use(self) -> bool:
        """Whether any supporting plane is known."""
        return any(plane.in_use for plane in self.planes)

    def ground(self) -> npt.NDArray[np.uint8]:
        """Return where planes in use are, (P, N, M), 1 or 0; see `GroundPlan.covered`."""
        used = np.array([plane.in_use for plane in self.planes], dtype=np.uint8)
        return self.plan.covered * used[:, None, None]

    def to_plan(self, points: Float32Array | Float64Array) -> Float64Array:
        """Carry world points (N, 3) to the plan frame."""
        assert self.T_plan_world is not None
        return np.asarray(points, dtype=np.float64) @ self.T_plan_world[:3, :3].T

    def beneath(self, points: Float32Array | Float64Array, floor_m: float) -> npt.NDArray[np.int64]:
        """Return for each world point (N, 3) the plane beneath it: the nearest one that covers it.

        -1 where there is none, and where the point is within `floor_m` of a plane that covers it.
        """
        plan_points = self.to_plan(points)
        best = np.full(len(plan_points), np.inf)
        owner = np.full(len(plan_points), -1, np.int64)
        for k, plane in enumerate(self.planes):
            if not plane.in_use:
                continue
            height = plane.height(plan_points)
            near = np.flatnonzero((height > -floor_m) & (height < best))
            near = near[self.plan.covers(k, plan_points[near])]
            best[near] = height[near]
            owner[near] = k
        owner[best < floor_m] = -1
        return owner

    def holds_up(self, points: Float32Array | Float64Array, plane: Plane, clearance_m: float = RIM_DEPTH_M) -> bool:
        """Tell whether a cluster of world points that stands on one plane is what holds up another one, so far above.

        It is when one in 25 of its points, or twenty, lie just below a higher plane and under it or at its rim; and
        when it stands under a table and reaches most of the way up, or is slender as a leg whose top is hidden; and
        when it fills a shelf from side to side, or is wide and reaches almost to the next board: the shelf's back.
        """
        plan_points = self.to_plan(points)
        foot = plane.height(plan_points)
        middle = plan_points.mean(0)[None]
        for k, other in enumerate(self.planes):
            clearance = float(plane.height(middle)[0] - other.height(middle)[0])
            if other is plane or not other.in_use or clearance < clearance_m:
                continue
            height = other.height(plan_points)
            beside = (height > -RIM_DEPTH_M) & (height < 0.5 * RIM_DEPTH_M)
            enough = min(20, max(4, len(plan_points) // 25))
            # What a plane covers is asked only of points that matter: it takes the most time here.
            if np.count_nonzero(beside) >= enough and self.plan.covers(k, plan_points[beside]).sum() >= enough:
                return True
            wide, high = float(np.ptp(plan_points[:, :2], axis=0).max()), float(foot.max())
            if clearance >= TABLE_CLEARANCE_M:
                fits = high >= LEG_REACH * clearance or (wide <= LEG_WIDTH_M and high >= LEG_SLENDER * wide)
            else:
                spans = high >= SPAN_REACH * clearance and wide**2 >= self.plan.area_m2(k)
                fits = spans or (high >= BACK_REACH * clearance and wide >= BACK_WIDTH_M)
            if fits and self.plan.covers(k, plan_points).mean() >= 0.5:
                return True
        return False

    def under_board(self, points: Float32Array | Float64Array, plane: Plane) -> bool:
        """Tell whether most of the world points (N, 3) above a plane lie under another one, as low as a shelf's."""
        plan_points = self.to_plan(points)
        middle = plan_points.mean(0)[None]
        for k, other in enumerate(self.planes):
            clearance = float(plane.height(middle)[0] - other.height(middle)[0])
            if other is plane or not other.in_use or not RIM_DEPTH_M < clearance < TABLE_CLEARANCE_M:
                continue
            if self.plan.covers(k, plan_points).mean() >= UNDER_SHARE:
                return True
        return False

    def in_world(self, plane: Plane) -> tuple[Float64Array, float]:
        """Return normal (3,) and offset of a plane in the world: normal.p + offset = 0."""
        assert self.T_plan_world is not None
        return plane.normal @ self.T_plan_world[:3, :3], plane.offset

    def outline_in_world(self, k: int) -> Float64Array:
        """Return the outline (N, 3) of a plane in the world."""
        assert self.T_plan_world is not None
        plan = self.plan.outline(k)
        n, d = self.planes[k].normal, self.planes[k].offset
        height = -(plan @ n[:2] + d) / n[2]
        return np.asarray(np.column_stack([plan, height]) @ self.T_plan_world[:3, :3])

    def in_frame(self, cells: Cells, owner: npt.NDArray[np.int8], T_world_camera: Float64Array) -> Float64Array:
        """Return the planes as this frame sees them, (P, 4): normal and offset in the camera frame.

        The poses drift: a frame's own table may lie a centimetre off the map's. Each plane is shifted and tilted to
        the frame's cells on it, as far as the priors of drift allow.
        """
        assert self.T_plan_world is not None
        T_plan_camera = self.T_plan_world @ T_world_camera
        R = self.T_plan_world[:3, :3]
        of_cell = owner.reshape(-1)[cells.places[:, 0]]
        result = np.zeros((len(self.planes), 4))
        for k, plane in enumerate(self.planes):
            normal, offset = plane.normal, plane.offset
            mine = of_cell == k
            if np.count_nonzero(mine) >= 4:
                normal, offset = _adapt(plane, cells.center[mine] @ R.T, cells.sigma_m[mine])
            result[k, :3] = normal @ T_plan_camera[:3, :3]
            result[k, 3] = normal @ T_plan_camera[:3, 3] + offset
        return result


def _adapt(plane: Plane, points: Float64Array, sigma_m: Float64Array) -> tuple[Float64Array, float]:
    """Shift and tilt a plane (plan frame) to a frame's points on it: ridge regression, once reweighted."""
    middle = points.mean(0)
    design = np.column_stack([points[:, :2] - middle[:2], np.ones(len(points))])
    residual = plane.height(points)
    prior = np.diag([DRIFT_RAD**-2, DRIFT_RAD**-2, DRIFT_M**-2])
    weights = 1.0 / (sigma_m**2 + 0.003**2)
    solution: Float64Array = np.zeros(3)
    for _ in range(2):
        # Neighbouring cells err alike: a frame's cells count as a tenth of their number.
        w = 0.1 * weights / (1.0 + ((residual - design @ solution) / (3 * sigma_m + 0.003)) ** 2)
        solution = np.asarray(np.linalg.solve(design.T @ (design * w[:, None]) + prior, design.T @ (w * residual)))
    normal = plane.normal - np.array([solution[0], solution[1], 0.0])
    offset = plane.offset - solution[2] + float(solution[:2] @ middle[:2])
    norm = float(np.linalg.norm(normal))
    return normal / norm, offset / norm
