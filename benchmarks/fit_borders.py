"""Fit the evidence of the border of two segments side by side: the log-odds that they are one thing.

python benchmarks/fit_borders.py RECORDING [RECORDING ...] [--every N]

Each RECORDING is made by `cuboid synth`, with `truth.json` and poses; `places.py` keeps some of each kind in its
folder. Two segments from different proposals that share a border are a case if each lies in the box of one thing with
most of its points; they are one if it is the same thing. A logistic model of two quantities is fitted, every recording
with the root of its number of cases as weight; its area under the curve is for recordings that were left out.

Prints the constants of `cuboid.method.surfaces.frame_segments`: the log-odds less those of all cases together.
"""

from __future__ import annotations

import argparse
import sys
from itertools import islice
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize
from scipy.stats import rankdata

from cuboid import Tracker, open_recording
from cuboid.ground.core.kernels.pixels import back_project
from cuboid.ground.core.tolerances import JUMP_M
from cuboid.lab.evaluation.truth import Truth, read_truth
from cuboid.method.surfaces import frame_segments
from cuboid.method.surfaces.kernels.borders import borders
from cuboid.runs.tracking import posed_tracker

# A segment lies in the box of a thing if at least this fraction of its points does; boxes end this far beyond their
# surfaces, metres.
INSIDE_FRACTION, BEYOND_M = 0.7, 0.006
PENALTY = 0.01

Array = npt.NDArray[np.float64]


class Cases:
    """The cases of one recording: quantities of borders, and whether the two segments are one thing."""

    def __init__(self, truth: Truth) -> None:
        self._truth = truth
        self.T_world_camera = np.eye(4)
        self.quantities: list[Array] = []
        self.one: list[bool] = []

    def add(self, seen: Any, segments: Any, noise: float) -> None:
        """Add the borders of a frame."""
        count = len(segments.segments)
        shared, parting, continuing, coarse = (np.zeros((count, count), np.int64) for _ in range(4))
        focal, counts = seen.image.camera.fx, (shared, parting, continuing, coarse)
        borders(seen.solid.depth_m, segments.claim, focal, noise, JUMP_M, *counts)
        things = [self._thing_of(seen, one.pixels) for one in segments.segments]
        sizes = np.array([len(one.pixels) for one in segments.segments])
        quantities = frame_segments.border_quantities(shared, parting, continuing, sizes)
        for i, j in zip(*(k.tolist() for k in np.nonzero(shared > 2 * coarse)), strict=True):
            if segments.proposal[i] != segments.proposal[j] and things[i] >= 0 and things[j] >= 0:
                self.quantities.append(quantities[:, i, j])
                self.one.append(things[i] == things[j])

    def _thing_of(self, seen: Any, pixels: npt.NDArray[np.int64]) -> int:
        camera, points = seen.image.camera, np.empty((len(pixels), 3))
        pinhole = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
        back_project(pixels, seen.image.depth_m, pinhole, self.T_world_camera, points)
        inside = [one.box.contains(points, BEYOND_M).mean() for one in self._truth.objects]
        return int(np.argmax(inside)) if max(inside, default=0.0) >= INSIDE_FRACTION else -1


def collect(path: Path, every: int) -> tuple[Array, npt.NDArray[np.bool_]]:
    """Track a recording and return the quantities (N, 2) of its borders, and whether each is within one thing (N,)."""
    recording, cases = open_recording(path), Cases(read_truth(path / "truth.json"))
    original = posed_tracker.segment_frame

    def segment_frame(seen: Any, *rest: Any) -> Any:
        segments = original(seen, *rest)
        cases.add(seen, segments, rest[-1].depth_noise_per_m)
        return segments

    with patch.object(posed_tracker, "segment_frame", segment_frame):
        tracker = Tracker(recording.intrinsics)
        for frame in islice(recording, 0, None, every):
            cases.T_world_camera = frame.T_world_camera
            tracker.update(frame)
    return np.array(cases.quantities).reshape(-1, 2), np.array(cases.one, bool)


def fit(x: Array, y: Array, weights: Array) -> Array:
    """Return intercept and weights of a logistic model."""
    design = np.column_stack([np.ones(len(x)), x])

    def loss(b: Array) -> float:
        z = design @ b
        return float(weights @ np.logaddexp(0.0, np.where(y > 0, -z, z)) + PENALTY * (b @ b))

    return np.asarray(minimize(loss, np.zeros(design.shape[1])).x)


def area_under_curve(scores: Array, y: Array) -> float:
    """Return the probability that a case of one thing has a higher score than a case of two."""
    positive = y.sum()
    ranks = rankdata(scores)[y > 0].sum()
    return float((ranks - positive * (positive + 1) / 2) / (positive * (len(y) - positive)))


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("recordings", nargs="+", type=Path, metavar="RECORDING")
    parser.add_argument("--every", type=int, default=3, metavar="N", help="frames per tracked one (default: 3)")
    args = parser.parse_args()
    found = []
    for path in args.recordings:
        quantities, one = collect(path, args.every)
        print(
            f"{path.name}: {len(one)} borders, {one.mean() if len(one) else 0.0:.2f} within one thing", file=sys.stderr
        )
        if len(one):
            found.append((quantities, one.astype(np.float64)))
    x, y = np.concatenate([q for q, _ in found]), np.concatenate([one for _, one in found])
    group = np.repeat(np.arange(len(found)), [len(one) for _, one in found])
    weights = np.concatenate([np.full(len(one), len(one) ** -0.5) for _, one in found])
    scores = np.zeros(len(y))
    for k in range(len(found)):
        left_out = group == k
        b = fit(x[~left_out], y[~left_out], weights[~left_out])
        scores[left_out] = b[0] + x[left_out] @ b[1:]
    intercept, continues, length = fit(x, y, weights)
    share = np.average(y, weights=weights)
    print(
        f"{len(y)} borders, {share:.2f} within one thing; area under the curve, recordings left out: "
        f"{area_under_curve(scores, y):.3f}"
    )
    print(
        f"BORDER_INTERCEPT, BORDER_CONTINUES, BORDER_LENGTH = "
        f"{intercept - np.log(share / (1.0 - share)):.2f}, {continues:.2f}, {length:.2f}"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
