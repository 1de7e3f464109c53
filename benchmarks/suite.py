"""The suite: four scenes of each of six kinds with the noise of a structured-light sensor, and their figures.

python benchmarks/suite.py --work DIR [--jobs N] [--short] [--json]

DIR keeps the made recordings and a store, into which `cuboid batch` tracks them and of which `cuboid evaluate --store`
judges them. Run again, it takes up where it was left: a scene is tracked anew only when the program's source, the
settings or the recording have changed. `--jobs` tracks so many scenes at a time, each on one core.
"""

from __future__ import annotations

import argparse
import os
import sys
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from distributed import Client, Worker, WorkerPlugin

from cuboid import CuboidError, TrackerConfig, __version__
from cuboid.fleet.batch.batch import Order, carry_out, plan
from cuboid.fleet.batch.cluster import Workers
from cuboid.fleet.batch.sources import BatchSource
from cuboid.fleet.batch.task import Ended
from cuboid.fleet.store.judging import judge_store
from cuboid.fleet.store.rows import settings_text
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.threads import limit_threads
from cuboid.lab.synthetic import KINDS
from cuboid.lab.synthetic.kinds import FRAMES
from scenes import MadeScene, made, source_digest
from scoring import mean, processor_time, summed_counts, total
from tables import cell, dump, markdown

SEEDS = (1, 2, 3, 4)
# The short suite: what a continuous integration has half a minute for.
SHORT_KINDS, SHORT_SEEDS, SHORT_FRAMES, SHORT_SIZE = ("table", "leave"), (1,), 45, (320, 240)
HEADER = (
    "kind",
    "scenes",
    "objects",
    "recall .25",
    "precision .25",
    "recall .5",
    "precision .5",
    "mean IoU",
    "HOTA",
    "IDF1 .25",
    "IDF1 .5",
    "re-id",
    "switches",
    "fragments",
    "scenes without",
    "merges",
    "proposals",
    "ms/frame",
)


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

    def document(self) -> dict[str, Any]:
        """Return them as a batch takes them."""
        return {
            "reading": {"format": None, "intrinsics": None, "depth_scale": None, "register": "off"},
            "tracker": self.config.to_dict(),
            "proposals": self.proposals,
            "poses": self.poses,
            "every": self.every,
            "scale": self.scale,
        }


class ProcessorTime(WorkerPlugin):
    """Let workers measure stages in processor time."""

    def setup(self, worker: Worker) -> None:
        """Begin, for as long as the worker lives."""
        self._patched = ExitStack()
        self._patched.enter_context(processor_time())


def run_suite(scenes: list[MadeScene], settings: Settings, work: Path, jobs: int) -> list[dict[str, Any]]:
    """Return the figures of all scenes, in their order."""
    version = f"{__version__}+{source_digest()}"  # once: the source may be edited meanwhile
    order = Order(str(work / "store"), settings.document(), retry=True, version=version)
    longest_first = sorted(scenes, key=lambda scene: -FRAMES[scene.kind])
    with Workers(count=jobs).connected() as client:
        client.register_plugin(ProcessorTime())
        cases = client.gather(client.map(made, longest_first, work=work, pure=False))
        _track(client, [BatchSource(case.name, str(case.recording.resolve())) for case in cases], order)
        truths = cases[0].recording.parent
        found = judge_store(client, order.store, truths, version=version, settings=settings_text(order.settings))
    for name, reason in found.refused.items():
        raise InputError(f"{name}: {reason}")
    return [{"scene": scene.name, "kind": scene.kind, **found.rows[scene.name]} for scene in scenes]


def _track(client: Client, sources: list[BatchSource], order: Order) -> None:
    """Track what is not done yet, and say on standard error how far it is."""
    planned = plan(client, sources, order)
    count = 0

    def ended(one: Ended) -> None:
        nonlocal count
        count += 1
        print(f"{count}/{len(planned.tasks)} {one.head.recording}: {one.objects} objects", file=sys.stderr, flush=True)
        if one.reason is not None:
            raise InputError(f"{one.head.recording}: {one.reason}")

    carry_out(client, planned, order, ended)


def summary(name: str, rows: list[dict[str, Any]]) -> list[Any]:
    """Return the line of a table: shares are means over scenes, re-identification is of all reappearances."""
    back = summed_counts(rows, "same_label", "reappearances")
    return [
        name,
        len(rows),
        total(rows, "objects"),
        *(mean(rows, key) for key in ("recall_25", "precision_25", "recall_50", "precision_50", "mean_iou")),
        *(mean(rows, key) for key in ("hota", "idf1_25", "idf1_50")),
        f"{cell(back)} of {total(rows, 'reappearances')}",
        total(rows, "switches"),
        total(rows, "fragments"),
        sum(row["fragments"] == 0 for row in rows),
        total(rows, "merges"),
        cell(mean(rows, "proposals"), 2),
        cell(mean(rows, "ms_frame"), 1),
    ]


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
