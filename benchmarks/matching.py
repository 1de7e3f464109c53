"""Milliseconds to match ten current boxes with a map of up to 10,000 objects.

python benchmarks/matching.py [--json]
"""

from __future__ import annotations

import argparse
import json
import time

import numpy as np

from cuboid.ground.geometry.overlap import overlaps
from cuboid.method.objects.matching import assign

CURRENT = 10
REPEATS = 200


def scene(objects: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Objects of 5-30 cm strewn over a floor, one to the square metre, and ten of them seen with some noise."""
    rows = np.zeros((objects, 15))
    side = np.sqrt(objects)
    rows[:, :3] = rng.uniform(0, 1, (objects, 3)) * [side, side, 1.0]
    rows[:, 3:6] = rng.uniform(0.05, 0.3, (objects, 3))
    turn = rng.uniform(0, np.pi, objects)
    rows[:, 6], rows[:, 7], rows[:, 9], rows[:, 10], rows[:, 14] = (
        np.cos(turn),
        -np.sin(turn),
        np.sin(turn),
        np.cos(turn),
        1,
    )
    seen = rows[rng.choice(objects, CURRENT, replace=False)].copy()
    seen[:, :3] += rng.normal(0, 0.01, (CURRENT, 3))
    return seen, rows


def measure(objects: int) -> dict[str, float]:
    """Return median and 95th percentile of the time of IoU, partial overlap and assignment, milliseconds."""
    current, known = scene(objects, np.random.default_rng(0))
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        iou, _ = overlaps(current, known)
        pairs = assign(iou, 0.25)
        times.append((time.perf_counter() - start) * 1e3)
    if len(pairs) < CURRENT - 1:
        raise SystemExit(f"only {len(pairs)} of {CURRENT} boxes found their objects")
    return {
        "objects": objects,
        "median_ms": float(np.median(times)),
        "p95_ms": float(np.percentile(times, 95)),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    rows = [measure(n) for n in (10, 100, 1000, 10_000)]
    if args.json:
        print(json.dumps(rows))
        return
    print("| objects in the map | median ms | p95 ms |\n|---|---|---|")
    for row in rows:
        print(f"| {row['objects']:.0f} | {row['median_ms']:.3f} | {row['p95_ms']:.3f} |")


if __name__ == "__main__":
    main()
