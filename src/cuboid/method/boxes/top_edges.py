"""Length and width of a box from the edges of its top in a color image.

Depth is worst at edges: stereo widens near surfaces, time of flight loses pixels there, structured light is ragged.
Which edge it is follows from depth; where it is, from color. Each side of the top is moved and turned by a few pixels
to where the steps of color across it are largest (as in the tracker of Harris and Stennett, "RAPID", 1990). Only the
distance of opposite edges is taken: an error of the registration of color to depth moves both alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.tolerances import BIAS_M, SIGMAS
from cuboid.ground.geometry.box import Box
from cuboid.method.boxes.kernels.top_edges import color_steps, sums_along
from cuboid.method.boxes.profile import Profile, is_of_revolution, outline
from cuboid.method.boxes.rims import LOWER_RIM, WALL_M

# An edge lies within this many pixels of where depth has it, and within this fraction of the shorter side; a smaller
# reach than the minimum cannot tell edges apart. Its ends are turned by at most TURN_PX.
REACH_PX, REACH_FRACTION, MIN_REACH_PX, TURN_PX = 8.0, 0.45, 4.0, 4.0
# Depth widens a surface at most by this on each side, pixels: stereo by up to two. An edge further inside is that of an
# upper part, beyond which a lower one stands out, as in a pile of books. Noise, and the registration of color to depth,
# move both edges of a length by one more. Outside, the whole reach counts: time of flight loses pixels.
MAX_WIDENED_PX, MAX_MOVED_PX = 2.0, 1.0
# Distance of the points of a line across an edge, pixels, and half of the distance of two points whose colors are
# compared, points: at an outline, where other edges are near, it is shorter.
STEP_PX, LAG, OUTLINE_LAG = 0.5, 2, 1
# Steps of a channel larger than this are no stronger evidence, levels: a print is no edge.
MAX_STEP_LEVELS = 40.0
# Number of lines across an edge, or a round rim; fraction of the side that they span: corners may be worn, or round.
LINES, SPAN, ROUNDED_SPAN = 40, 0.9, 0.4
# Number of neighbouring lines that cross an edge between the same two colors.
GROUP = 5
# Turns of a rectangle that are tried, radians: its direction is one of every two degrees.
TURNS = np.radians(np.arange(-2.0, 2.01, 0.25))
# Displacements of a disc that are tried along each axis, pixels.
MOVES_PX = np.arange(-4.0, 4.01, 1.0)
# An edge counts if it stands out from the median step by this, levels: twice the noise of a color, 2 to 3 levels. No
# other place within reach may stand out by more than this fraction: on made parcels with prints, few wrong edges are
# left with it, and most true ones.
MIN_STEP_LEVELS, MAX_OTHER = 5.0, 0.7
# An edge of a rim outside of the strongest one is its outline if it stands out by this fraction of that one.
OUTER_FRACTION = 0.4
# Half of the width of a step at half of its height, points: the outer flank of a step is so far outside of its edge.
HALF_WIDTH = 2.0
# Sides that face the camera at this cosine are seen: depth tells where they are, and the edge below them is that of a
# shadow as well.
SEEN_FACING = 0.35
# Edges of the outline of a rounded body that is not round are within this many times the reach: depth ends long before
# its far side does.
OUTLINE_REACH = 1.5
# Pixels between two different edges.
APART_PX = 2.5
# An edge counts if this fraction of its lines shows the top inside of it.
MIN_SHOWN_FRACTION = 0.5
# Standard deviation of a length between two edges, pixels: chosen on made parcels, where the 95 % interval then holds
# 93 % of the lengths; see BENCHMARK.md, "Measures".
SIDE_PX = 1.0
# The same between two outlines of a rounded object, and of the diameter of a round one.
OUTLINE_PX, ROUND_OUTLINE_PX = 2.5, 1.3
# A side that is known no better than this, pixels, is left to depth.
MAX_SIGMA_PX = 5.0
# Smallest cosine between up and the direction to the camera: below 30 degrees a top is too foreshortened.
MIN_FACING = 0.5


@dataclass(frozen=True, slots=True)
class Picture:
    """A frame at full size.

    Attributes
    ----------
    color : (H, W, 3) uint8
    depth_m : (H, W) float32
    camera : Intrinsics
    T_camera_map : (4, 4) float64
    noise_per_m : float
        Standard deviation of depth divided by depth squared, 1/metre.
    """

    color: UInt8Array
    depth_m: Float32Array
    camera: Intrinsics
    T_camera_map: Float64Array
    noise_per_m: float

    @property
    def eye(self) -> Float64Array:
        """Position of the camera in the map, (3,) metres."""
        return np.asarray(-self.T_camera_map[:3, :3].T @ self.T_camera_map[:3, 3])

    def shows(self, points: Float64Array, front_m: float = 0.0, behind_m: float = 0.0) -> npt.NDArray[np.bool_]:
        """Return which points (N, 3) are in the image and not contradicted by its depth.

        The surface may be in front of a point or behind it by so much.
        """
        local = points @ self.T_camera_map[:3, :3].T + self.T_camera_map[:3, 3]
        z = np.maximum(local[:, 2], 1e-6)
        u, v = np.rint(self.camera.pixels(np.column_stack([local[:, :2], z]))).astype(np.int64).T
        inside = (u >= 0) & (u < self.camera.width) & (v >= 0) & (v < self.camera.height)
        read = self.depth_m[np.where(inside, v, 0), np.where(inside, u, 0)]
        within = BIAS_M + SIGMAS * self.noise_per_m * z**2
        fits = (read - z <= behind_m + within) & (z - read <= front_m + within)
        return np.asarray(inside & ((read <= 0.0) | fits))


def top_sides(
    box: Box,
    picture: Picture,
    rim_m: float,
    steps_m: Float64Array | None = None,
    *,
    hollow: bool = False,
    profile: Profile | None = None,
) -> Float64Array:
    """Return the length and the width of a box from the edges of its top, and their standard deviations, (4,) metres.

    All values of a side are NaN if its edges are not clear.

    Parameters
    ----------
    box : Box
        In the map.
    picture : Picture
    rim_m : float
        Height of its top above the rim of the top, metres; see `rims.rim_drop_m`.
    steps_m : (2,) float64, optional
        Height of its top above lower parts at the ends of its length and width, metres; see `rims.steps_m`.
    hollow : bool
        Whether the top is a rim around a hollow.
    profile : Profile, optional
        That of a body that does not end where its top does: its outline is measured, not the edges of its top.
    """
    unknown = np.full(4, np.nan)
    middle = box.center if profile is not None else box.center + box.size[2] / 2.0 * box.up
    T = picture.T_camera_map
    ray = picture.eye - middle
    above_m, away_m = float(ray @ box.up), math.sqrt(ray @ ray)
    if above_m < MIN_FACING * away_m:
        return unknown
    pixel_m = float((T[:3, :3] @ middle + T[:3, 3])[2]) / math.sqrt(picture.camera.fx * picture.camera.fy)
    if pixel_m <= 0.0:
        return unknown
    # Opposite edges are farther apart than an edge may be off.
    reach = math.floor(min(REACH_PX, REACH_FRACTION * float(box.size[:2].min()) / pixel_m) / STEP_PX)
    if reach < MIN_REACH_PX / STEP_PX:
        return unknown
    view = _View(picture, box, middle, pixel_m, reach, hollow, profile, LAG if profile is None else OUTLINE_LAG)
    longer = view if profile is None else replace(view, reach=round(OUTLINE_REACH * reach))
    found, stands_out, is_disc = *_rectangle(longer), False
    if abs(box.size[0] - box.size[1]) < REACH_PX * pixel_m:
        disc, rim = _disc(view)
        of_revolution = profile is not None and is_of_revolution(box)
        if of_revolution or rim > stands_out:
            found, is_disc = disc, True
    if profile is None:
        # An edge that lies lower than the top appears displaced, the more the farther the camera is aside.
        aside = (np.abs(ray @ box.rotation[:, :2]) + box.size[:2] / 2.0) / above_m
        sigma_m = np.hypot(SIDE_PX * pixel_m, LOWER_RIM * rim_m * (1.0 + aside))
        if steps_m is not None:
            sigma_m = np.hypot(sigma_m, steps_m * aside)
    else:
        sigma_m = np.full(2, (ROUND_OUTLINE_PX if is_disc else OUTLINE_PX) * pixel_m)
    if hollow:
        sigma_m = np.hypot(sigma_m, WALL_M)
    clear = ~np.isnan(found) & (sigma_m <= MAX_SIGMA_PX * pixel_m)
    return np.where(np.tile(clear, 2), np.concatenate([found, sigma_m]), np.nan)


@dataclass(frozen=True, slots=True)
class _View:
    """A box in a picture: the middle (3,) of its top, the width of a pixel there, and the reach of edges, points.

    With a profile the middle is that of the box, and edges are those of the outline.
    """

    picture: Picture
    box: Box
    top: Float64Array
    pixel_m: float
    reach: int
    hollow: bool = False
    profile: Profile | None = None
    lag: int = LAG

    @property
    def front_m(self) -> float:
        """How much nearer to the camera than an edge the surface inside of it may be, metres."""
        return 0.0 if self.profile is None else float(self.box.size[2])

    @property
    def behind_m(self) -> float:
        """How much farther away the surface inside of an edge may be, metres."""
        return float(self.box.size[2]) if self.hollow or self.profile is not None else 0.0

    def outline(
        self, axis: int, places: Float64Array, outward: Float64Array
    ) -> tuple[Float64Array, npt.NDArray[np.bool_]]:
        """Return the places of the outline for places (S, 3) on the sides of the box; see `profile.outline`."""
        if self.profile is None:
            return places, np.ones(len(places), bool)
        return outline(self.profile, axis, self.box, places, outward, self.picture.eye)


def _rectangle(view: _View) -> tuple[Float64Array, float]:
    """Return the sides (2,) of a rectangular top, NaN where not clear, and how far its edges stand out, levels."""
    box, top, pixel_m = view.box, view.top, view.pixel_m
    span = SPAN if view.profile is None else ROUNDED_SPAN
    along = np.linspace(-span, span, LINES)
    edges = []
    for side in range(4):
        sign, axis = 1.0 if side < 2 else -1.0, side % 2
        outward = sign * box.rotation[:, axis]
        half_m = box.size[1 - axis] / 2.0
        line = np.outer(along * half_m, np.cross(box.up, outward))
        directions = np.tile(outward, (LINES, 1))
        places, wide = view.outline(axis, top + outward * box.size[axis] / 2.0 + line, directions)
        # All edges of a rectangle turn alike.
        turned = np.rint(-np.outer(TURNS, along * half_m) / (pixel_m * STEP_PX))
        edges.append(_Edge(view, places[wide], directions[wide], turned[:, wide]))
    stands_out = np.array([edge.stands_out for edge in edges])
    best = int(np.argmax(stands_out.sum(0)))
    offsets = np.array([edge.offset_m(best) for edge in edges])
    if view.profile is not None:
        facing = np.array([edge.facing for edge in edges])
        offsets = np.where(facing > SEEN_FACING, view.profile.beyond_m, offsets)
    longer_m = offsets[:2] + offsets[2:]
    widened_m = np.array([edge.max_widened_m for edge in edges])
    longer_m[longer_m < -(widened_m[:2] + widened_m[2:])] = np.nan
    return box.size[:2] + longer_m, float(stands_out[:, best].mean())


def _disc(view: _View) -> tuple[Float64Array, float]:
    """Return the sides (2,) of a round top, twice its diameter, and how far its rim stands out; see `_rectangle`."""
    angles = np.linspace(0.0, 2.0 * np.pi, LINES, endpoint=False)
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    outward = directions @ view.box.rotation[:, :2].T
    diameter_m = float(view.box.size[:2].mean())
    moves = np.stack(np.meshgrid(MOVES_PX, MOVES_PX), axis=-1).reshape(-1, 2)
    moved = np.rint(moves @ directions.T / STEP_PX)
    places, wide = view.outline(2, view.top + outward * diameter_m / 2.0, outward)
    rim = _Edge(view, places[wide], outward[wide], moved[:, wide])
    best = int(np.argmax(rim.stands_out))
    stands_out = float(rim.stands_out[best])
    form = best
    if view.profile is None:
        # A lid and the rim around it have one centre, and are two pixels apart: around that centre both stand out, so
        # that the sum of squares is largest.
        rim = _Edge(replace(view, lag=OUTLINE_LAG), places[wide], outward[wide], moved[:, wide])
        form = int(np.argmax((rim.means**2).sum(1)))
    offset_m = rim.outermost_m(rim.means[form])
    found_m = diameter_m + 2.0 * offset_m if offset_m >= -rim.max_widened_m else math.nan
    return np.full(2, found_m), stands_out


class _Edge:
    """The steps of color across an expected edge, for each form of the edge and each offset within reach.

    Where the side below an edge is seen as a narrow strip, its foot is a second edge, often the stronger one: both have
    the same offset.

    Parameters
    ----------
    view : _View
    places, outward : (S, 3) float64
        A place of the expected edge, and the direction across it, for each line.
    shifts : (M, S) float64
        Shift of the edge at each line, for each form, points.

    Attributes
    ----------
    means : (M, O) float64
        Mean step, levels, from the innermost offset on; zero if too few lines show the top.
    facing : float
        Cosine between the directions across the edge and to the camera.
    max_widened_m : float
        Largest distance of a true edge inside of the expected one, metres, but for noise.
    """

    def __init__(self, view: _View, places: Float64Array, outward: Float64Array, shifts: Float64Array) -> None:
        self._view, picture, box, pixel_m = view, view.picture, view.box, view.pixel_m
        rays = picture.eye - places
        if not len(places):
            self.means, self.max_widened_m, self._inward, self.facing = np.zeros((len(shifts), 1)), 0.0, 0, 0.0
            return
        # Of a length along the rays, fewer pixels are seen.
        seen_fraction = float(np.sqrt(1.0 - (rays * outward).sum(1) ** 2 / (rays**2).sum(1)).mean())
        self.facing = float(((rays * outward).sum(1) / np.sqrt((rays**2).sum(1))).mean())
        self.max_widened_m = MAX_WIDENED_PX * pixel_m / seen_fraction
        self._inward = min(view.reach, round((MAX_WIDENED_PX + MAX_MOVED_PX) / (STEP_PX * seen_fraction)))
        means = np.zeros((len(shifts), 2 * view.reach + 1))
        self.means = means[:, view.reach - self._inward :]
        # Depth at the edge itself is not exact.
        shown = picture.shows(places - outward * (view.reach * STEP_PX * pixel_m), view.front_m, view.behind_m)
        if np.count_nonzero(shown) < MIN_SHOWN_FRACTION * len(places):
            return
        beyond_m, above_m = (rays * outward).sum(1), rays @ box.up
        strip_m = beyond_m * box.size[2] / (above_m + box.size[2])
        narrow = shown & (strip_m > 0.0) & (strip_m < 2.0 * REACH_PX * pixel_m) & (view.profile is None)
        means += self._means_of(self._steps_of(places[shown], outward[shown]), shifts[:, shown])
        if narrow.any():
            foot = self._steps_of(places[narrow] - box.size[2] * box.up, outward[narrow])
            means += narrow.sum() / shown.sum() * self._means_of(foot, shifts[:, narrow])

    @property
    def stands_out(self) -> Float64Array:
        """How far the best offset of each form stands out, (M,) levels."""
        return np.asarray(self.means.max(1) - np.median(self.means, axis=1))

    def outermost_m(self, means: Float64Array) -> float:
        """Return the offset of the outermost edge that stands out in means (O,), metres; NaN if none does.

        A lid ends inside of the body, and the wall of a vessel has two edges: the outermost circle is the outline. A
        disc that is displaced by half of the wall has half of each edge at one offset; at the true centre each edge
        stands out.
        """
        usual = float(np.median(means))
        least = max(MIN_STEP_LEVELS, OUTER_FRACTION * (float(means.max()) - usual))
        peaks = [k for k in range(1, len(means) - 1) if means[k - 1] <= means[k] > means[k + 1]]
        high = [k for k in peaks if means[k] - usual >= least]
        if not high:
            return math.nan
        is_wall = self._view.hollow and self._view.profile is not None
        return self._outer_m(means, high[-1]) if is_wall else self._peak_m(means, high[-1])

    def _outer_m(self, means: Float64Array, best: int) -> float:
        """Return the offset of the outer one of two edges that are one step, as of a thin wall; NaN if unknown."""
        usual = float(np.median(means))
        half = usual + (means[best] - usual) / 2.0
        k = best
        while k + 1 < len(means) and means[k + 1] > half:
            k += 1
        if k + 1 == len(means):
            return math.nan
        at = k + (means[k] - half) / (means[k] - means[k + 1]) - HALF_WIDTH
        return float((at - self._inward) * STEP_PX * self._view.pixel_m)

    def _peak_m(self, means: Float64Array, best: int) -> float:
        """Return the offset of the vertex of the parabola through a peak and its neighbours, metres."""
        before, peak, after = means[best - 1 : best + 2]
        curve = before - 2.0 * peak + after
        peaked = best + (0.5 * (before - after) / curve if curve < 0.0 else 0.0)
        return float((peaked - self._inward) * STEP_PX * self._view.pixel_m)

    def offset_m(self, form: int) -> float:
        """Return the offset of the edge in a form, metres; NaN if it is not clear."""
        means = self.means[form]
        if self._view.profile is not None:
            return self.outermost_m(means)
        best, usual = int(means.argmax()), float(np.median(means))
        if not 0 < best < len(means) - 1 or means[best] - usual < MIN_STEP_LEVELS:
            return math.nan
        apart = np.abs(np.arange(len(means)) - best) > APART_PX / STEP_PX
        if float(means[apart].max()) - usual > MAX_OTHER * (means[best] - usual):
            return math.nan
        return self._peak_m(means, best)

    def _steps_of(self, places: Float64Array, outward: Float64Array) -> Float64Array:
        reach, turn, picture = self._view.reach, round(TURN_PX / STEP_PX), self._view.picture
        step_m = STEP_PX * self._view.pixel_m
        steps = np.empty((len(places), 2 * (reach + turn) + 1, 3))
        ends = -(reach + turn) * step_m, step_m
        T = picture.T_camera_map
        color_steps(
            picture.color, picture.camera.pinhole, T, places, outward, *ends, self._view.lag, MAX_STEP_LEVELS, steps
        )
        return steps

    def _means_of(self, steps: Float64Array, shifts: Float64Array) -> Float64Array:
        turn, width, lag = round(TURN_PX / STEP_PX), 2 * self._view.reach + 1, self._view.lag
        allowed = np.abs(shifts).max(1) <= turn
        found = np.empty((int(allowed.sum()), width))
        sums_along(steps.reshape(len(steps), -1), shifts[allowed].astype(np.int64) + turn, GROUP, found)
        # The step of a sharp edge is as wide as the distance of the compared points: its middle is found.
        padded = np.pad(found, ((0, 0), (lag, lag)), mode="edge")
        means = np.zeros((len(shifts), width))
        means[allowed] = sum(padded[:, k : k + width] for k in range(2 * lag + 1)) / (2 * lag + 1)
        return means
