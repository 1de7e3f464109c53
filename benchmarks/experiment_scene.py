"""What a scene file costs: to open a large one again, and to write one while a recording is tracked.

The large one is made: a camera goes past boxes on a floor, as in `memory`, until there are a million points and 500
objects. It is opened as `cuboid track --scene` does for another recording, up to where the first frame is taken.
With `--data`, frames of scene 01 are tracked with and without a scene, by turns.
"""

from __future__ import annotations

import argparse
import time
from multiprocessing import Pipe, get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from cuboid import open_recording
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.method.proposals import Proposals
from cuboid.runs.scene import RecordingInfo, Scene
from cuboid.runs.tracking.posed_tracker import PosedTracker
from experiment_memory import CAMERA, places_in_rows
from scenes import scene_01
from tables import cell, dump, show

# Rows of boxes in a place: with one, a million points are about 500 objects.
POINTS, OBJECTS, ROWS = 1_000_000, 500, 1
TIMES = 5
# Frames of scene 01, unless `--limit` says otherwise.
FRAMES = 300
# The first frames load and compile.
WARM = 10


def make(path: Path) -> None:
    """Make the large scene."""
    shown: list[Proposals] = []
    with Scene.open(path) as scene:
        tracker = scene.tracker(CAMERA, proposals=lambda frame, camera: shown[-1], commit_every_s=30.0)
        for frames in places_in_rows(shown, ROWS):
            for frame in frames:
                tracker.update(frame)
            if tracker.points_known >= POINTS and len(tracker.objects) >= OBJECTS:
                break


def reopened(path: Path) -> dict[str, Any]:
    """Return how long the large scene takes to be opened for another recording, seconds, and the best of all."""
    wall_s, processor_s = [], []
    for _ in range(TIMES):
        begun = time.perf_counter(), time.process_time()
        scene = Scene.open(path)
        tracker = scene.tracker(CAMERA)
        wall_s.append(time.perf_counter() - begun[0])
        processor_s.append(time.process_time() - begun[1])
        found = {"points": tracker.points_known, "objects": len(tracker.tracker.ever_labelled())}
        tracker.drop()
        scene.close()
    sides = {"wall_s": wall_s, "processor_s": processor_s}
    return {
        **found,
        "file_mb": path.stat().st_size / 2**20,
        **{f"{name}_median": float(np.median(times)) for name, times in sides.items()},
        **{f"{name}_least": min(times) for name, times in sides.items()},
    }


def beside(args: argparse.Namespace) -> list[dict[str, Any]]:
    """Return processor time a frame of scene 01, with a scene and without: that of the tracker's thread, and of all.

    By turns, each in a process of its own: what else the machine does is the same for both. What is written while it is
    the other one's turn counts for the frame that comes.
    """
    recording = open_recording(scene_01(args.data).recording)
    frames = [recording.read(k) for k in range(min(args.limit or FRAMES, len(recording)))]
    path = _fresh(args.work / "scenes" / "beside.cuboid")
    here, there = Pipe()
    other = get_context("fork").Process(target=_without, args=(there, recording.intrinsics, frames), daemon=True)
    other.start()
    times: dict[str, list[tuple[float, float]]] = {"without a scene": [], "with a scene": []}
    with Scene.open(path) as scene:
        source = RecordingInfo("/scene-01", "made", "given", len(frames), recording.intrinsics, {})
        tracker = scene.tracker(recording.intrinsics, source=source)
        before_s = time.process_time()
        for frame in frames:
            here.send(None)
            times["without a scene"].append(here.recv())
            begun_s = time.thread_time()
            tracker.update(frame)
            times["with a scene"].append((time.thread_time() - begun_s, time.process_time() - before_s))
            before_s = time.process_time()
    other.join()
    return [_times(name, np.array(of_frames) * 1e3) for name, of_frames in times.items()]


def _without(turns: Connection, intrinsics: Intrinsics, frames: list[Frame]) -> None:
    """Track frames without a scene, one at each turn, and tell how long each took."""
    tracker = PosedTracker(intrinsics)
    for frame in frames:
        turns.recv()
        begun = time.thread_time(), time.process_time()
        tracker.update(frame)
        turns.send((time.thread_time() - begun[0], time.process_time() - begun[1]))


def _times(name: str, ms: np.ndarray[tuple[int, int], np.dtype[np.float64]]) -> dict[str, Any]:
    found: dict[str, Any] = {"scene 01": name}
    for threads, column in zip(("", " of all threads"), ms[WARM:].T, strict=True):
        found |= {
            f"median{threads}": float(np.median(column)),
            f"p99{threads}": float(np.percentile(column, 99)),
            f"mean{threads}": float(column.mean()),
        }
    return found


def _fresh(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    for left in path.parent.glob(f"{path.name}*"):
        left.unlink()
    return path


def run(args: argparse.Namespace) -> None:
    """Print the tables, or all figures."""
    path = args.work / "scenes" / "large.cuboid"
    if not path.exists():
        make(_fresh(path.with_suffix(".partial")))
        path.with_suffix(".partial").rename(path)
    found = {"reopened": reopened(path), "beside": beside(args) if args.data else []}
    if args.json:
        dump(found)
        return
    one = found["reopened"]
    show("A large scene until the first frame is taken", list(one), [[cell(value, 2) for value in one.values()]])
    if args.data:
        rows = found["beside"]
        show(
            "Milliseconds a frame",
            list(rows[0]),
            [[r["scene 01"], *(cell(r[k], 1) for k in list(r)[1:])] for r in rows],
        )
