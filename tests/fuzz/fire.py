"""The tracker under fire: ``python tests/fuzz/fire.py [--sequences N] [--frames N] [--first SEED]``.

Each hostile sequence goes through a tracker of its own, some with other settings than the usual ones; now and then
poses are corrected. After every frame all that must hold is looked at: no exception, boxes finite and of sizes above 0,
rotations proper, no object larger than it may be, labels that only grow and are never reused, no point of an object
that is no more, and no frame, and no correction of poses, that takes longer than its time.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

from hostile import hostile  # noqa: E402

from cuboid.ground.core.config import TrackerConfig  # noqa: E402
from cuboid.ground.core.errors import FrameError  # noqa: E402
from cuboid.ground.core.frame import Intrinsics  # noqa: E402
from cuboid.ground.geometry import se3  # noqa: E402
from cuboid.runs.tracking.posed_tracker import PosedTracker  # noqa: E402
from worlds import Watch  # noqa: E402

# Seconds of one core that a frame may take, the first ones of a process left out: these load the kernels. What other
# programs do to the core's caches is no frame's fault: a sequence with a slow frame is taken so many times more, and
# the frame is slow if it was each time.
FRAME_S = 0.5
AGAIN = 2
FRAME, CORRECTION = "a frame", "a correction of poses"
# Frames that hang on one keyframe, and how often poses are corrected.
KEYFRAME_EVERY, CORRECTED = 8, 0.03
# Seeds of the settings begin here.
SETTINGS = 1_000_000
# A sequence with many objects, which meets all kernels.
MANY_OBJECTS = 38
# Slowest frames that are told of.
MAX_SLOWEST = 5


@dataclass
class Fired:
    """What came of some sequences.

    Attributes
    ----------
    sequences, frames, refused, labels : int
        `refused`: frames whose pose is none.
    faults : dict of str to int
        By what is wrong, and where; the first sequence of each in `first`, the latest in `latest`.
    slowest : dict of str to list of (float, str)
        Of frames, and of corrections of poses: seconds, and which.
    slow : dict of (str, str) to float
        What of this sequence took too long, which frame it was, and how long.
    """

    sequences: int = 0
    frames: int = 0
    refused: int = 0
    labels: int = 0
    faults: Counter[str] = field(default_factory=Counter)
    first: dict[str, str] = field(default_factory=dict)
    latest: dict[str, str] = field(default_factory=dict)
    slowest: dict[str, list[tuple[float, str]]] = field(default_factory=lambda: {FRAME: [], CORRECTION: []})
    slow: dict[tuple[str, str], float] = field(default_factory=dict)

    def fault(self, what: str, where: str) -> None:
        self.faults[what] += 1
        self.first.setdefault(what, where)
        self.latest[what] = where

    def took(self, what: str, seconds: float, where: str) -> None:
        self.slowest[what] = sorted([*self.slowest[what], (seconds, where)], reverse=True)[:MAX_SLOWEST]
        if seconds > FRAME_S:
            self.slow[what, where] = seconds

    def judge(self, again: Callable[[Fired], None]) -> None:
        """Take the frames that were slow for faults, those that are not slow again left out."""
        for _ in range(AGAIN):
            if self.slow:
                other = Fired()
                again(other)
                self.slow = {one: min(s, other.slow[one]) for one, s in self.slow.items() if one in other.slow}
        for (what, where), seconds in self.slow.items():
            self.fault(f"{what} took more than {FRAME_S:g} s", f"{where}: {seconds:.2f} s")
        self.slow = {}


def load_kernels() -> None:
    """Let no frame and no correction pay for what is done once in a process."""
    sequence = hostile(MANY_OBJECTS, (320, 240))
    tracker = PosedTracker(sequence.intrinsics)
    for item in sequence.frames(50):
        if item.frame is not None:
            tracker.update(item.frame, 1 + item.frame.index // (2 * KEYFRAME_EVERY))
    tracker.apply_correction({1: se3.exp(np.full(6, 0.01))})
    tracker.apply_correction({keyframe: se3.exp(np.full(6, 0.01)) for keyframe in range(KEYFRAME_EVERY)})


def fire(seed: int, frames: int, fired: Fired, size: tuple[int, int] | None = None) -> None:
    """Let a tracker take a sequence, and note what is wrong with it."""
    _take(seed, frames, fired, size)
    fired.judge(lambda other: _take(seed, frames, other, size))


def _take(seed: int, frames: int, fired: Fired, size: tuple[int, int] | None) -> None:
    """Let a tracker take a sequence, and note what is wrong with it; its end is the first fault but for slowness."""
    sequence, rng = hostile(seed, size), np.random.default_rng(SETTINGS + seed)
    tracker = PosedTracker(sequence.intrinsics, _settings(rng))
    watch = Watch(tracker)
    fired.sequences += 1
    for number, item in enumerate(sequence.frames(frames)):
        where = f"seed {seed}, frame {number} ({item.kind}, {_size(sequence.intrinsics)})"
        if item.frame is None:
            fired.refused += 1
            continue
        keyframe, moved = 1 + number // KEYFRAME_EVERY, {}
        if rng.random() < CORRECTED:
            moved = _correction(rng, keyframe)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                begun_s = time.thread_time()
                if moved:
                    tracker.apply_correction(moved)
                    fired.took(CORRECTION, time.thread_time() - begun_s, where)
                    begun_s = time.thread_time()
                result = tracker.update(item.frame, keyframe)
                fired.took(FRAME, time.thread_time() - begun_s, where)
            fired.frames += 1
            watch.result(item.frame, result)
            watch.check_map()
        except FrameError:
            fired.refused += 1
        except Exception as error:
            at = traceback.extract_tb(error.__traceback__)[-1]
            line = " ".join(str(error).split())[:60]
            fired.fault(f"{type(error).__name__} at {Path(at.filename).name}:{at.lineno}: {line}", where)
            break
    fired.labels += watch.labelled


def _settings(rng: np.random.Generator) -> TrackerConfig:
    """Return settings: mostly the usual ones."""
    return TrackerConfig(
        max_size_m=float(rng.choice((1.0, 1.0, 0.3))),
        voxel_m=float(rng.choice((0.01, 0.01, 0.02))),
        min_size_m=float(rng.choice((0.03, 0.03, 0.01))),
    )


def _correction(rng: np.random.Generator, keyframes: int) -> dict[int, np.ndarray]:
    """Return how some keyframes move, by millimetres or by metres."""
    size = rng.choice((0.005, 0.05, 2.0))
    return {int(k): se3.exp(rng.normal(size=6) * size) for k in rng.integers(1, keyframes + 1, 3)}


def _size(camera: Intrinsics) -> str:
    return f"{camera.width} x {camera.height}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sequences", type=int, default=1000)
    parser.add_argument("--frames", type=int, default=100, help="of each sequence (default: %(default)s)")
    parser.add_argument("--first", type=int, default=0, help="seed of the first sequence (default: %(default)s)")
    parser.add_argument("--size", help="WIDTHxHEIGHT of all images; drawn for each sequence unless given")
    args = parser.parse_args()
    size = tuple(map(int, args.size.split("x"))) if args.size else None
    load_kernels()
    fired, begun_s = Fired(), time.perf_counter()
    for seed in range(args.first, args.first + args.sequences):
        before = dict(fired.faults)
        fire(seed, args.frames, fired, size)
        for fault in sorted(fault for fault, n in fired.faults.items() if n > before.get(fault, 0)):
            print(f"  {fault}: {fired.latest[fault]}", flush=True)
        if fired.sequences % 10 == 0 or fired.sequences == args.sequences:
            print(_line(fired, time.perf_counter() - begun_s), flush=True)
    print(json.dumps({"faults": fired.faults, "first": fired.first, "slowest_s": fired.slowest}, indent=1))
    return 1 if fired.faults else 0


def _line(fired: Fired, seconds: float) -> str:
    slowest = ", ".join(f"{what} {rows[0][0]:.2f} s" for what, rows in fired.slowest.items() if rows)
    return (
        f"{fired.sequences} sequences, {fired.frames} frames, {fired.refused} without a pose, {fired.labels} labels, "
        f"{sum(fired.faults.values())} faults, slowest: {slowest}; {seconds:.0f} s"
    )


if __name__ == "__main__":
    sys.exit(main())
