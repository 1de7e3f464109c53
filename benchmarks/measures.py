"""Errors of measures on made parcels and parts, and how often the stated interval holds the truth.

python benchmarks/measures.py --work DIR [--views above,side,hand] [--seeds N]

The recordings are made once and kept in DIR (see `made_measures.py`). A fixed camera sees the objects for 2 s with
known poses; a hand-held one goes round them, and its poses are estimated.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import numpy.typing as npt

from cuboid import Tracker
from cuboid.ground.core.results import TrackedObject
from cuboid.ground.core.sizes import SIGMAS_95
from made_measures import PRESETS, VIEWS, Made, Thing, recording

DISTANCES_M = (0.5, 0.8, 1.2)
# An object is the true one if its centre is within this distance, metres, or this fraction of the longest side.
MATCH_M, MATCH_FRACTION = 0.03, 0.35
# An object is whole, neither cut nor joined with a neighbour, if its box laid upon the true one has this IoU.
WHOLE_IOU = 0.5

Array = npt.NDArray[np.float64]


def main() -> None:
    """Measure, and print a row for each view, sensor and distance."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else None)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--views", default="above,side")
    parser.add_argument("--seeds", type=int, default=2)
    args = parser.parse_args()
    measured = "median error l, w, h (mm) | bias (mm) | interval holds | of whole objects (cases)"
    print(f"| view | sensor | distance | found | {measured} |")
    print("|---|---|---|---|---|---|---|---|")
    for view in (one for one in VIEWS if one in args.views.split(",")):
        for sensor in PRESETS:
            for distance_m in DISTANCES_M:
                _row(args.work, view, sensor, distance_m, args.seeds)


def _row(work: Path, view: str, sensor: str, distance_m: float, seeds: int) -> None:
    errors: list[Array] = []
    held: list[list[bool]] = []
    whole: list[bool] = []
    total = 0
    for seed in range(seeds):
        made = recording(work, view, sensor, distance_m, seed)
        total += len(made.things)
        for thing, item in _pairs(made, posed=view != "hand"):
            error, sigma = _error_m(thing, item)
            errors.append(1e3 * error)
            held.append((np.abs(error) <= SIGMAS_95 * sigma).tolist())
            whole.append(_iou(item.box.size, item.box.size - error) >= WHOLE_IOU)
    if not errors:
        print(f"| {view} | {sensor} | {distance_m} m | 0 of {total} | | | | |")
        return
    median, bias = (_text(np.median(values, axis=0)) for values in (np.abs(errors), errors))
    found = f"{len(errors)} of {total}"
    kept = np.array(held)[whole]
    share = f"{kept.mean():.2f} ({kept.size})" if len(kept) else ""
    row = (view, sensor, f"{distance_m} m", found, median, bias, f"{np.mean(held):.2f}", share)
    print(f"| {' | '.join(row)} |", flush=True)


def _pairs(made: Made, *, posed: bool) -> list[tuple[Thing, TrackedObject]]:
    """Track a recording; return each true object with the one that was found there."""
    tracker = Tracker(made.intrinsics, poses="given" if posed else "estimated")
    for frame in made.frames(posed=posed):
        tracker.update(frame)
    T_world_map = np.eye(4) if posed else made.poses[0]
    found = [(item, item.box.moved(T_world_map).center) for item in tracker.objects]
    pairs = []
    for thing in made.things:
        away = [float(np.linalg.norm(center - thing.box.center)) for _, center in found]
        if away and min(away) < max(MATCH_M, MATCH_FRACTION * float(thing.box.size.max())):
            pairs.append((thing, found[int(np.argmin(away))][0]))
    return pairs


def _error_m(thing: Thing, item: TrackedObject) -> tuple[Array, Array]:
    """Return the errors of length, width and height, and their stated standard deviations: longer level side first."""
    true = np.array([*sorted(thing.box.size[:2], reverse=True), thing.box.size[2]])
    return np.asarray(item.box.size - true), np.array(item.size_sigma_m)


def _iou(size: Array, other: Array) -> float:
    """Return the IoU of two boxes that are laid upon each other."""
    common = float(np.prod(np.minimum(size, other)))
    return common / (float(np.prod(size) + np.prod(other)) - common)


def _text(values: Array) -> str:
    return ", ".join(f"{value:z.1f}" for value in values)


if __name__ == "__main__":
    main()
