"""Whether more frames make better boxes: the map after so many frames, and that of every n-th frame."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from cuboid import open_recording
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.results import FrameResult
from cuboid.ground.geometry.overlap import pack
from cuboid.lab.evaluation import evaluate
from cuboid.lab.evaluation.figures import figures
from cuboid.lab.evaluation.result import BoxRows, MapBoxes, Result
from cuboid.runs.pipeline.options import RunHooks, TrackOptions
from cuboid.runs.pipeline.run import track_recording
from cuboid.runs.tracking.posed_tracker import PosedTracker
from cuboid.runs.tracking.types import Progress
from scenes import Case, cases
from scoring import mean, total
from tables import dump, show

COUNTS = (10, 20, 40, 80, 160, 320, 640)
STEPS = (16, 8, 4, 2, 1)
NO_TRACKS = BoxRows(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 15)))


class _Snapshots(Progress):
    """Keeps the map as it is after some frames, and makes the tracker whose map it is."""

    def __init__(self, counts: tuple[int, ...]) -> None:
        self.maps: dict[int, MapBoxes] = {}
        self._counts = counts
        self._done = 0
        self._tracker: PosedTracker | None = None

    def make(self, intrinsics: Intrinsics, config: TrackerConfig, proposals: Any) -> PosedTracker:
        self._tracker = PosedTracker(intrinsics, config, proposals)
        return self._tracker

    def frame(self, result: FrameResult) -> None:
        self._done += 1
        if self._done in self._counts:
            self.keep()

    def keep(self) -> None:
        assert self._tracker is not None
        known = self._tracker.objects
        self.maps[self._done] = MapBoxes(
            np.array([item.label for item in known], np.int64),
            pack([item.box for item in known]),
            np.array([item.score for item in known], np.float64),
        )


def snapshots(case: Case, counts: tuple[int, ...], every: int) -> list[dict[str, Any]]:
    """Return figures of the map after so many frames, each against what those frames must have shown.

    `mean_iou_same` is of the objects that every one of these maps has.
    """
    watch = _Snapshots(counts)
    track_recording(
        open_recording(case.recording),
        None,
        TrackOptions(every=every),
        hooks=RunHooks(progress=watch, make_tracker=watch.make),
    )
    watch.keep()
    rows, ious = [], []
    for count, boxes in sorted(watch.maps.items()):
        frames = np.arange(0, count * every, every)
        found = evaluate(Result(case.recording, NO_TRACKS, boxes, frames=frames), case.truth)
        rows.append({"scene": case.name, "used": count, **figures(found)})
        ious.append({item.id: item.box.iou for item in found.objects if item.box is not None})
    same = set.intersection(*(set(one) for one in ious[1:])) if len(ious) > 1 else set()
    for row, one in zip(rows, ious, strict=True):
        row["mean_iou_same"] = float(np.mean([one[k] for k in same])) if same <= set(one) and same else None
    return rows


def run(args: argparse.Namespace) -> None:
    """Print the tables, or all figures."""
    chosen = cases(args.kinds, args.seeds, args.work, args.data)
    after = [row for case in chosen for row in snapshots(case, COUNTS, args.every)]
    steps = [{"step": step, **snapshots(case, (), step)[-1]} for step in STEPS for case in chosen]
    if args.json:
        dump({"after": after, "every": steps})
        return
    names = ", ".join(case.name for case in chosen)
    header = (
        "frames",
        "scenes",
        "objects seen",
        "recall .25",
        "recall .5",
        "precision .5",
        "mean IoU",
        "of the same objects",
        "centre cm",
    )
    keys = ("recall_25", "recall_50", "precision_50", "mean_iou", "mean_iou_same", "center_cm")
    groups = {count: [row for row in after if row["used"] == count] for count in COUNTS}
    lines = [
        [count, len(rows), total(rows, "objects"), *(mean(rows, key) for key in keys)]
        for count, rows in groups.items()
        if rows
    ]
    show(f"The map after the first frames, over {names}", header, lines)
    keys = ("recall_25", "recall_50", "precision_50", "mean_iou", "center_cm")
    lines = [
        [f"every {step}", round(mean(rows, "used") or 0), *(mean(rows, key) for key in keys), total(rows, "fragments")]
        for step in STEPS
        for rows in [[row for row in steps if row["step"] == step]]
    ]
    header = ("frames", "used a scene", "recall .25", "recall .5", "precision .5", "mean IoU", "centre cm", "fragments")
    show(f"The map at the end of the whole way, over {names}", header, lines)
