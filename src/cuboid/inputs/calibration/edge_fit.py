"""Depth edges, color edges, and the move (magnification and shift) that aligns the first with the second."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.frame import Frame
from cuboid.inputs.calibration.kernels.edges import depth_edges, edge_agreement

# Minimum width of the downsampled images, pixels: edges are located to half a pixel of them.
EDGE_WIDTH_PX = 320
# A surface ends where the next reading is farther by at least JUMP, as a fraction of the depth (more than any noise),
# within SHADOW_GAP_PX pixels of an image with width 640: the projector's shadow may lie between.
JUMP = 0.05
SHADOW_GAP_PX = 12
# Minimum number of depth edges of a usable frame; maximum number, of which a random subset is used.
MIN_DEPTH_EDGES, MAX_DEPTH_EDGES = 50, 1200
# Number of edges of each frame for the exhaustive search.
FEW_EDGES = 120
# Grid of the exhaustive search: magnifications 0.62 to 1.62 (the two cameras of a RealSense have 1.57), shifts up to 24
# pixels of the downsampled image (7-Scenes is off by 8 in the image's middle), and blur of the color edges, pixels.
MAGNIFIED = np.exp(np.arange(-0.48, 0.481, 0.04))
SHIFTED_PX = np.arange(-24.0, 24.1, 3.0)
SEARCH_BLUR_PX = 4.0
# Number of best moves of the search that are refined, in addition to no move; minimum difference between them, pixels
# (root mean square over the image).
REFINED_MOVES, MOVES_APART_PX = 6, 8.0
# Refinement levels: blur (pixels), steps of magnification (fraction) and of shift (pixels).
FINER = ((3.0, 0.02, 1.5), (2.0, 0.01, 0.75), (1.2, 0.005, 0.4), (1.0, 0.0025, 0.2))
FINE_BLUR_PX = FINER[-1][0]
# Candidate baselines between the two cameras of a device, which lie side by side, metres.
BASELINES_M = np.arange(-0.08, 0.081, 0.005)
# Minimum relative gain in edge agreement for a baseline between the cameras: noise and nearly equal depths give less.
APART_GAIN = 0.05
# Columns and rows of tiles into which the image is divided if all frames show the same view.
TILES = (6, 4)
# A view is new if at least this fraction of its edges are farther than SAME_PLACE_PX pixels from the edges of every
# earlier view.
SAME_VIEW, SAME_PLACE_PX = 0.5, 2

_SEED = 5
# The identity move; a move is (g, du, dv, p, q), see `edge_agreement`.
NOWHERE = np.array([1.0, 0.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True, slots=True)
class Edges:
    """Depth edges, and the strength of color edges, in pixels of the downsampled image.

    Attributes
    ----------
    places : (N, 3) float32
        Column and row of each depth edge, and the depth of the surface, metres.
    across : (N,) bool
        Whether the surface ends along the row, else along the column.
    image : (N,) int32
        Number of the image.
    strength : (F, 2, H, W) float32
        Strength of color edges across the row and across the column, 0 to 1, of each image.
    """

    places: Float32Array
    across: npt.NDArray[np.bool_]
    image: npt.NDArray[np.int32]
    strength: Float32Array

    @property
    def center(self) -> Float64Array:
        """Column and row of the middle of the image."""
        height, width = self.strength.shape[2:]
        return np.array([(width - 1) / 2, (height - 1) / 2])

    def blurred(self, sigma_px: float) -> Edges:
        """Return a copy with blurred color edges."""
        smooth = np.empty_like(self.strength)
        for k, two in enumerate(self.strength):
            for axis, one in enumerate(two):
                smooth[k, axis] = cv2.GaussianBlur(one, (0, 0), sigma_px)
        return replace(self, strength=smooth)

    def chosen(self, which: npt.NDArray[np.bool_]) -> Edges:
        """Return the depth edges in a mask (N,)."""
        return replace(self, places=self.places[which], across=self.across[which], image=self.image[which])

    def few(self) -> Edges:
        """Return a copy with at most `FEW_EDGES` depth edges of each image."""
        rng = np.random.default_rng(_SEED)
        drawn = rng.permutation(len(self.image))
        order = drawn[np.argsort(self.image[drawn], kind="stable")]
        first = np.searchsorted(self.image[order], self.image[order])
        return self.chosen(np.isin(np.arange(len(self.image)), order[np.arange(len(order)) - first < FEW_EDGES]))

    def per_image(self, moves: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Return sums of strengths and numbers of edges inside the image, (M, F) each."""
        sums = np.empty((len(moves), len(self.strength)))
        counts = np.empty_like(sums)
        edge_agreement(self.places, self.across, self.image, self.strength, moves, self.center, sums, counts)
        return sums, counts

    def agreement(self, moves: Float64Array) -> Float64Array:
        """Return the edge agreement (M,): the mean strength; edges outside the image get the expected random value."""
        sums, counts = (one.sum(axis=1) for one in self.per_image(moves))
        return np.asarray((sums + (len(self.places) - counts) * float(self.strength.mean())) / len(self.places))

    def agreement_inside(self, moves: Float64Array) -> Float64Array:
        """Return the mean strength (M,) over edges inside the image, to compare moves that keep the same edges."""
        sums, counts = (one.sum(axis=1) for one in self.per_image(moves))
        return np.asarray(sums / np.maximum(counts, 1))


def gather_edges(frames: Iterable[Frame]) -> tuple[Edges, int] | None:
    """Return depth edges and color edge strengths, and the downsampling factor, or None."""
    places, across, image, factor = [], [], [], 1
    strength: list[Float32Array] = []
    rng = np.random.default_rng(_SEED)
    for frame in frames:
        height, width = frame.depth_m.shape
        factor = max(1, width // EDGE_WIDTH_PX)
        ends, along_row = _ends(frame.depth_m)
        if len(ends) < MIN_DEPTH_EDGES:
            continue
        kept = np.sort(rng.permutation(len(ends))[:MAX_DEPTH_EDGES])
        ends = ends[kept]
        ends[:, :2] = (ends[:, :2] - (factor - 1) / 2) / factor
        places.append(ends)
        across.append(along_row[kept])
        image.append(np.full(len(kept), len(strength), np.int32))
        strength.append(_strength(frame, (width // factor, height // factor)))
    if not places:
        return None
    found = Edges(np.concatenate(places), np.concatenate(across), np.concatenate(image), np.array(strength))
    return found, factor


def _ends(depth_m: Float32Array) -> tuple[Float32Array, npt.NDArray[np.bool_]]:
    """Return column, row and depth of depth edges (N, 3), and whether they end along the row (N,)."""
    out, across = np.empty((depth_m.size // 8, 3), np.float32), np.empty(depth_m.size // 8, np.bool_)
    gap = max(1, SHADOW_GAP_PX * depth_m.shape[1] // 640)
    count = depth_edges(np.ascontiguousarray(depth_m), JUMP, gap, out, across)
    return out[:count], across[:count]


def _strength(frame: Frame, size: tuple[int, int]) -> Float32Array:
    """Return the color edge strength across row and column (2, h, w), 0 to 1; 0.5 at the 90th percentile."""
    grey = cv2.cvtColor(frame.color, cv2.COLOR_RGB2GRAY)
    small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    strengths = []
    for dx, dy in ((1, 0), (0, 1)):
        slope = np.abs(cv2.Sobel(small, cv2.CV_32F, dx, dy))
        strengths.append(slope / (slope + np.percentile(slope, 90) + 1e-3))
    return np.array(strengths, np.float32)


def fit_move(edges: Edges, fine: Edges, likely: Float64Array, *, shift_only: bool = False) -> Float64Array:
    """Return the move (g, du, dv, 0, 0) with the best edge agreement, by coarse-to-fine search from several starts.

    Color edges with one blur at a time are in memory, besides those of the arguments.

    Parameters
    ----------
    edges : Edges
    fine : Edges
        The same depth edges, with the color edges of the last step, blurred by `FINE_BLUR_PX`.
    likely : (5,) float64
        A further start.
    shift_only : bool
        Whether g stays that of `likely`.
    """
    few = edges.few()
    magnified = likely[:1] if shift_only else MAGNIFIED
    moves = [likely, *_starts(few.blurred(SEARCH_BLUR_PX), magnified)]
    for sigma, fraction, shift in FINER:
        level = replace(few, strength=fine.strength) if sigma == FINE_BLUR_PX else few.blurred(sigma)
        moves = [_refined(level, move, fraction, shift, shift_only) for move in moves]
        del level  # before the next one is made
    ends = np.array(moves)
    return np.asarray(ends[int(np.argmax(replace(few, strength=fine.strength).agreement(ends)))])


def _starts(edges: Edges, magnified: Float64Array) -> list[Float64Array]:
    """Return the best moves of the search that are not neighbours: the coarse ranking is uncertain."""
    g, du, dv = (one.ravel() for one in np.meshgrid(magnified, SHIFTED_PX, SHIFTED_PX, indexing="ij"))
    moves = np.stack([g, du, dv, np.zeros_like(g), np.zeros_like(g)], axis=1)
    kept: list[Float64Array] = []
    for k in np.argsort(-edges.agreement(moves), kind="stable").tolist():
        if all(size_of(edges, moves[k] - one) > MOVES_APART_PX for one in kept):
            kept.append(moves[k])
            if len(kept) == REFINED_MOVES:
                break
    return kept


def _refined(edges: Edges, move: Float64Array, fraction: float, shift: float, shift_only: bool) -> Float64Array:
    """Return the best move near a given one, by search with these steps of magnification and shift."""
    steps = np.stack(np.meshgrid(*[np.arange(-2, 3)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    if shift_only:
        steps = steps[steps[:, 0] == 0]
    best = move
    for _ in range(3):
        moves = np.repeat(best[None], len(steps), axis=0)
        moves[:, :3] += steps * (fraction * best[0], shift, shift)
        better = np.asarray(moves[int(np.argmax(edges.agreement(moves)))])
        if (better == best).all():
            break
        best = better
    return best


def fit_baseline(edges: Edges, move: Float64Array) -> Float64Array:
    """Return the move (4,) with a baseline between the cameras, if edges then agree clearly better."""
    focal = 0.85 * edges.strength.shape[3]  # only for the search range: depth sensors' cameras have 0.6 to 1 widths
    p, off = np.meshgrid(BASELINES_M * focal, np.arange(-1.0, 1.01, 0.25))
    moves = np.repeat(move[None], p.size, axis=0)
    moves[:, 1] += (off - p / np.median(edges.places[:, 2])).ravel()
    moves[:, 3] = p.ravel()
    agreement = edges.agreement_inside(moves)
    best, chance = int(np.argmax(agreement)), float(edges.strength.mean())
    if agreement[best] - chance < (1 + APART_GAIN) * (float(edges.agreement_inside(move[None])[0]) - chance):
        return move
    return np.asarray(moves[best])


def size_of(edges: Edges, move: Float64Array) -> float:
    """Return the shift by a difference of moves (4,), root mean square over the image, downsampled pixels."""
    half = edges.center
    return float(np.sqrt(move[0] ** 2 * (half**2).sum() / 3 + move[1] ** 2 + move[2] ** 2))


def tile_of(edges: Edges) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.bool_]]:
    """Return the tile of each depth edge (N,), and whether its row and column have an even sum (N,)."""
    height, width = edges.strength.shape[2:]
    columns, rows = TILES
    column = np.clip((edges.places[:, 0] * columns / width).astype(np.int64), 0, columns - 1)
    row = np.clip((edges.places[:, 1] * rows / height).astype(np.int64), 0, rows - 1)
    return row * columns + column, (row + column) % 2 == 0


def gain_of(
    edges: Edges,
    part: npt.NDArray[np.integer],
    even: npt.NDArray[np.bool_],
    of_even: Float64Array,
    of_odd: Float64Array,
) -> tuple[float, float, int]:
    """Return the cross-validated gain of moves from even and odd parts, its standard error, and the number of parts.

    Parameters
    ----------
    edges : Edges
    part : (N,) int
        Number of the image, or of the tile, of each depth edge; parts with fewer than `MIN_DEPTH_EDGES` are left out.
    even : (N,) bool
        Whether the part is even.
    of_even, of_odd : (5,) float64
        Moves that were fitted to the even and to the odd parts.
    """
    gains = []
    for k in np.flatnonzero(np.bincount(part) >= MIN_DEPTH_EDGES).tolist():
        in_part = part == k
        move = of_odd if even[in_part][0] else of_even
        before, after = edges.chosen(in_part).agreement_inside(np.stack([NOWHERE, move]))
        gains.append(after - before)
    if len(gains) < 2:
        return 0.0, float("inf"), len(gains)
    return float(np.mean(gains)), float(np.std(gains, ddof=1) / np.sqrt(len(gains))), len(gains)


def different_views(edges: Edges) -> int:
    """Return the number of images that show a new view."""
    kept: list[npt.NDArray[np.uint8]] = []
    shape = edges.strength.shape[2:]
    kernel = np.ones((2 * SAME_PLACE_PX + 1,) * 2, np.uint8)
    for k in range(len(edges.strength)):
        columns, rows = np.rint(edges.places[edges.image == k, :2]).astype(int).T
        rows, columns = np.clip(rows, 0, shape[0] - 1), np.clip(columns, 0, shape[1] - 1)
        if all(one[rows, columns].mean() < SAME_VIEW for one in kept):
            drawn = np.zeros(shape, np.uint8)
            drawn[rows, columns] = 1
            kept.append(np.asarray(cv2.dilate(drawn, kernel), np.uint8))
    return len(kept)
