"""Labels on table-top stills: each is watched for a while by a camera that hardly moves.

python benchmarks/stills.py DATA [--frames N] [--every N]

DATA holds the folder `hots` (real table-top stills with instance masks). Printed is the recall of the objects of at
least 3 cm height and 800 pixels that the border does not cut, at a rectangle IoU of 0.5: of the 2D proposals, of the
frame's own 3D boxes, and of the labelled sightings in the last frame; and the precision of these sightings. One of an
object that need not be found counts neither way.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from cuboid.ground.core.threads import limit_threads
from cuboid.ground.geometry.rectangles import rect_iou_matrix
from cuboid.lab.evaluation.matching import match
from cuboid.method.proposals import make_source
from cuboid.runs.tracking.posed_tracker import PosedTracker
from proposal_sources import FIT, View, stills

# What a hand that holds still moves by, metres, in a direction of the image.
SHAKE_M = 0.001


def judge(view: View, frames: int) -> np.ndarray:
    """Return of a still the objects wanted, those with a 2D proposal, an own box, a label, and the false labels."""
    rng, tracker = np.random.default_rng(0), PosedTracker(view.intrinsics)
    for index in range(frames):
        T = np.eye(4)
        T[:3, 3] = rng.normal(0.0, SHAKE_M, 3)
        frame = view.frame
        found = tracker.update(type(frame)(index, index / 30.0, frame.color, frame.depth_m, T))
    wanted = view.rectangles[view.wanted]
    flat = make_source("depth")(view.frame, view.intrinsics).boxes_xyxy.astype(np.float64)
    own = np.array([box.rect_xyxy for box in found.proposals]).reshape(-1, 4)
    seen = np.array([one.rect_xyxy for one in found.sightings]).reshape(-1, 4)
    pairs = match(rect_iou_matrix(view.rectangles, seen), FIT)
    labelled = sum(bool(view.wanted[i]) for i, _ in pairs)
    early = [int((rect_iou_matrix(wanted, rects) >= FIT).any(1).sum()) for rects in (flat, own)]
    return np.array([len(wanted), *early, labelled, len(seen) - len(pairs)])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("--frames", type=int, default=20)
    parser.add_argument("--every", type=int, default=1)
    options = parser.parse_args()
    limit_threads(1)
    views = [view for k, view in enumerate(stills(options.data / "hots")) if k % options.every == 0]
    wanted, flat, own, labelled, false = np.sum([judge(view, options.frames) for view in views], axis=0)
    print(f"{len(views)} stills, {wanted} objects", end=": ")
    print(f"recall of 2D proposals {flat / wanted:.2f}, own boxes {own / wanted:.2f}, labels {labelled / wanted:.2f};")
    print(f"precision of labels {labelled / (labelled + false):.2f}, {false} false")


if __name__ == "__main__":
    main()
