"""Recordings and copies of them that show the same things: the objects that both give.

python benchmarks/copies.py RECORDING ... [--copies NAME ...] [--limit N] [--jobs N]

Tracks each recording with given poses, and copies of it:

- rolled: the images are turned by 180 degrees, and the poses with them.
- moved: the world of the poses is turned and moved.
- recolored: red, green and blue are exchanged.
- doubled: each frame comes twice, the second one at half the time to the next one.
- halved: every second frame.

Prints the number of objects of the recording, of the copy, and of both: pairs of boxes with an IoU of 0.5 or more, one
to one, in the world of the recording. Where both give the same objects, the three numbers are equal.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np

from cuboid import CuboidError, Tracker, open_recording
from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.threads import limit_threads
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.overlap import iou_matrix, pack
from cuboid.lab.evaluation.matching import match
from cuboid.runs.tracking.rolling import Roll
from tables import markdown

# IoU of two boxes of the same thing.
SAME_IOU = 0.5
# Turns by 90 degrees of rolled images.
TURNS = 2
HEADER = ("recording", "copy", "objects", "of the copy", "both")


def T_copy_world() -> Float64Array:
    """Return the motion of the world of a moved copy (4, 4): a turn about each axis, and some metres."""
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = turn * np.linalg.det(turn), [3.1, -7.3, 11.7]
    return T


def original(frames: list[Frame], camera: Intrinsics) -> tuple[Iterator[Frame], Intrinsics]:
    """Return the frames as they are."""
    return iter(frames), camera


def rolled(frames: list[Frame], camera: Intrinsics) -> tuple[Iterator[Frame], Intrinsics]:
    """Return the frames with images turned by 180 degrees."""
    roll = Roll(camera, TURNS)
    return (roll.frame(one) for one in frames), roll.camera


def moved(frames: list[Frame], camera: Intrinsics) -> tuple[Iterator[Frame], Intrinsics]:
    """Return the frames with poses in another world."""
    T = T_copy_world()
    return (replace(one, T_world_camera=T @ one.T_world_camera) for one in frames), camera


def recolored(frames: list[Frame], camera: Intrinsics) -> tuple[Iterator[Frame], Intrinsics]:
    """Return the frames with exchanged color channels."""
    return (replace(one, color=np.ascontiguousarray(one.color[..., [1, 2, 0]])) for one in frames), camera


def doubled(frames: list[Frame], camera: Intrinsics) -> tuple[Iterator[Frame], Intrinsics]:
    """Return each frame twice."""

    def twice() -> Iterator[Frame]:
        for k, one in enumerate(frames):
            after = frames[min(k + 1, len(frames) - 1)]
            yield replace(one, index=2 * k)
            yield replace(one, index=2 * k + 1, timestamp_s=0.5 * (one.timestamp_s + after.timestamp_s))

    return twice(), camera


def halved(frames: list[Frame], camera: Intrinsics) -> tuple[Iterator[Frame], Intrinsics]:
    """Return every second frame."""
    return iter(frames[::2]), camera


COPIES: dict[str, Callable[[list[Frame], Intrinsics], tuple[Iterator[Frame], Intrinsics]]] = {
    copy.__name__: copy for copy in (original, rolled, moved, recolored, doubled, halved)
}


def boxes_of(path: Path, name: str, limit: int | None) -> list[Box]:
    """Return the boxes of the objects of a copy, in the world of the recording."""
    limit_threads(1)
    recording = open_recording(path)
    frames, camera = COPIES[name](list(recording.iterate(limit=limit)), recording.intrinsics)
    tracker = Tracker(camera)
    for frame in frames:
        tracker.update(frame)
    boxes = [item.box for item in tracker.objects]
    if name == moved.__name__:
        T_world_copy = np.linalg.inv(T_copy_world())
        boxes = [box.moved(T_world_copy) for box in boxes]
    return boxes


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", nargs="+", type=Path, metavar="RECORDING", help="folders with given poses")
    names = [name for name in COPIES if name != original.__name__]
    parser.add_argument("--copies", nargs="+", choices=names, default=names, metavar="NAME", help="default: all")
    parser.add_argument("--limit", type=int, default=None, metavar="N", help="frames of each recording")
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)), metavar="N", help="processes")
    args = parser.parse_args()
    calls = [(path, name) for path in args.recordings for name in (original.__name__, *args.copies)]
    try:
        with ProcessPoolExecutor(args.jobs) as pool:
            paths, copies = zip(*calls, strict=True)
            found = dict(zip(calls, pool.map(boxes_of, paths, copies, [args.limit] * len(calls)), strict=True))
    except CuboidError as error:
        print(f"copies: {error}", file=sys.stderr)
        return 2
    rows = []
    for path, name in calls:
        own, others = found[path, original.__name__], found[path, name]
        if name != original.__name__:
            both = len(match(iou_matrix(pack(own), pack(others)), SAME_IOU)) if own and others else 0
            rows.append((path.name, name, len(own), len(others), both))
    print(markdown(HEADER, rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
