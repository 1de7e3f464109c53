"""A scene of a made world, in a second."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.results import FrameResult, TrackedObject
from cuboid.method.proposals.types import Proposals
from cuboid.runs.scene import RecordingInfo, Scene
from made_scenes import cast, look_at, upright
from worlds import FLOOR, TABLE

CAMERA = Intrinsics(136.0, 136.0, 79.5, 59.5, 160, 120)
THINGS = (
    upright((-0.2, 0.0), (0.16, 0.12, 0.14), 0.3, z=0.48),
    upright((0.08, 0.14), (0.12, 0.12, 0.2), 0.0, z=0.48),
)


class Shown:
    """Frames of a camera that goes round a table, and the masks of what stands on it."""

    def __init__(self, things: tuple = THINGS, frames: int = 16, begin: float = 0.0) -> None:
        self.frames, self._hits = [], []
        for k in range(frames):
            turn = begin + 0.06 * k
            eye = [1.2 * np.cos(turn) + 0.1, 1.2 * np.sin(turn) + 0.2, 1.25]
            T = look_at(eye, [0.1, 0.15, 0.5])
            boxes = [FLOOR, TABLE, *things]
            depth, hit = cast(boxes, T, CAMERA)
            color = ((hit[..., None] * np.array([53, 97, 31]) + 90) % 256).astype(np.uint8)
            self.frames.append(Frame(k, k / 30, color, depth.astype(np.float32), T))
            self._hits.append(hit)

    def proposals(self, frame: Frame, _: object) -> Proposals:
        hit = self._hits[frame.index]
        masks = [hit == k for k in np.unique(hit[hit >= 2])]
        spans = [(np.flatnonzero(m.any(0)), np.flatnonzero(m.any(1))) for m in masks]
        boxes = [(c[0], r[0], c[-1] + 1, r[-1] + 1) for c, r in spans]
        cut = tuple(m[y0:y1, x0:x1].astype(np.uint8) for m, (x0, y0, x1, y1) in zip(masks, boxes, strict=True))
        return Proposals(np.array(boxes, np.int32).reshape(-1, 4), np.full(len(boxes), 0.9, np.float32), cut)


def record(
    path: Path,
    shown: Shown,
    name: str = "made",
    *,
    frames: list[Frame] | None = None,
    detector: Any = None,
    detector_every: int = 3,
    **options: Any,
) -> tuple[list[TrackedObject], FrameResult]:
    """Track a recording into a scene, by default all frames; return its objects and its last result."""
    frames = shown.frames if frames is None else frames
    source = RecordingInfo(f"/{name}", "made", "given", len(frames), CAMERA, {"every": 1})
    with Scene.open(path) as scene:
        tracker = scene.tracker(CAMERA, **{"proposals": shown.proposals, "source": source, **options})
        tracker.use_detector(detector, detector_every)
        last = [tracker.update(frame) for frame in frames][-1]
        return tracker.objects, last


def change(path: Path, query: str, *values: object) -> None:
    """Change a scene file as no program does."""
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        connection.execute("PRAGMA ignore_check_constraints = ON")
        assert connection.execute(query, values).rowcount != 0


def ask(path: Path) -> None:
    """Ask all that a scene tells."""
    with Scene.open(path) as scene:
        for one in scene.recordings:
            scene.poses(one.number)
        for item in scene.all_objects:
            scene.history(item.label)
            scene.picture(item.label)
        scene.near((0.0, 0.0, 0.5), 1.0)
        scene.changes(1)
