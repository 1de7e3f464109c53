"""Time of each stage, and memory, as the map grows and as time goes on.

The first frames of a made table are tracked again and again. In the first run all laps are at the same place, so that
time alone goes on: `--limit 100000` is an hour of video. In the second run each lap is at a new place of one large
floor, 3 m from the last one, so that points, objects, planes and the area of the floor grow: 1,667 laps make 10,000
objects; 0 laps leave it out.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cuboid import open_recording
from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.frame import Frame
from cuboid.lab.evaluation.truth import NAME as TRUTH
from cuboid.runs.tracking.measuring import peak_memory_mb
from cuboid.runs.tracking.posed_tracker import PosedTracker
from scenes import MadeScene, made
from scoring import processor_time
from tables import cell, dump, show

LAP_FRAMES, APART_M = 24, 3.0
SCENE = MadeScene("table", 2, frames=LAP_FRAMES, size=(320, 240))
# Laps over which times are taken, but for the worst frame: that is the worst since the checkpoint before.
WINDOW_LAPS = 5
STAGES = ("proposals", "planes", "heat", "fuse", "boxes", "map", "matching")


class Lap:
    """The frames of a lap, kept in memory, at any place."""

    def __init__(self, folder: Path, places: int) -> None:
        recording = open_recording(folder)
        self.intrinsics = recording.intrinsics
        self._frames = [recording.read(k) for k in range(LAP_FRAMES)]
        normal = np.array(json.loads((folder / TRUTH).read_text(encoding="utf-8"))["planes"][0]["normal"])
        self._along = np.linalg.svd(normal[None])[2][1:]
        self._side = max(1, math.ceil(math.sqrt(places)))

    def frames(self, place: int, first: int) -> list[Frame]:
        """Return the frames at a place of the plane, numbered from `first`; laps go forth and back by turns."""
        row, column = divmod(place, self._side)
        column = column if row % 2 == 0 else self._side - 1 - column
        T = np.eye(4)
        T[:3, 3] = APART_M * (np.array([row, column]) @ self._along)
        return [
            replace(frame, index=first + k, T_world_camera=T @ _pose(frame)) for k, frame in enumerate(self._frames)
        ]


def _pose(frame: Frame) -> Float64Array:
    assert frame.T_world_camera is not None
    return frame.T_world_camera


def grow(lap: Lap, laps: int, places: int, checkpoints: list[int]) -> list[dict[str, Any]]:
    """Track laps at so many places; return times over the laps before each checkpoint."""
    tracker = PosedTracker(lap.intrinsics)
    times: list[dict[str, float]] = []
    rows, begun, worst = [], time.perf_counter(), 0.0
    for number in range(laps):
        for frame in lap.frames(number % places, number * LAP_FRAMES):
            start = time.process_time()
            with processor_time():
                result = tracker.update(frame)
            took = (time.process_time() - start) * 1e3
            worst = max(worst, took)
            times.append({"frame": took, **result.milliseconds})
        times = times[-WINDOW_LAPS * LAP_FRAMES :]
        if number + 1 in checkpoints:
            state = {"frame_max_ms": worst, "seconds": time.perf_counter() - begun}
            rows.append(_state(tracker, number + 1, times) | state)
            told = "{frames} frames, {objects} objects: {frame_ms:.1f} ms a frame, worst {frame_max_ms:.0f} ms"
            print(told.format(**rows[-1]), file=sys.stderr, flush=True)
            worst = 0.0
    return rows


def _state(tracker: PosedTracker, laps: int, times: list[dict[str, float]]) -> dict[str, Any]:
    return {
        "laps": laps,
        "frames": laps * LAP_FRAMES,
        "objects": len(tracker.objects),
        "planes": len(tracker.planes),
        "points": tracker.points_known,
        "frame_ms": float(np.median([t["frame"] for t in times])),
        "frame_p95_ms": float(np.percentile([t["frame"] for t in times], 95)),
        **{f"{stage}_ms": float(np.mean([t[stage] for t in times])) for stage in STAGES},
        "memory_mb": peak_memory_mb(),
    }


def _checkpoints(laps: int) -> list[int]:
    """Return WINDOW_LAPS, two steps to each ten times as many, and the last lap."""
    steps = [math.ceil(WINDOW_LAPS * 10 ** (k / 2)) for k in range(20)]
    return [*(step for step in steps if step < laps), laps]


def run(args: argparse.Namespace) -> None:
    """Print the tables, or all figures."""
    folder = made(SCENE, args.work).recording
    laps = args.laps
    again = max(1, (args.limit or laps * LAP_FRAMES) // LAP_FRAMES)
    grow(Lap(folder, 1), 1, 1, [])  # so that no time has the compiling of loops in it
    found = {
        "the same table": grow(Lap(folder, 1), again, 1, _checkpoints(again)),
        "a new table each lap": grow(Lap(folder, max(1, laps)), laps, max(1, laps), _checkpoints(laps)),
    }
    if args.json:
        dump(found)
        return
    header = ("frames", "objects", "planes", "points of the map", "ms a frame", "p95", "worst", *STAGES, "memory MB")
    for title, rows in found.items():
        lines = [
            [
                row["frames"],
                row["objects"],
                row["planes"],
                row["points"],
                *(cell(row[name], 1) for name in ("frame_ms", "frame_p95_ms", "frame_max_ms")),
                *(cell(row[f"{stage}_ms"], 1) for stage in STAGES),
                cell(row["memory_mb"], 0),
            ]
            for row in rows
        ]
        show(f"Growth with {title}: median, p95, worst; stages are means", header, lines)
