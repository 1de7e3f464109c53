"""Time of a correction of poses, and of the frame after it, as the map grows: of all keyframes, and of the newest.

A camera goes from table to table as in `growth`, a keyframe a lap; `--laps` is how many tables there are.
"""

from __future__ import annotations

import argparse
import sys
import time
from typing import Any

import numpy as np

from cuboid import Frame
from cuboid.ground.geometry import se3
from cuboid.runs.tracking.posed_tracker import PosedTracker
from experiment_growth import SCENE, Lap
from scenes import made
from tables import cell, dump, show

# Corrections at each checkpoint, by turns of all keyframes and of the newest; millimetres and milliradians.
TIMES, SIZE = 6, 0.005
# Laps at which poses are corrected.
LAPS = (2, 7, 20, 60, 180, 600)
HEADER = (
    "points of the map",
    "planes",
    "objects",
    "all keyframes ms",
    "of them the planes",
    "the newest ms",
    "the frame after all ms",
    "another frame ms",
)


def run(args: argparse.Namespace) -> None:
    """Print the table, or all figures."""
    laps = min(args.laps, LAPS[-1])
    lap = Lap(made(SCENE, args.work).recording, laps)
    tracker, rows = PosedTracker(lap.intrinsics), []
    for number in range(laps):
        for frame in lap.frames(number, number * len(lap.frames(0, 0))):
            tracker.update(frame, number + 1)
        if number + 1 in LAPS:
            rows.append(_corrected(tracker, number + 1, frame))
            print(f"{rows[-1]['points']} points: {rows[-1]['all_ms']:.0f} ms", file=sys.stderr, flush=True)
    if args.json:
        dump(rows)
        return
    lines = [
        [
            row["points"],
            row["planes"],
            row["objects"],
            *(cell(row[f"{name}_ms"], 0) for name in ("all", "planes", "new", "after", "another")),
        ]
        for row in rows
    ]
    show("Corrections of poses: median of processor time", HEADER, lines)


def _corrected(tracker: PosedTracker, keyframes: int, frame: Frame) -> dict[str, Any]:
    rng = np.random.default_rng(keyframes)
    found: dict[str, list[float]] = {"all": [], "new": [], "planes": [], "after": [], "another": []}
    carry, points = tracker._planes.apply_correction, tracker.points_known

    def planes_correction(*given: Any) -> None:
        begun_s = time.process_time()
        carry(*given)
        found["planes"].append(1e3 * (time.process_time() - begun_s))

    tracker._planes.apply_correction = planes_correction  # type: ignore[method-assign]
    for _ in range(TIMES):
        for name, moving in (("all", range(1, keyframes + 1)), ("new", (keyframes,))):
            moved = {k: se3.exp(rng.normal(0, SIZE, 6)) for k in moving}
            begun_s = time.process_time()
            tracker.apply_correction(moved)
            found[name].append(1e3 * (time.process_time() - begun_s))
            for which in ("after", "another") if name == "all" else ():
                begun_s = time.process_time()
                tracker.update(frame, keyframes)
                found[which].append(1e3 * (time.process_time() - begun_s))
    tracker._planes.apply_correction = carry  # type: ignore[method-assign]
    found["planes"] = found["planes"][::2]
    return {
        "points": points,
        "planes": len(tracker.planes),
        "objects": len(tracker.objects),
        **{f"{name}_ms": float(np.median(times)) for name, times in found.items()},
    }
