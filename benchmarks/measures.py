"""Errors of measures on made parcels and parts, and how often the stated interval holds the truth.

python benchmarks/measures.py --work DIR [--views above,side,hand] [--seeds N] [--hand-seeds N] [--shapes curved]

A row for each view, sensor and distance, then rows over several of them. The recordings are made once and kept in DIR
(see `made_measures.py`). A fixed camera sees the objects for 2 s with known poses; a hand-held one goes round them,
and its poses are estimated. A whole object is neither cut nor joined with a neighbour; errors and intervals are those
of whole objects. With `--shapes curved` the objects are round, tapered or soft-edged, with a row for each of these
and each view. "Half" is the median of half of the 95 % intervals.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from cuboid import Tracker
from cuboid.ground.core.results import TrackedObject
from cuboid.ground.core.sizes import SIGMAS_95
from made_measures import CURVED, GROUPS, PARCELS, PRESETS, VIEWS, Made, recording

DISTANCES_M = (0.5, 0.8, 1.2)
# An object is the true one if its centre is within this distance, metres, or this fraction of the longest side.
MATCH_M, MATCH_FRACTION = 0.03, 0.35
# An object is whole if its box laid upon the true one has this IoU.
WHOLE_IOU = 0.5
HEAD = (
    "| view | sensor | distance | whole of all | median error (mm) | bias l, w, h (mm) | half (mm) | interval holds | "
    "told apart |"
)

Array = npt.NDArray[np.float64]


@dataclass
class Cell:
    """The measures of some recordings.

    Attributes
    ----------
    objects : int
        Number of true objects.
    error_m : list of (3,) float64
        Errors of length, width and height of the whole ones.
    held : list of (3,) bool
        Whether their intervals hold the truth.
    half_m : list of (3,) float64
        Half of their intervals.
    touching, apart : int
        Pairs of objects that touch, and those of them that were measured as two.
    """

    objects: int = 0
    error_m: list[Array] = field(default_factory=list)
    held: list[npt.NDArray[np.bool_]] = field(default_factory=list)
    half_m: list[Array] = field(default_factory=list)
    touching: int = 0
    apart: int = 0

    def __add__(self, other: Cell) -> Cell:
        numbers = self.objects + other.objects, self.touching + other.touching, self.apart + other.apart
        lists = self.error_m + other.error_m, self.held + other.held, self.half_m + other.half_m
        return Cell(numbers[0], *lists, *numbers[1:])

    def row(self) -> str:
        """Return the figures as cells of a table."""
        whole = f"{len(self.error_m)} of {self.objects}"
        apart = f"{self.apart} of {self.touching}" if self.touching else ""
        if not self.error_m:
            return f"{whole} | | | | | {apart}"
        error_mm, held = 1e3 * np.array(self.error_m), np.array(self.held)
        median, bias = float(np.median(np.abs(error_mm))), np.median(error_mm, axis=0)
        signed = ", ".join(f"{value:z.1f}" for value in bias)
        half_mm = 1e3 * float(np.median(self.half_m))
        return f"{whole} | {median:.1f} | {signed} | {half_mm:.1f} | {held.mean():.2f} ({held.size}) | {apart}"


def main() -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else None)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--views", default="above,side")
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--hand-seeds", type=int, default=2)
    parser.add_argument("--shapes", choices=(PARCELS, CURVED), default=PARCELS)
    args = parser.parse_args()
    views = [view for view in VIEWS if view in args.views.split(",")]
    print(HEAD)
    print("|---" * HEAD.count(" | ") + "|---|")
    if args.shapes == CURVED:
        _curved_rows(args, views)
        return
    cells: dict[tuple[str, str, float], Cell] = {}
    for view in views:
        for sensor in PRESETS:
            for distance_m in DISTANCES_M:
                cell = Cell()
                for seed in range(args.hand_seeds if view == "hand" else args.seeds):
                    made = recording(args.work, view, sensor, distance_m, seed)
                    cell += sum(_measured(made, posed=view != "hand").values(), Cell())
                cells[view, sensor, distance_m] = cell
                print(f"| {view} | {sensor} | {distance_m} m | {cell.row()} |", flush=True)
    for view in views:
        for distance_m in DISTANCES_M:
            some = [cell for key, cell in cells.items() if key[0] == view and key[2] == distance_m]
            print(f"| {view} | all | {distance_m} m | {sum(some, Cell()).row()} |")
    print(f"| all | all | all | {sum(cells.values(), Cell()).row()} |")


def _curved_rows(args: argparse.Namespace, views: list[str]) -> None:
    """Print a row for each view and group of curved objects, over all sensors and the near distances."""
    for view in views:
        cells = dict.fromkeys(GROUPS, Cell())
        for sensor in PRESETS:
            for distance_m in DISTANCES_M[:2]:
                for seed in range(args.hand_seeds if view == "hand" else args.seeds):
                    made = recording(args.work, view, sensor, distance_m, seed, CURVED)
                    of_kind = _measured(made, posed=view != "hand")
                    for group, kinds in GROUPS.items():
                        cells[group] += sum((of_kind.get(kind, Cell()) for kind in kinds), Cell())
        for group, cell in cells.items():
            print(f"| {view} | all | {group} | {cell.row()} |", flush=True)


def _measured(made: Made, *, posed: bool) -> dict[str, Cell]:
    """Track a recording, and compare its objects with the true ones; return the figures of each kind of object."""
    tracker = Tracker(made.intrinsics, poses="given" if posed else "estimated")
    for frame in made.frames(posed=posed):
        tracker.update(frame)
    T_world_map = np.eye(4) if posed else made.poses[0]
    places = [(item, item.box.moved(T_world_map).center) for item in tracker.objects]
    cells = {thing.kind: Cell() for thing in made.things}
    labels: list[int] = []
    for thing in made.things:
        cell = cells[thing.kind]
        cell.objects += 1
        item = _nearest(places, thing.box.center, max(MATCH_M, MATCH_FRACTION * float(thing.box.size.max())))
        labels.append(0)
        if item is None:
            continue
        # The longer level side first.
        error_m = item.box.size - np.array([*sorted(thing.box.size[:2], reverse=True), thing.box.size[2]])
        if _iou(item.box.size, item.box.size - error_m) >= WHOLE_IOU:
            cell.error_m.append(error_m)
            cell.half_m.append(SIGMAS_95 * np.array(item.size_sigma_m))
            cell.held.append(np.abs(error_m) <= cell.half_m[-1])
            labels[-1] = item.label
    for k, thing in enumerate(made.things):
        for other in thing.touches:
            if other > k:
                cells[thing.kind].touching += 1
                cells[thing.kind].apart += bool(labels[k] and labels[other] and labels[k] != labels[other])
    return cells


def _nearest(places: list[tuple[TrackedObject, Array]], center: Array, within_m: float) -> TrackedObject | None:
    """Return the object with the nearest centre; None if that is too far away."""
    away = [float(np.linalg.norm(one - center)) for _, one in places]
    return places[int(np.argmin(away))][0] if away and min(away) < within_m else None


def _iou(size: Array, other: Array) -> float:
    """Return the IoU of two boxes that are laid upon each other."""
    common = float(np.prod(np.minimum(size, other)))
    return common / (float(np.prod(size) + np.prod(other)) - common)


if __name__ == "__main__":
    main()
