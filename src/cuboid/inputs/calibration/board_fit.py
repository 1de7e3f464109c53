"""Extrinsics of the cameras of a rig from a ChArUco board that several of them see.

The board may be moved, and the cameras need not be synchronised: a position of the board counts while it stands
still in all cameras that see it. The corners of a position are the means over its frames. The poses of all cameras
and of the board at all positions are fitted together to the corners in the images (bundle adjustment).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.geometry.se3 import assembled, exp, inverse, tidied, transform
from cuboid.inputs.calibration.board import MIN_CORNERS, Board
from cuboid.inputs.calibration.chain import chained

# The board stands still between two frames if its corners move less than this, pixels (root mean square): a few times
# the noise of a corner.
STILL_PX = 0.7
# The largest number of positions of the board that are fitted, evenly chosen.
MAX_POSITIONS = 40
# A corner that is farther from its place than this counts less, pixels: the accuracy of a good corner is a tenth.
ROBUST_PX = 0.5


@dataclass(frozen=True, slots=True)
class BoardSeen:
    """The board in one frame of a camera: time in seconds, numbers (N,) and pixels (N, 2) of its corners."""

    time_s: float
    numbers: npt.NDArray[np.int64]
    pixels: Float64Array


@dataclass(frozen=True, slots=True)
class BoardFit:
    """The poses of the cameras.

    Attributes
    ----------
    T_rig_camera : (N, 4, 4) float64
        The first camera is the rig.
    error_m, error_rad : (N,) float64
        Standard errors of position and direction; 0 for the first camera.
    positions : (N,) int64
        Number of positions of the board that each camera shares with another one.
    residual_px : float
        Root mean square distance of the corners from their places.
    """

    T_rig_camera: Float64Array
    error_m: Float64Array
    error_rad: Float64Array
    positions: npt.NDArray[np.int64]
    residual_px: float


def seen_boards(frames: Iterable[Frame], board: Board) -> list[BoardSeen]:
    """Return the board in each frame of a camera that shows it."""
    found = []
    for frame in frames:
        numbers, pixels = board.find(frame.color)
        if len(numbers):
            found.append(BoardSeen(frame.timestamp_s, numbers, pixels))
    return found


def fit_board(
    seen: Sequence[Sequence[BoardSeen]], cameras: Sequence[Intrinsics], names: Sequence[str], board: Board
) -> BoardFit:
    """Find the poses of the cameras of a rig.

    Parameters
    ----------
    seen : sequence of sequences of BoardSeen
        For each camera, the board in its frames, in the order of time.
    cameras : sequence of Intrinsics
    names : sequence of str
        Names of the cameras, for messages.
    board : Board

    Raises
    ------
    InputError
        A camera does not see the board at the same time as another one, while it stands still.
    """
    for name, views in zip(names, seen, strict=True):
        if not views:
            raise InputError(f"camera {name}: no frame shows the board {board}; --board has the size of another board")
    positions = _positions(seen)
    chosen = np.unique(np.linspace(0, len(positions) - 1, min(len(positions), MAX_POSITIONS)).round().astype(int))
    problem = _Problem(cameras, board, [positions[k] for k in chosen.tolist()])
    return problem.solve(problem.start(names))


Corners = tuple[npt.NDArray[np.int64], Float64Array]
Position = dict[int, Corners]


def _positions(seen: Sequence[Sequence[BoardSeen]]) -> list[Position]:
    """Return the corners at each position of the board that two cameras see: camera -> numbers and mean pixels."""
    spans = [_still_spans(views) for views in seen]
    edges = sorted({edge for one in spans for span in one for edge in span})
    found = []
    for begin_s, end_s in pairwise(edges):
        at: Position = {}
        for k, views in enumerate(seen):
            inside = [view for view in views if begin_s <= view.time_s <= end_s]
            still = any(first_s <= begin_s and end_s <= last_s for first_s, last_s in spans[k])
            numbers, pixels = _mean_corners(inside) if inside and still else (np.zeros(0, np.int64), np.zeros((0, 2)))
            if len(numbers) >= MIN_CORNERS:
                at[k] = numbers, pixels
        if len(at) > 1:
            found.append(at)
    return found


def _still_spans(views: Sequence[BoardSeen]) -> list[tuple[float, float]]:
    """Return the spans of time, seconds, in which the board stands still in the image of a camera."""
    spans: list[tuple[float, float]] = []
    for before, after in pairwise(views):
        _, i, j = np.intersect1d(before.numbers, after.numbers, return_indices=True)
        moved_px = np.sqrt(((before.pixels[i] - after.pixels[j]) ** 2).sum(1).mean()) if len(i) else np.inf
        if moved_px > STILL_PX:
            continue
        if spans and spans[-1][1] == before.time_s:
            spans[-1] = spans[-1][0], after.time_s
        else:
            spans.append((before.time_s, after.time_s))
    return spans


def _mean_corners(views: Sequence[BoardSeen]) -> tuple[npt.NDArray[np.int64], Float64Array]:
    """Return the corners that most frames show, with their mean pixels."""
    numbers = np.concatenate([view.numbers for view in views])
    pixels = np.concatenate([view.pixels for view in views])
    kept, index, counts = np.unique(numbers, return_inverse=True, return_counts=True)
    sums = np.zeros((len(kept), 2))
    np.add.at(sums, index, pixels)
    often = 2 * counts > len(views)
    return kept[often], sums[often] / counts[often, None]


class _Problem:
    """The fit of the poses of all cameras and of the board at all positions."""

    def __init__(self, cameras: Sequence[Intrinsics], board: Board, positions: Sequence[Position]) -> None:
        self._cameras, self._corners, self._positions = cameras, board.corners, positions

    def start(self, names: Sequence[str]) -> Float64Array:
        """Return first poses (N, 4, 4) of the cameras: each from one that is placed, at the best common position.

        Raises
        ------
        InputError
            A camera has no common position with the others.
        """
        return chained(
            names,
            lambda a, b: [(-self._cost(a, b, T), T) for T in self._candidates(a, b)],
            "no other camera sees the board at the same time while it stands still; hold it still for a second where "
            "two cameras see it",
        )

    def _shared(self, a: int, b: int) -> list[Position]:
        return [at for at in self._positions if a in at and b in at]

    def _candidates(self, a: int, b: int) -> list[Float64Array]:
        """Return T_a_b (4, 4) from each common position; a flat board has two likely poses in each camera."""
        return [
            T_a_board @ inverse(T_b_board)
            for at in self._shared(a, b)
            for T_a_board in self._board_poses(a, at)
            for T_b_board in self._board_poses(b, at)
        ]

    def _board_poses(self, k: int, at: Position) -> list[Float64Array]:
        """Return the likely T_camera_board (4, 4) of a position."""
        numbers, pixels = at[k]
        _, turns, shifts, _ = cv2.solvePnPGeneric(
            self._corners[numbers], pixels, _matrix(self._cameras[k]), None, flags=cv2.SOLVEPNP_IPPE
        )
        return [
            tidied(assembled(cv2.Rodrigues(turn)[0], shift.ravel())) for turn, shift in zip(turns, shifts, strict=True)
        ]

    def _cost(self, a: int, b: int, T_a_b: Float64Array) -> float:
        """Return the median, over the common positions, of the distance of both cameras' corners from their places."""
        T_a_camera = {a: np.eye(4), b: T_a_b}
        costs = [
            min(sum(float((self._off(T_a_camera[k], T, at[k], k) ** 2).mean()) for k in (a, b)) for T in likely)
            for at in self._shared(a, b)
            for likely in (self._board_poses(a, at),)
        ]
        return float(np.median(costs))

    def solve(self, start: Float64Array) -> BoardFit:
        """Fit all poses to all corners, from first poses of the cameras."""
        boards = np.array([self._first_board(start, at) for at in self._positions])
        free, count = len(start) - 1, len(start) - 1 + len(boards)

        def poses(x: Float64Array) -> tuple[Float64Array, Float64Array]:
            steps = [exp(one) for one in x.reshape(count, 6)]
            cameras = [start[0], *(T @ step for T, step in zip(start[1:], steps[:free], strict=True))]
            return np.array(cameras), np.array([T @ step for T, step in zip(boards, steps[free:], strict=True)])

        def residuals(x: Float64Array) -> Float64Array:
            return np.concatenate([one for one, _, _ in self._residuals(*poses(x))])

        owners = [(k, p, len(one)) for one, k, p in self._residuals(start, boards)]
        found = least_squares(
            residuals,
            np.zeros(6 * count),
            jac_sparsity=_sparsity(owners, free, count),
            loss="soft_l1",
            f_scale=ROBUST_PX,
            x_scale="jac",
        )
        cameras, _ = poses(found.x)
        J, left = np.asarray(found.jac @ np.eye(6 * count)), residuals(found.x)
        variance = float(left @ left) / max(len(left) - J.shape[1], 1)
        sigma = np.sqrt(np.maximum(variance * np.diag(np.linalg.pinv(J.T @ J)), 0.0)).reshape(count, 6)[:free]
        # `exp` takes the shift first, then the turn.
        return BoardFit(
            np.array([tidied(T) for T in cameras]),
            np.concatenate(([0.0], np.linalg.norm(sigma[:, :3], axis=1))),
            np.concatenate(([0.0], np.linalg.norm(sigma[:, 3:], axis=1))),
            np.array([sum(k in at for at in self._positions) for k in range(len(start))]),
            float(np.sqrt(2 * np.mean(left**2))),
        )

    def _first_board(self, T_rig_camera: Float64Array, at: Position) -> Float64Array:
        """Return T_rig_board (4, 4) of a position: of all cameras' likely poses, the one that fits all of them best."""
        candidates = [T_rig_camera[k] @ T for k in at for T in self._board_poses(k, at)]
        return min(
            candidates, key=lambda T: sum(float((self._off(T_rig_camera[k], T, at[k], k) ** 2).sum()) for k in at)
        )

    def _off(self, T_rig_camera: Float64Array, T_rig_board: Float64Array, corners: Corners, k: int) -> Float64Array:
        """Return the distances (N, 2) of the corners in camera k from their places, pixels."""
        numbers, pixels = corners
        points = transform(inverse(T_rig_camera) @ T_rig_board, self._corners[numbers])
        points[:, 2] = np.maximum(points[:, 2], 1e-3)
        return np.asarray(self._cameras[k].pixels(points) - pixels)

    def _residuals(self, cameras: Float64Array, boards: Float64Array) -> list[tuple[Float64Array, int, int]]:
        """Return the distances of each camera at each position, with the numbers of both."""
        return [
            (self._off(cameras[k], T, corners, k).ravel(), k, p)
            for p, (T, at) in enumerate(zip(boards, self._positions, strict=True))
            for k, corners in at.items()
        ]


def _sparsity(owners: Sequence[tuple[int, int, int]], free: int, count: int) -> Float64Array:
    """Return which residuals depend on which of the `count` poses: on those of their camera and of their board."""
    rows = []
    for k, p, length in owners:
        row = np.zeros((length, count, 6))
        row[:, free + p] = 1
        if k > 0:
            row[:, k - 1] = 1
        rows.append(row.reshape(length, -1))
    return np.concatenate(rows)


def _matrix(camera: Intrinsics) -> Float64Array:
    return np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
