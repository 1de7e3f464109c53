"""Boxes in the map of each scene of the suite and of scene 01, beside the objects that are there."""

from __future__ import annotations

import argparse

from cuboid.ground.core.config import TrackerConfig
from cuboid.lab.synthetic import KINDS
from scenes import MadeScene, scene_01
from scoring import mean, run_and_score, total
from suite import SEEDS, Settings, run_suite
from tables import cell, dump, show

# Pahwa, Ng and Do 2017, over the 14 scenes of RGB-D Scenes v2.
PAPER = 6.57
HEADER = ("scenes", "number", "objects a scene", "boxes a scene", "of them false", "fragments", "merges")


def run(args: argparse.Namespace) -> None:
    """Print the table, or all figures."""
    scenes = [MadeScene(kind, seed) for kind in KINDS for seed in SEEDS]
    rows = run_suite(scenes, Settings("given", 1, 1, None, TrackerConfig()), args.work, args.jobs)
    groups = {kind: [row for row in rows if row["kind"] == kind] for kind in KINDS} | {"all made": rows}
    if args.data is not None:
        case = scene_01(args.data)
        groups["RGB-D Scenes v2, scene 01"] = [run_and_score(case, args.work / "runs" / "proposals" / "01")]
    if args.json:
        dump(groups)
        return
    lines = [
        [
            name,
            len(some),
            *(cell(mean(some, key), 2) for key in ("objects", "proposals", "false_alarms")),
            *(total(some, key) for key in ("fragments", "merges")),
        ]
        for name, some in groups.items()
    ]
    show(f"Boxes in the map at the end (the paper: {PAPER} a scene of RGB-D Scenes v2)", HEADER, lines)
