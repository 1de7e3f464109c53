"""Fragments and identities against noise of the poses, with merging and without."""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from cuboid import open_recording
from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.frame import Frame
from cuboid.ground.formats.folder import TRACKS
from cuboid.ground.geometry import se3
from cuboid.lab.evaluation import evaluate
from cuboid.lab.evaluation.figures import figures
from cuboid.lab.synthetic.paths import POSE_NOISES
from cuboid.method.objects.object_map import ObjectMap
from cuboid.results.files import read_tracks
from cuboid.runs.pipeline.options import TrackOptions
from cuboid.runs.pipeline.run import track_recording
from scenes import Case, cases
from scoring import mean, total
from tables import cell, dump, show

# Multiples of the noise of `cuboid synth --pose-noise`: drift of 1 mm and 0.03 degrees a frame, jumps of 1 to 3.5 cm.
LEVELS = {"drift": (0.0, 0.5, 1.0, 2.0, 4.0), "jumps": (0.5, 1.0, 2.0)}
HEADER = (
    "poses",
    "error cm",
    "merging",
    "fragments",
    "labels",
    "boxes",
    "objects",
    "IDF1 .25",
    "HOTA",
    "switches",
    "recall .5",
    "precision .5",
)


class Shaken:
    """A recording with other poses."""

    has_poses = True

    def __init__(self, folder: Path, noise: str, level: float) -> None:
        self._recording = open_recording(folder)
        self.path, self.format = self._recording.path, self._recording.format
        self.intrinsics, self.distortion = self._recording.intrinsics, self._recording.distortion
        self.depth_units_per_metre = self._recording.depth_units_per_metre
        self.depth_camera = self._recording.depth_camera
        poses = [self._recording.read(k).T_world_camera for k in range(len(self))]
        true = np.array([np.eye(4) if pose is None else pose for pose in poses])
        wrong = POSE_NOISES[noise](true, np.random.default_rng(5))
        self.poses = np.array([_scaled(a, b, level) for a, b in zip(true, wrong, strict=True)])
        self.error_cm = 100 * float(np.sqrt(((self.poses[:, :3, 3] - true[:, :3, 3]) ** 2).sum(1).mean()))

    def __len__(self) -> int:
        return len(self._recording)

    def pose(self, index: int) -> Float64Array:
        """Return the other pose of a frame."""
        return np.asarray(self.poses[index], np.float64)

    def read(self, index: int) -> Frame:
        """Return a frame with its other pose."""
        return replace(self._recording.read(index), T_world_camera=self.poses[index])


def _scaled(true: Float64Array, wrong: Float64Array, level: float) -> Float64Array:
    """Return the true pose (4, 4) with its error made larger."""
    return np.asarray(true @ se3.exp(level * se3.log(se3.inverse(true) @ wrong)))


@contextmanager
def merging(allowed: bool) -> Iterator[None]:
    """Keep a map of objects from ever making two of its objects one."""
    if allowed:
        yield
        return
    with patch.object(ObjectMap, "_merge", lambda *_: None):
        yield


def one(case: Case, recording: Shaken, allowed: bool, args: argparse.Namespace) -> dict[str, Any]:
    """Return the figures of a scene with these poses."""
    output = args.work / "runs" / "poses" / case.name
    if output.exists():
        shutil.rmtree(output)
    with merging(allowed):
        track_recording(recording, output, TrackOptions(every=args.every, limit=args.limit))
    labels = len({row.label for row in read_tracks(output / TRACKS)})
    found = figures(evaluate(output, case.truth))
    return {"scene": case.name, "error_cm": recording.error_cm, "labels": labels, **found}


def run(args: argparse.Namespace) -> None:
    """Print the table, or all figures."""
    chosen = cases(args.kinds, args.seeds, args.work, args.data)
    found = []
    for noise, levels in LEVELS.items():
        for level in levels:
            shaken = [Shaken(case.recording, noise, level) for case in chosen]
            for allowed in (True, False):
                rows = [one(case, recording, allowed, args) for case, recording in zip(chosen, shaken, strict=True)]
                found.append({"noise": noise, "level": level, "merging": allowed, "scenes": rows})
    if args.json:
        dump(found)
        return
    lines = []
    for item in found:
        rows = item["scenes"]
        lines.append(
            [
                f"{item['noise']} x {item['level']:g}" if item["level"] else "given",
                cell(mean(rows, "error_cm"), 2),
                "yes" if item["merging"] else "no",
                *(total(rows, key) for key in ("fragments", "labels", "proposals", "objects")),
                *(mean(rows, key) for key in ("idf1_25", "hota")),
                total(rows, "switches"),
                *(mean(rows, key) for key in ("recall_50", "precision_50")),
            ]
        )
    show(f"Noise of the poses, over {', '.join(case.name for case in chosen)}", HEADER, lines)
