"""Accuracy and time at full, half and quarter resolution, and with every pixel of a frame."""

from __future__ import annotations

import argparse
from typing import Any

from cuboid.ground.core.config import TrackerConfig
from cuboid.runs.pipeline.options import TrackOptions
from scenes import SIZE, cases
from scoring import mean, run_and_score, total
from tables import cell, dump, show

# Full resolution is the default, which thins a frame to 320 x 240, another phase each time; `every pixel` does not.
SETTINGS: dict[str, dict[str, Any]] = {
    "every pixel": {"config": TrackerConfig(working_width_px=SIZE[0])},
    "full": {},
    "half": {"scale": 2},
    "quarter": {"scale": 4},
}
HEADER = (
    "resolution",
    "recall .5",
    "precision .5",
    "mean IoU",
    "centre cm",
    "HOTA",
    "IDF1 .25",
    "switches",
    "fragments",
    "ms a frame",
    "p95",
    "of it tracking",
)
# Stages that are not the tracker's.
AROUND = ("decode", "scale", "write")


def run(args: argparse.Namespace) -> None:
    """Print the table, or all figures."""
    folder = args.work / "runs" / "resolution"
    chosen = cases(args.kinds, args.seeds, args.work, args.data)
    found = {
        name: [
            run_and_score(case, folder / name / case.name, TrackOptions(every=args.every, limit=args.limit, **options))
            for case in chosen
        ]
        for name, options in SETTINGS.items()
    }
    if args.json:
        dump(found)
        return
    lines = []
    for name, rows in found.items():
        for row in rows:
            row["ms_tracking"] = sum(time for stage, time in row["ms_stages"].items() if stage not in AROUND)
        names = ("recall_50", "precision_50", "mean_iou", "center_cm", "hota", "idf1_25")
        lines.append(
            [
                name,
                *(mean(rows, key) for key in names),
                total(rows, "switches"),
                total(rows, "fragments"),
                *(cell(mean(rows, key), 1) for key in ("ms_frame", "ms_frame_p95", "ms_tracking")),
            ]
        )
    show(f"Resolution, over {', '.join(case.name for case in chosen)}", HEADER, lines)
