"""Synthetic scenes of one kind, scene by scene: things found, their heights, and things with two labels.

python benchmarks/one_kind.py KIND --work DIR [--seeds N ...] [--frames N] [--size WxH] [--style plain|real] [--jobs N]

Makes each scene with `cuboid synth` and tracks it with `cuboid track --threads 1`, without further options. DIR keeps
the recordings and, by the digest of the program's source, the results: a second call is quick.

- found: objects whose box in the final map has an IoU of 0.5 or more.
- height: of the objects whose box has an IoU of 0.25 or more, those whose box is as high as the true one within 1 cm.
- two labels: further labels, in the final map, of objects that have one already (fragments of `cuboid evaluate`).
- merges, false: objects in the box of another one, and boxes that lie on no object at all.
"""

from __future__ import annotations

import argparse
import os
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import CuboidError, InputError
from cuboid.lab.evaluation import evaluate
from cuboid.lab.evaluation.result import read_result
from cuboid.lab.evaluation.truth import read_truth
from cuboid.lab.synthetic import KINDS
from place_list import Part, Place, render
from place_tracking import Checkout, track
from scenes import SOURCE, TRUTH, source_digest
from tables import markdown

# Difference of heights that a user does not notice, metres.
SAME_HEIGHT_M = 0.01
HEADER = ("scene", "objects", "found", "height", "of", "two labels", "merges", "false", "lowest")
COUNTS = HEADER[1:-1]


def part_of(args: argparse.Namespace, seed: int) -> Part:
    """Return the recording of a seed."""
    call = ["--kind", args.kind, "--seed", str(seed), "--size", args.size, "--style", args.style]
    call += [] if args.frames is None else ["--frames", str(args.frames)]
    digest = source_digest("lab/synthetic")
    name = "-".join([args.kind, str(seed), f"{args.frames or 'all'}f", args.size, args.style])
    folder = args.work / "recordings" / digest / name
    return Part(f"{digest}-{name}", folder, (folder / TRUTH,), tuple(call))


def row_of(part: Part, result: Path) -> dict[str, Any]:
    """Return the figures of a scene.

    Parameters
    ----------
    part : Part
    result : Path
        Folder of the result.
    """
    truth = read_truth(part.truths[0])
    found, boxes = evaluate(result, truth), read_result(result).objects
    true_boxes = {item.id: item.box for item in truth.objects}
    errors_m = {}
    for item in found.objects:
        if item.box is not None:
            box, own = boxes.boxes[boxes.label == item.box.label][0], true_boxes[item.id]
            height = height_m(box[3:6], box[6:].reshape(3, 3), own.up)
            errors_m[f"{item.name} {100 * own.size[2]:.1f}"] = height - float(own.size[2])
    lowest = min(errors_m, key=lambda name: errors_m[name], default="")
    return {
        "objects": found.map.objects,
        "found": found.map.at[1].found,
        "height": sum(abs(error) <= SAME_HEIGHT_M for error in errors_m.values()),
        "of": len(errors_m),
        "two labels": found.map.fragments,
        "merges": found.map.merges,
        "false": found.map.false_alarms,
        "lowest": f"{lowest} cm: {100 * errors_m[lowest]:+.1f}" if errors_m else "-",
    }


def height_m(size_m: Float64Array, rotation: Float64Array, up: Float64Array) -> float:
    """Return the extent of a box along a direction.

    Parameters
    ----------
    size_m : (3,) float64
    rotation : (3, 3) float64
        R_world_box.
    up : (3,) float64
        Unit vector: the third axis of the true box.
    """
    return float(np.abs(up @ rotation) @ size_m)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=KINDS)
    parser.add_argument("--work", type=Path, required=True, metavar="DIR", help="keeps recordings and results")
    parser.add_argument("--seeds", nargs="+", type=int, default=list(range(1, 9)), metavar="N", help="default: 1 to 8")
    parser.add_argument("--frames", type=int, default=None, metavar="N", help="default: as many as the kind has")
    parser.add_argument("--size", default="640x480", metavar="WxH")
    parser.add_argument("--style", choices=("plain", "real"), default="plain")
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)), metavar="N", help="processes")
    args = parser.parse_args()
    try:
        rows = _rows(args)
    except CuboidError as error:
        print(f"one_kind: {error}", file=sys.stderr)
        return 2
    lines = [[name, *row.values()] for name, row in rows.items()]
    lines.append(["all", *(sum(row[name] for row in rows.values()) for name in COUNTS), ""])
    print(markdown(HEADER, lines))
    return 0


def _rows(args: argparse.Namespace) -> dict[str, dict[str, Any]]:
    parts = {f"{args.kind} {seed}": part_of(args, seed) for seed in args.seeds}
    places = [Place(name, args.kind, 0.5, made=True, parts=(part,)) for name, part in parts.items()]
    checkout = Checkout.of(SOURCE.parent, args.work)
    with ThreadPoolExecutor(args.jobs) as executor:
        for reason in filter(None, executor.map(render, parts.values())):
            raise InputError(reason)
        for place, reason in track(checkout, places, executor):
            if reason is not None:
                raise InputError(f"{place.name}: {reason}")
            print(f"{place.name}: tracked", file=sys.stderr, flush=True)
    return {name: row_of(part, checkout.result(part)) for name, part in parts.items()}


if __name__ == "__main__":
    sys.exit(main())
