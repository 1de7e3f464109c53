"""Judge the regions of color and depth in single frames: whether they contain the things, and which are chosen.

python benchmarks/region_choice.py --work DIR [--data DATA] [--real DIR --real-truth DIR] [--only NAME ...]

Prints a row for each real place: fraction of drawn rectangles with a candidate at the IoU of the place (of all
candidates, and of the surfaces of `depth` alone); recall, precision and F1 of the chosen regions; candidates, and
milliseconds of this thread, for a picture. Nothing is fused over time. The score is fitted to made pictures alone, so
that every place is left out (`fit_regions.py`).
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.geometry.rectangles import rect_iou_matrix
from cuboid.lab.evaluation.keyframes import Keyframe
from cuboid.lab.evaluation.rectangles import Outcome, judge_frame
from cuboid.method.proposals.region_maps import ReducedFrame
from cuboid.method.proposals.regions import RegionSource
from cuboid.runs.tracking.rolling import Roll
from place_list import Folders, Place, named, real_places
from region_pictures import annotated_frames

Counts = Float64Array


def judged(place: Place, source: RegionSource) -> Counts:
    """Return sums over the frames of a place.

    Rectangles, those with a candidate, with a surface, found ones, false ones; frames, seconds, candidates.
    """
    total = np.zeros(8)
    for frame, roll, keyframe in annotated_frames(place):
        begin = time.thread_time()
        found = source(frame, roll.camera)
        seconds = time.thread_time() - begin
        reduced = ReducedFrame(frame, roll.camera)
        (trees, surfaces), step = source.candidates(reduced), reduced.step
        boxes = [tree.tree.boxes[: tree.count][tree.usable > 0] for tree in trees]
        surface_boxes = surfaces.masks.rectangles[surfaces.usable > 0]
        chosen = judge_frame(keyframe, _unrolled(found.boxes_xyxy, roll), place.iou)
        wanted = chosen.counts
        contained = _contained(keyframe, _unrolled(np.concatenate([*boxes, surface_boxes]) * step, roll), place.iou)
        by_depth = _contained(keyframe, _unrolled(surface_boxes * step, roll), place.iou)
        false = sum(outcome is Outcome.FALSE for outcome in chosen.outcomes)
        hits = (contained & wanted).sum(), (by_depth & wanted).sum(), chosen.found.sum()
        total += [wanted.sum(), *hits, false, 1.0, seconds, sum(map(len, boxes)) + len(surface_boxes)]
    return total


def _unrolled(rects: np.ndarray, roll: Roll) -> Float64Array:
    """Return rectangles (N, 4) of the rolled picture in the picture as recorded."""
    return np.asarray(roll._rectangles(rects.astype(np.float64), roll.camera, -roll.turns % 4))


def _contained(keyframe: Keyframe, rects: Float64Array, iou: float) -> np.ndarray:
    return rect_iou_matrix(keyframe.rects_xyxy, rects).max(1, initial=0.0) >= iou


def row(name: str, total: Counts) -> str:
    """Return the row of a place."""
    wanted, contained, by_depth, found, false, frames, seconds, candidates = total.tolist()
    recall, precision = found / max(wanted, 1.0), found / max(found + false, 1.0)
    f1 = 2.0 * recall * precision / max(recall + precision, 1e-9)
    figures = contained / max(wanted, 1.0), by_depth / max(wanted, 1.0), recall, precision, f1
    listed = " ".join(f"{value:9.2f}" for value in figures)
    return f"{name:30s} {wanted:10.0f} {listed} {candidates / frames:10.0f} {1e3 * seconds / frames:6.0f}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, required=True, metavar="DIR", help="keeps recordings of stills")
    parser.add_argument("--data", type=Path, default=None, metavar="DATA", help="real recordings with their truth")
    parser.add_argument("--real", type=Path, default=None, metavar="DIR", help="further real recordings")
    parser.add_argument("--real-truth", type=Path, default=None, metavar="DIR", help="rectangles of these recordings")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="these places or kinds of places")
    args = parser.parse_args()
    places, absent = real_places(Folders(args.data, args.real, args.real_truth, args.work), every_still=1)
    if absent:
        print(f"absent: {', '.join(absent)}", file=sys.stderr)
    source, f1 = RegionSource(TrackerConfig()), []
    print(f"{'place':30s} rectangles contained  by depth    recall precision        F1 candidates     ms")
    for place in named(places, args.only):
        total = judged(place, source)
        if total[5]:
            print(row(place.name, total), flush=True)
            recall, precision = total[3] / max(total[0], 1.0), total[3] / max(total[3] + total[4], 1.0)
            f1.append(2.0 * recall * precision / max(recall + precision, 1e-9))
    print(f"mean F1 of {len(f1)} places: {np.mean(f1):.3f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
