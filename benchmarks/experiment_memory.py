"""Memory and time as a camera walks past ever more objects, more than memory may hold.

A camera looks down on a floor with boxes on it, and goes from place to place, 2 m each time; what a few of these show
is seen again and again, as if it stood elsewhere. Pictures are small, and 2D proposals are the true outlines, so that
10,000 objects take minutes.

Then two trackers go the same short way, frame by frame by turns, one of which is told of as many objects, as many
candidates that ended, and cubes of the map, far away: what else the machine does is the same for both.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from functools import cache
from itertools import count
from typing import Any

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.geometry.box import Box
from cuboid.method.heatmap.kernels.cubes import make_cube, pack_key
from cuboid.method.proposals import Proposals
from cuboid.runs.tracking.measuring import peak_memory_mb
from cuboid.runs.tracking.posed_tracker import PosedTracker
from tables import cell, dump, show

CAMERA = Intrinsics(125.0, 125.0, 79.5, 59.5, 160, 120)
# Boxes of a place along and across, metres apart; looks at a place; places in a row, metres apart.
ALONG, ACROSS, GAP_M, LOOKS, ROW, APART_M = 6, 4, 0.27, 5, 20, 2.0
# Places with other boxes; what is seen of them is kept, 0.2 MB a look.
KINDS = 10
NOISE_PER_M = 1.4e-3
# Places that two trackers see; where other objects are, metres, and how many cubes of the map each of them has.
PLACES, FAR_M, CUBES = 32, 100.0, 9
# Frames over which the median is taken.
WINDOW = 400


class Place:
    """Boxes on a floor, and what a camera sees of them from some places."""

    def __init__(self, seed: int, rows: int) -> None:
        self._rng = np.random.default_rng(seed)
        x, y = np.meshgrid(*((np.arange(n) - (n - 1) / 2) * GAP_M for n in (ALONG, rows)))
        middle = np.stack([x.ravel(), y.ravel()], 1) + self._rng.uniform(-0.03, 0.03, (x.size, 2))
        half = self._rng.uniform(0.045, 0.065, (len(middle), 2))
        self._low = np.column_stack([middle - half, np.zeros(len(middle))])
        self._high = np.column_stack([middle + half, self._rng.uniform(0.08, 0.16, len(middle))])
        self._colors = self._rng.integers(40, 220, (len(middle) + 1, 3))

    def measure_visibility(
        self, turn: float
    ) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.uint8], Proposals, Float64Array]:
        """Return depth, color, proposals, and the pose in the place."""
        eye = np.array([0.6 * np.sin(turn), -0.9 * np.cos(turn), 1.35])
        forward = np.array([0.0, 0.1, 0.0]) - eye
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = np.stack([right, np.cross(forward, right), forward], 1), eye
        v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
        ray = CAMERA.points(u, v, np.ones(u.shape)) @ T[:3, :3].T
        depth, hit = eye[2] / -ray[..., 2], np.zeros(u.shape, np.int64)
        for k, (low, high) in enumerate(zip(self._low, self._high, strict=True)):
            one, two = (low - eye) / ray, (high - eye) / ray
            enter, leave = np.minimum(one, two).max(-1), np.maximum(one, two).min(-1)
            here = (enter < leave) & (enter > 0) & (enter < depth)
            depth[here], hit[here] = enter[here], k + 1
        depth = depth + NOISE_PER_M * depth**2 * self._rng.standard_normal(depth.shape)
        return depth.astype(np.float32), self._colors[hit].astype(np.uint8), _proposals(hit), T


def _proposals(hit: npt.NDArray[np.int64]) -> Proposals:
    boxes, masks = [], []
    for k in np.unique(hit[hit > 0]):
        mask = hit == k
        columns, rows = np.flatnonzero(mask.any(0)), np.flatnonzero(mask.any(1))
        boxes.append((columns[0], rows[0], columns[-1] + 1, rows[-1] + 1))
        masks.append(mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1].astype(np.uint8))
    return Proposals(np.array(boxes, np.int32).reshape(-1, 4), np.full(len(boxes), 0.9, np.float32), tuple(masks))


def places_in_rows(shown: list[Proposals], rows: int = ACROSS) -> Iterator[Iterator[Frame]]:
    """Give the frames of one place after another, in rows there and back; `shown` is made the proposals of each.

    Each place has so many rows of boxes.
    """
    for number in count():
        along, across = divmod(number, ROW)
        shift = APART_M * np.array([across if along % 2 == 0 else ROW - 1 - across, along, 0.0])
        yield looks(number, shift, shown, rows)


@cache
def seen(kind: int, rows: int) -> list[tuple[npt.NDArray[np.float32], npt.NDArray[np.uint8], Proposals, Float64Array]]:
    """Return the looks at a place of some kind."""
    place = Place(kind, rows)
    return [place.measure_visibility(0.12 * (k - LOOKS / 2)) for k in range(LOOKS)]


def looks(number: int, shift: npt.NDArray[np.float64], shown: list[Proposals], rows: int = ACROSS) -> Iterator[Frame]:
    """Give the frames of a place that lies so far away, metres; `shown` is made the proposals of each."""
    for k, (depth, color, proposals, T) in enumerate(seen(number % KINDS, rows)):
        shown[:] = [proposals]
        T_world_camera = T.copy()
        T_world_camera[:3, 3] += shift
        index = number * LOOKS + k
        yield Frame(index, index / 30, color, depth, T_world_camera)


def walk(objects: int, memory_mb: float, checkpoints: list[int]) -> list[dict[str, Any]]:
    """Walk until there are so many objects; return how things stand when there are as many as at each checkpoint."""
    shown: list[Proposals] = []
    tracker = PosedTracker(CAMERA, proposals=lambda frame, camera: shown[-1], memory_mb=memory_mb)
    times: list[float] = []
    rows, known, worst = [], 0, 0.0
    waiting = sorted({*checkpoints, objects})
    for frames in places_in_rows(shown):
        for frame in frames:
            begun_s = time.process_time()
            known = tracker.update(frame).objects_known
            times.append((time.process_time() - begun_s) * 1e3)
            worst = max(worst, times[-1]) if frame.index > WINDOW // 4 else 0.0
        if known >= waiting[0]:
            waiting.pop(0)
            median = float(np.median(times[-WINDOW:]))
            rows.append(
                {
                    "objects": known,
                    "frames": len(times),
                    "points": tracker.points_known,
                    "frame_ms": median,
                    "frame_max_ms": worst,
                    "map_mb": tracker.map_bytes / 2**20,
                    "memory_mb": peak_memory_mb(),
                }
            )
            worst = 0.0
            print(rows[-1], file=sys.stderr, flush=True)
            if not waiting:
                break
    return rows


def elsewhere(objects: int) -> dict[str, float]:
    """Return the median frame, ms, of a tracker with few objects and of one that has so many more elsewhere."""
    shown: list[Proposals] = []
    trackers = [PosedTracker(CAMERA, proposals=lambda frame, camera: shown[-1]) for _ in range(2)]
    times: list[list[float]] = [[], []]
    for number in range(PLACES):
        if number == PLACES // 3:
            _tell_of(trackers[1], objects)
        for frame in looks(number, np.array([APART_M * number, 0.0, 0.0]), shown):
            for tracker, ms in zip(trackers, times, strict=True):
                begun_s = time.process_time()
                tracker.update(frame)
                ms.append((time.process_time() - begun_s) * 1e3)
    few, many = (float(np.median(ms[-PLACES // 2 * LOOKS :])) for ms in times)
    return {"few_ms": few, "many_ms": many, "ratio": many / few}


def _tell_of(tracker: PosedTracker, objects: int) -> None:
    """Let a tracker have objects far away, and cubes of the map that are not in memory."""
    store, rng = tracker._map.store, np.random.default_rng(0)
    for k in range(2 * objects):
        spot = FAR_M + APART_M * np.array([k // 48 % ROW, k // (48 * ROW), 0]) + rng.uniform(-0.8, 0.8, 3)
        entry = store.add(Box(spot, np.array([0.1, 0.1, 0.12]), np.eye(3)), 0)
        if k % 2:
            store.retire(entry)
        else:
            store.confirm(entry)
    cubes = tracker.voxels.stored.cubes
    for k in range(CUBES * objects):
        place, (x, y, z) = k // 216, np.unravel_index(k % 216, (6, 6, 6))
        make_cube(np.int64(pack_key(400 + 6 * (place % ROW) + x, 400 + 6 * (place // ROW) + y, z)), cubes)
    cubes.bits[cubes.rows == 0] = 0


def run(args: argparse.Namespace) -> None:
    """Print the table, or all figures."""
    # The walk first: what another tracker had of the process's memory, this one would have to do without.
    found = walk(max(args.objects), args.memory, [100, 300, 1000, 3000])
    beside = elsewhere(max(args.objects))
    if args.json:
        dump({"elsewhere": beside, "walk": found})
        return
    header = ("objects", "frames", "points", "ms a frame", "worst", "map MB in memory", "peak memory MB")
    names = ("frame_ms", "frame_max_ms", "map_mb", "memory_mb")
    lines = [[row["objects"], row["frames"], row["points"], *(cell(row[name], 1) for name in names)] for row in found]
    show(f"A walk with {args.memory:g} MB: median and worst frame since the row above", header, lines)
    show("Median frame with few objects, and with many elsewhere", list(beside), [list(beside.values())])
