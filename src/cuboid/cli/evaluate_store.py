"""`cuboid evaluate --store`: the figures of a whole dataset, and the changes between two versions."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cuboid.cli.results import give
from cuboid.cli.tables import console, new_table, score
from cuboid.ground.core.errors import counted, printable
from cuboid.ground.core.extras import need_cluster

if TYPE_CHECKING:
    from cuboid.fleet.store.judging import Judged
    from cuboid.lab.evaluation.statistics import Interval, Paired

# Figures of the tables, with the number of digits of each; --json has all figures.
_FRACTIONS = ("recall_25", "precision_25", "recall_50", "precision_50", "mean_iou")
_TRACKING = ("hota", "idf1_25", "idf1_50", "reid")
_COUNTS = ("switches", "fragments", "merges", "false_alarms")
SHOWN = {**dict.fromkeys(_FRACTIONS + _TRACKING, 3), **dict.fromkeys(_COUNTS, 2), "ms_frame": 1}

# A comparison lists this many scenes with the largest losses.
SCENES_NAMED = 10


def add_store(parser: argparse.ArgumentParser) -> None:
    """Add the options for evaluating a store."""
    from cuboid.cli.workers import add_workers

    whole = parser.add_argument_group("a whole store")
    whole.add_argument("--store", metavar="STORE", help="evaluate this store of 'cuboid batch' instead of RESULT")
    whole.add_argument(
        "--truth", dest="truths", metavar="DIR", help="folder with NAME/truth.json or NAME.json for each recording"
    )
    whole.add_argument("--of", metavar="VERSION", help="evaluate the runs of this version (default: the newest)")
    whole.add_argument(
        "--against", metavar="VERSION", help="also compare with the runs of this version, scene by scene"
    )
    add_workers(parser)


def run(args: argparse.Namespace) -> int:
    """Evaluate and print."""
    need_cluster("cuboid evaluate --store")
    from cuboid.cli.workers import workers_from
    from cuboid.fleet.store.judging import judge_store
    from cuboid.lab.evaluation.statistics import compare, intervals

    with workers_from(args).connected() as client:
        found = judge_store(client, args.store, Path(args.truths), version=args.of)
        before = args.against and judge_store(client, args.store, Path(args.truths), version=args.against)
    numbers = _numbers(found)
    means = intervals(list(found.rows.values()), numbers)
    paired = compare(before.rows, found.rows, numbers) if before else {}
    document: dict[str, Any] = {
        "scenes": found.rows,
        "without_truth": list(found.without_truth),
        "refused": found.refused,
        "not_done": found.not_done,
        "means": {name: one.to_dict() for name, one in means.items()},
    }
    if before:
        document |= {"scenes_before": before.rows, "change": {name: one.to_dict() for name, one in paired.items()}}

    def show() -> None:
        _print(found, means)
        if before:
            _print_change(paired, before.rows, found.rows)

    give(args, document, show)
    return 0


def _numbers(found: Judged) -> list[str]:
    """Return the numeric figures."""
    names = dict.fromkeys(name for row in found.rows.values() for name in row)
    return [name for name in names if name != "ms_stages"]


def _print(found: Judged, means: dict[str, Interval]) -> None:
    out = console()
    table = new_table("scene", *SHOWN)
    for name, row in found.rows.items():
        table.add_row(printable(name), *(score(row.get(figure), digits) for figure, digits in SHOWN.items()))
    for title, part in (("mean", "mean"), ("95 % from", "low"), ("to", "high")):
        cells = (score(getattr(means[name], part), d) if name in means else "-" for name, d in SHOWN.items())
        table.add_row(title, *cells)
    out.print(table)
    for name, reason in (*found.refused.items(), *found.not_done.items()):
        out.print(printable(f"{name}: {reason}"))
    if found.without_truth:
        out.print(f"{counted(len(found.without_truth), 'recording')} without a truth")


def _print_change(
    paired: dict[str, Paired], before: dict[str, dict[str, Any]], after: dict[str, dict[str, Any]]
) -> None:
    out = console()
    table = new_table(
        "figure", "before", "after", "change", "95 % from", "to", "significant", "scenes up", "down", "same"
    )
    for name, digits in SHOWN.items():
        if name in paired:
            one = paired[name]
            moved = (f"{getattr(one.difference, part):+.{digits}f}" for part in ("mean", "low", "high"))
            means = (score(side.mean, digits) for side in (one.before, one.after))
            table.add_row(name, *means, *moved, "yes" if one.sure else "no", *map(str, (one.up, one.down, one.same)))
    out.print(table)
    change = {scene: _hota(after[scene]) - _hota(before[scene]) for scene in before.keys() & after.keys()}
    lost = [(delta, scene) for scene, delta in sorted(change.items()) if delta < 0]
    for delta, scene in sorted(lost)[:SCENES_NAMED]:
        out.print(printable(f"{scene}: HOTA {delta:+.3f}"))
    for scene in sorted(before.keys() ^ after.keys()):
        out.print(printable(f"{scene}: only in one of the two versions"))


def _hota(row: dict[str, Any]) -> float:
    return float(row.get("hota") or 0.0)
