"""The suite: four scenes of each of six kinds with the noise of a structured-light sensor, and their figures.

python benchmarks/suite.py --work DIR [--jobs N] [--short] [--json]

DIR keeps the made recordings, the results (a folder of `cuboid track` a scene) and a JSON file of figures a scene. Run
again, it takes up where it was left: a scene is tracked anew only when the program's source, the settings or the
recording have changed. `--jobs` tracks so many scenes at a time, each on one core.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import sys
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from cuboid import CuboidError, TrackerConfig, __version__
from cuboid.cli.threads import limit_threads
from cuboid.synthetic import KINDS
from cuboid.synthetic.kinds import FRAMES
from scenes import MadeScene, made, source_digest
from scoring import mean, run_and_score, together, total
from tables import cell, dump, markdown

SEEDS = (1, 2, 3, 4)
# The short suite: what a continuous integration has half a minute for.
SHORT_KINDS, SHORT_SEEDS, SHORT_FRAMES, SHORT_SIZE = ("table", "leave"), (1,), 45, (320, 240)
HEADER = (
    "kind", "scenes", "objects", "recall .25", "precision .25", "recall .5", "precision .5", "mean IoU", "HOTA",
    "IDF1 .25", "IDF1 .5", "re-id", "switches", "fragments", "scenes without", "merges", "proposals", "ms/frame",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Settings:
    """How the scenes are tracked.

    Attributes
    ----------
    poses : str
        "given" or "estimated".
    every, scale : int
        As of `cuboid track`.
    proposals : str or None
        Name of the source.
    config : TrackerConfig
    """

    poses: str
    every: int
    scale: int
    proposals: str | None
    config: TrackerConfig

    def key(self) -> str:
        """Return what tells results of these settings and this program from others."""
        what = [self.poses, self.every, self.scale, self.proposals, self.config.to_dict()]
        settings = hashlib.sha256(json.dumps(what, sort_keys=True).encode()).hexdigest()[:6]
        return f"{__version__}-{source_digest()}-{settings}"


def scene_figures(scene: MadeScene, settings: Settings, work: Path, key: str) -> dict[str, Any]:
    """Return the figures of a scene, from its file or by tracking it."""
    folder = work / "results" / key
    file = folder / f"{scene.name}.json"
    if file.is_file():
        row: dict[str, Any] = json.loads(file.read_text())
        return row
    row = run_and_score(
        made(scene, work),
        folder / scene.name,
        poses=settings.poses,
        every=settings.every,
        scale=settings.scale,
        proposals=settings.proposals,
        config=settings.config,
    )
    beside = file.with_suffix(".partial")
    beside.write_text(json.dumps(row, indent=1))
    beside.replace(file)
    return row


def run_suite(scenes: list[MadeScene], settings: Settings, work: Path, jobs: int) -> list[dict[str, Any]]:
    """Return the figures of all scenes, in their order."""
    rows: dict[str, dict[str, Any]] = {}
    key = settings.key()  # once: the source may be edited meanwhile
    longest_first = sorted(scenes, key=lambda scene: -FRAMES[scene.kind])
    with ProcessPoolExecutor(jobs, get_context("spawn"), limit_threads, (1,)) as pool:
        waiting = {pool.submit(scene_figures, scene, settings, work, key): scene for scene in longest_first}
        for done in as_completed(waiting):
            try:
                row = done.result()
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise
            rows[waiting[done].name] = row
            _tell(row, len(rows), len(scenes))
    return [rows[scene.name] for scene in scenes]


def _tell(row: dict[str, Any], count: int, scenes: int) -> None:
    """Say on standard error how far it is."""
    shown = ("recall_50", "precision_50", "hota", "idf1_25", "fragments")
    text = ", ".join(f"{name} {cell(row[name])}" for name in shown)
    print(f"{count}/{scenes} {row['scene']}: {text}", file=sys.stderr, flush=True)


def summary(name: str, rows: list[dict[str, Any]]) -> list[Any]:
    """Return the line of a table: shares are means over scenes, re-identification is of all reappearances."""
    back = together(rows, "same_label", "reappearances")
    return [
        name, len(rows), total(rows, "objects"),
        *(mean(rows, key) for key in ("recall_25", "precision_25", "recall_50", "precision_50", "mean_iou")),
        *(mean(rows, key) for key in ("hota", "idf1_25", "idf1_50")),
        f"{cell(back)} of {total(rows, 'reappearances')}",
        total(rows, "switches"), total(rows, "fragments"), sum(row["fragments"] == 0 for row in rows),
        total(rows, "merges"), cell(mean(rows, "proposals"), 2), cell(mean(rows, "ms_frame"), 1),
    ]  # fmt: skip


def table(rows: list[dict[str, Any]]) -> str:
    """Return the table: a line a kind, and one of all."""
    kinds = list(dict.fromkeys(row["kind"] for row in rows))
    lines = [summary(kind, [row for row in rows if row["kind"] == kind]) for kind in kinds]
    return markdown(HEADER, [*lines, summary("all", rows)])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, required=True, metavar="DIR", help="keeps recordings and results")
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)), metavar="N")
    parser.add_argument("--short", action="store_true", help="two short small scenes: a check that takes half a minute")
    parser.add_argument("--kinds", nargs="+", choices=list(KINDS), default=None)
    parser.add_argument("--seeds", nargs="+", type=int, default=None, metavar="N", help="default: 1 2 3 4")
    parser.add_argument("--sensor", default="structured-light")
    parser.add_argument("--pose-noise", default="none")
    parser.add_argument("--poses", choices=("given", "estimated"), default="given")
    parser.add_argument("--proposals", default=None, metavar="NAME[:OPTIONS]")
    parser.add_argument("--every", type=int, default=1, metavar="N")
    parser.add_argument("--scale", type=int, choices=(1, 2, 4), default=1)
    parser.add_argument("--set", nargs="+", default=[], metavar="NAME=VALUE", help="settings of the tracker")
    parser.add_argument("--json", action="store_true", help="print all figures of each scene instead of the table")
    args = parser.parse_args()
    limit_threads(1)
    kinds = args.kinds or (SHORT_KINDS if args.short else KINDS)
    seeds = args.seeds or (SHORT_SEEDS if args.short else SEEDS)
    small: dict[str, Any] = {"frames": SHORT_FRAMES, "size": SHORT_SIZE} if args.short else {}
    scenes = [
        MadeScene(kind, seed, sensor=args.sensor, pose_noise=args.pose_noise, **small)
        for kind in kinds
        for seed in seeds
    ]
    try:
        config = TrackerConfig.from_dict(dict(item.split("=", 1) for item in args.set))
        settings = Settings(args.poses, args.every, args.scale, args.proposals, config)
        rows = run_suite(scenes, settings, args.work, args.jobs)
    except CuboidError as error:
        print(f"suite: {error}", file=sys.stderr)
        return 2
    if args.json:
        dump(rows)
    else:
        print(table(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
