"""Relations on made scenes: precision and recall of each kind, and the errors of the boxes that they are found from.

python benchmarks/relations.py --work DIR [--kinds KIND ...] [--seeds N ...] [--json]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from cuboid import open_recording, open_results
from cuboid.ground.core.results import RELATIONS
from cuboid.lab.evaluation import evaluate, read_truth
from cuboid.lab.evaluation.matching import ratio
from cuboid.method.relations.footprints import Footprints
from cuboid.runs.pipeline.options import ResultOptions
from cuboid.runs.pipeline.run import track_recording
from scenes import Case, cases, source_digest
from tables import dump, show

KINDS = ("containers", "sideboard", "stacks", "bin", "shelf", "clutter", "tables")
COUNTS = ("right", "found", "true", "lost")


def results_of(case: Case, work: Path) -> Path:
    """Track a recording unless the results of this program are there; return their folder."""
    folder = work / "relations" / source_digest() / case.name
    if not folder.is_dir():
        track_recording(open_recording(case.recording), folder, results=ResultOptions(page=False))
    return folder


def judged(case: Case, work: Path) -> tuple[dict[str, dict[str, int]], list[float], list[float]]:
    """Return the counts of each kind, and the errors in metres of feet and of halves of sides."""
    folder = results_of(case, work)
    found, truth = evaluate(folder, case.truth), read_truth(case.truth)
    results, boxes = open_results(folder), {item.id: item.box for item in truth.objects}
    counts = {at.kind: {name: getattr(at, name) for name in COUNTS} for at in found.relations or ()}
    feet: list[float] = []
    sides: list[float] = []
    for item in found.objects:
        if item.box is not None and results.up is not None:  # without up no relation is found
            pair = Footprints.of([results.survivor[item.box.label].box, boxes[item.id]], truth.planes[0][0])
            feet.append(float(pair.low[0] - pair.low[1]))
            turned = (pair.half[0] - pair.half[1], pair.half[0] - pair.half[1][::-1])
            sides += min(turned, key=lambda off: float(np.abs(off).max())).tolist()
    return counts, feet, sides


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, required=True, help="folder of recordings and results, kept between runs")
    parser.add_argument("--kinds", nargs="+", default=list(KINDS))
    parser.add_argument("--seeds", nargs="+", type=int, default=[1, 2])
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    each = [judged(case, args.work) for case in cases(args.kinds, args.seeds, args.work, None)]
    total = {kind: {name: sum(counts[kind][name] for counts, _, _ in each) for name in COUNTS} for kind in RELATIONS}
    errors = {
        what: round(float(np.quantile(np.abs([off for one in each for off in one[place]]), 0.95)), 4)
        for what, place in (("foot", 1), ("half a side", 2))
    }
    if args.json:
        dump({"relations": total, "error_95_m": errors})
        return
    rows = [
        (kind, ratio(one["right"], one["found"]), ratio(one["right"], one["true"]), *(one[name] for name in COUNTS))
        for kind, one in total.items()
    ]
    show(f"{len(each)} scenes", ("relation", "precision", "recall", "right", "found", "true", "object not found"), rows)
    show("95 of 100 errors of boxes are below, metres", tuple(errors), [tuple(errors.values())])


if __name__ == "__main__":
    main()
