"""Memory and time as a camera walks past ever more objects, more than memory may hold.

A camera looks down on a floor with boxes on it, and goes from place to place; each has other boxes, 2 m from the last
ones. Pictures are small, and 2D proposals are the true outlines, so that 10,000 objects take minutes.
"""

from __future__ import annotations

import argparse
import sys
import time
from typing import Any

import numpy as np
import numpy.typing as npt

from cuboid import Tracker
from cuboid.frame import Float64Array, Frame, Intrinsics
from cuboid.measuring import peak_memory_mb
from cuboid.proposals import Proposals
from tables import cell, dump, show

CAMERA = Intrinsics(125.0, 125.0, 79.5, 59.5, 160, 120)
# Boxes of a place along and across, metres apart; looks at a place; places in a row, metres apart.
ALONG, ACROSS, GAP_M, LOOKS, ROW, APART_M = 6, 4, 0.27, 5, 20, 2.0
NOISE_PER_M = 1.4e-3
# Frames over which the median is taken.
WINDOW = 400


class Place:
    """Boxes on a floor, and what a camera sees of them from some places."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        x, y = np.meshgrid((np.arange(ALONG) - (ALONG - 1) / 2) * GAP_M, (np.arange(ACROSS) - 1.5) * GAP_M)
        middle = np.stack([x.ravel(), y.ravel()], 1) + self._rng.uniform(-0.03, 0.03, (ALONG * ACROSS, 2))
        half = self._rng.uniform(0.045, 0.065, (len(middle), 2))
        self._low = np.column_stack([middle - half, np.zeros(len(middle))])
        self._high = np.column_stack([middle + half, self._rng.uniform(0.08, 0.16, len(middle))])
        self._colors = self._rng.integers(40, 220, (len(middle) + 1, 3))

    def look(self, turn: float) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.uint8], Proposals, Float64Array]:
        """Return depth, color, proposals, and the pose in the place."""
        eye = np.array([0.6 * np.sin(turn), -0.9 * np.cos(turn), 1.35])
        forward = np.array([0.0, 0.1, 0.0]) - eye
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = np.stack([right, np.cross(forward, right), forward], 1), eye
        v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
        ray = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)], -1) @ T[:3, :3].T
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


def walk(objects: int, memory_mb: float, checkpoints: list[int]) -> list[dict[str, Any]]:
    """Walk until there are so many objects; return how things stand when there are as many as at each checkpoint."""
    now: list[Proposals] = []
    tracker = Tracker(CAMERA, proposals=lambda frame, camera: now[-1], memory_mb=memory_mb)
    times: list[float] = []
    rows, known, number, worst = [], 0, 0, 0.0
    waiting = sorted({*checkpoints, objects})
    while waiting:
        along, across = divmod(number // LOOKS, ROW)
        place = Place(number // LOOKS)
        for k in range(LOOKS):
            depth, color, proposals, T = place.look(0.12 * (k - LOOKS / 2))
            now[:] = [proposals]
            T[:3, 3] += APART_M * np.array([across if along % 2 == 0 else ROW - 1 - across, along, 0.0])
            begun_s = time.process_time()
            known = tracker.update(Frame(number, number / 30, color, depth, T)).objects_known
            times.append((time.process_time() - begun_s) * 1e3)
            worst = max(worst, times[-1]) if number > WINDOW // 4 else 0.0
            number += 1
        if known >= waiting[0]:
            waiting.pop(0)
            median = float(np.median(times[-WINDOW:]))
            rows.append(
                {
                    "objects": known, "frames": number, "points": tracker.points_known, "frame_ms": median,
                    "frame_max_ms": worst, "map_mb": tracker.map_bytes / 2**20, "memory_mb": peak_memory_mb(),
                }
            )  # fmt: skip
            worst = 0.0
            print(rows[-1], file=sys.stderr, flush=True)
    return rows


def run(args: argparse.Namespace) -> None:
    """Print the table, or all figures."""
    found = walk(max(args.objects), args.memory, [100, 300, 1000, 3000])
    if args.json:
        dump(found)
        return
    header = ("objects", "frames", "points", "ms a frame", "worst", "map MB in memory", "peak memory MB")
    names = ("frame_ms", "frame_max_ms", "map_mb", "memory_mb")
    lines = [[row["objects"], row["frames"], row["points"], *(cell(row[name], 1) for name in names)] for row in found]
    show(f"A walk with {args.memory:g} MB: median and worst frame since the row above", header, lines)
