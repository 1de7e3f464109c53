"""Clusters of hot points that stand on something: those of one frame, and those of the map."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.config import TrackerConfig
from cuboid.frame import Float32Array, Float64Array
from cuboid.heatmap.voxel_map import Rows, VoxelMap
from cuboid.kernels.pixels import gather_regions, label_regions
from cuboid.surfaces.plane import Plane
from cuboid.surfaces.planes import PlaneTracker
from cuboid.working import WorkingImage

# Neighbouring readings of one surface differ by less than this plus four standard deviations, metres: 2.5 mm apart
# at 1 m, a surface that is tilted by up to 75 degrees.
JUMP_M = 0.01
# A region of fewer working pixels is noise: a 3 cm object at 2 m covers about this many.
LEAST_PIXELS = 24
# A cluster of fewer voxels is noise.
LEAST_VOXELS = 8
# Points of a cluster, at most about, that tell whether it is furniture.
LOOKED_AT = 5000
# The top of a cluster is this share of its height, at least so many metres; what it borders on is looked for so many
# working pixels farther up, and lies before it when it is nearer by so many metres.
TOP_SHARE, TOP_M, TOP_PIXELS, BEFORE_M = 0.1, 0.01, 8, 0.03
# An upright sheet at most this thick, and longer and higher than that, metres, is a panel: a chair's back, a shelf's
# side. The front of a cereal box is narrower.
PANEL_THICK_M, PANEL_LONG_M = 0.06, 0.25
# Under the board of a shelf such a sheet is the shelf's back, of which less shows: so long and so high, metres.
BACK_LONG_M, BACK_HIGH_M = 0.15, 0.12
# What runs along the border of its plane, at least so long, no wider and no higher, with this share of its points, is
# the lip of a shelf or a tray; metres.
LIP_LONG_M, LIP_WIDE_M, LIP_HIGH_M, LIP_SHARE = 0.25, 0.07, 0.05, 0.9
# The ground that points cover is counted in squares of this edge, metres: a voxel's.
PLACE_M = 0.01


@dataclass(frozen=True, slots=True)
class FrameCluster:
    """A hot region of one frame.

    Attributes
    ----------
    pixels : (N,) int64
        Numbers of its pixels in the flattened working image.
    points : (N, 3) float64
        World, metres.
    plane : Plane or None
        The plane beneath.
    heat : float
        Mean heat, 0..1.
    rect_xyxy : (4,) float64
        In pixels of the full image, end exclusive.
    cut : bool
        It touches the border of the picture: a part of it is out of view.
    """

    pixels: npt.NDArray[np.int64]
    points: Float64Array
    plane: Plane | None
    heat: float
    rect_xyxy: Float64Array
    cut: bool


@dataclass(frozen=True, slots=True)
class MapCluster:
    """A connected set of hot voxels.

    Attributes
    ----------
    rows : (N,) int64
        Rows of the map.
    links : callable
        Returns the places in `rows` of each pair of neighbours, (E, 2) int64.
    plane : Plane or None
        The plane beneath.
    furniture : bool
        It holds up another plane, is a panel, or is far larger than an object (the diagonal of its extent along the
        world's axes passes twice the largest side).
    """

    rows: Rows
    links: Callable[[], npt.NDArray[np.int64]]
    plane: Plane | None
    furniture: bool


def frame_clusters(
    image: WorkingImage,
    heat: Float32Array,
    claim: npt.NDArray[np.int32],
    support: npt.NDArray[np.int32],
    planes: PlaneTracker,
    T_world_camera: Float64Array,
    config: TrackerConfig,
) -> list[FrameCluster]:
    """Find the hot regions of a frame, in the order of their first pixel."""
    wanted = (heat >= config.hot).astype(np.uint8)
    labels = np.empty(wanted.shape, np.int32)
    parent = np.empty(wanted.size, np.int32)
    number = label_regions(image.depth_m, wanted, claim, config.depth_noise_per_m, JUMP_M, parent, labels)
    pixels, points = np.empty(labels.size, np.int64), np.empty((labels.size, 3))
    first, corners = np.empty(number + 1, np.int64), np.empty((number, 4), np.int64)
    beneath = np.empty(number, np.int64)
    c = image.camera
    kept = gather_regions(
        labels, number, LEAST_PIXELS, image.depth_m, np.array([c.fx, c.fy, c.cx, c.cy]), support, first,
        pixels, points, corners, beneath,
    )  # fmt: skip
    warm = heat.ravel()[pixels[: first[kept]]]
    ends = corners[:kept] + np.array([0, 0, 1, 1])
    rects = ends * float(image.step) + np.array([*image.phase, *image.phase])
    cut = ((corners[:kept, :2] <= 1) | (ends[:, 2:] >= [c.width - 1, c.height - 1])).any(1)
    clusters = []
    for k in range(kept):
        own = slice(int(first[k]), int(first[k + 1]))
        plane = planes.planes[beneath[k]] if beneath[k] >= 0 else None
        world = points[own] @ T_world_camera[:3, :3].T + T_world_camera[:3, 3]
        clusters.append(FrameCluster(pixels[own], world, plane, float(warm[own].mean()), rects[k], bool(cut[k])))
    return clusters


def top_is_seen(cluster: FrameCluster, image: WorkingImage, up: Float64Array, T_camera_world: Float64Array) -> bool:
    """Tell whether a frame shows where a cluster ends at the top: what its top borders on is not before it.

    The leg of a table goes on behind the table's edge, the side of a shelf behind its board.

    Parameters
    ----------
    cluster : FrameCluster
    image : WorkingImage
    up : (3,) float64
        In the world.
    T_camera_world : (4, 4) float64
    """
    height = cluster.points @ up
    top = cluster.pixels[height >= height.max() - max(TOP_M, TOP_SHARE * float(np.ptp(height)))]
    c = image.camera
    rise = T_camera_world[:3, :3] @ up
    v, u = np.divmod(top, c.width)
    depth = image.depth_m.ravel()[top].astype(np.float64)
    # A step up moves a pixel by f (rise_x - u rise_z, rise_y - v rise_z), u and v from the centre, f apart.
    step = np.stack([rise[0] - (u - c.cx) / c.fx * rise[2], rise[1] - (v - c.cy) / c.fy * rise[2]])
    step /= np.maximum(np.abs(step).max(0), 1e-9)
    member = np.zeros(image.depth_m.size, bool)
    member[cluster.pixels] = True
    beyond = np.zeros(len(top))
    for k in range(1, TOP_PIXELS + 1):
        x = np.clip(np.rint(u + k * step[0]), 0, c.width - 1).astype(np.int64)
        y = np.clip(np.rint(v + k * step[1]), 0, c.height - 1).astype(np.int64)
        there = y * c.width + x
        found = np.where(member[there], 0.0, image.depth_m.ravel()[there])
        beyond = np.where(beyond > 0, beyond, found)
    known = beyond > 0
    before = known & (beyond < depth - BEFORE_M)
    return 2 * int(np.count_nonzero(before)) < max(1, int(np.count_nonzero(known)))


def map_clusters(rows: Rows, voxels: VoxelMap, planes: PlaneTracker, config: TrackerConfig) -> list[MapCluster]:
    """Find the connected sets among hot rows that stand on a plane, or on nothing known where there is no plane."""
    support = np.full(len(rows), -1, np.int64)
    if planes.any_in_use:
        support = planes.beneath(voxels.xyz(rows), 0.6 * config.min_height_m)
        rows, support = rows[support >= 0], support[support >= 0]
    component, number, edges = voxels.connect(rows)
    order = np.argsort(component, kind="stable")
    ends = np.searchsorted(component[order], np.arange(number + 1))
    place = np.empty(len(rows), np.int64)
    place[order] = np.arange(len(rows)) - ends[component[order]]
    clusters = []
    for k in range(number):
        members = order[ends[k] : ends[k + 1]]
        if len(members) < LEAST_VOXELS:
            continue
        points = voxels.xyz(rows[members])
        beneath = support[members]
        plane = planes.planes[int(np.bincount(beneath).argmax())] if beneath[0] >= 0 else None
        reach = float(np.linalg.norm(points.max(0) - points.min(0)))
        furniture = reach > 2.0 * config.max_size_m
        if plane is not None and not furniture:
            some = points[:: 1 + len(points) // LOOKED_AT]
            furniture = planes.holds_up(some, plane) or _is_panel(some, plane, planes) or _is_lip(some, plane, planes)
        links = _Links(k, place, component, edges)
        clusters.append(MapCluster(rows[members], links, plane, furniture))
    return clusters


@dataclass(frozen=True, slots=True)
class _Links:
    """The links of one cluster, taken out of those of all when they are asked for: few clusters are contested."""

    number: int
    place: npt.NDArray[np.int64]
    component: npt.NDArray[np.int32]
    edges: npt.NDArray[np.int32]

    def __call__(self) -> npt.NDArray[np.int64]:
        mine = self.edges[self.component[self.edges[:, 0]] == self.number]
        return np.asarray(self.place[mine], dtype=np.int64)


def _is_lip(points: Float32Array, plane: Plane, planes: PlaneTracker) -> bool:
    """Tell whether points (N, 3) of the world run low along the border of the plane that they stand on."""
    plan_points = planes.to_plan(points)
    long = float(np.linalg.norm(np.ptp(plan_points[:, :2], axis=0)))
    if long < LIP_LONG_M or float(plane.height(plan_points).max()) > LIP_HIGH_M:
        return False
    places = np.unique(np.floor(plan_points[:, :2] / PLACE_M), axis=0)
    if len(places) * PLACE_M**2 > LIP_WIDE_M * long:
        return False
    border = plane.plan.on_border(plan_points)
    return bool(border.mean() >= LIP_SHARE)


def _is_panel(points: Float32Array, plane: Plane, planes: PlaneTracker) -> bool:
    """Tell whether points (N, 3) of the world make an upright sheet, long and high: a chair's back, a shelf's side."""
    return _is_sheet(planes.to_plan(points), PANEL_LONG_M, PANEL_LONG_M) or is_back(points, plane, planes)


def is_back(points: Float32Array, plane: Plane, planes: PlaneTracker) -> bool:
    """Tell whether points (N, 3) of the world, which stand on a plane, make a shelf's back: a sheet under a board."""
    return _is_sheet(planes.to_plan(points), BACK_LONG_M, BACK_HIGH_M) and planes.under_board(points, plane)


def _is_sheet(plan_points: Float64Array, long_m: float, high_m: float) -> bool:
    if np.ptp(plan_points[:, 2]) < high_m:
        return False
    spread = np.sqrt(np.maximum(np.linalg.eigvalsh(np.cov(plan_points[:, :2].T)), 0.0))
    # Points spread evenly over a length have a standard deviation of its twelfth part's root.
    thick, long = np.sqrt(12.0) * spread
    return bool(thick <= PANEL_THICK_M and long >= long_m)
