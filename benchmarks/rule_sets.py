"""The recordings by which rules are judged, and the figures of one of them.

python benchmarks/rule_sets.py SET --data DATA --work WORK [--noise SEED]

Prints a JSON list: a row for each truth of the set. SET is one of the real recordings, or a kind and a seed of a made
one ("bin-3"). With `--noise` each depth reading gets noise of a third of the sensor's: figures change by chance alone.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from cuboid import TrackerConfig, open_recording
from cuboid.ground.core.frame import Frame
from cuboid.ground.core.threads import limit_threads
from cuboid.ground.geometry.rectangles import rect_iou_matrix
from cuboid.inputs.readers.recording import Recording
from cuboid.lab.evaluation import evaluate, evaluate_keyframes
from cuboid.lab.evaluation.figures import figures
from cuboid.lab.evaluation.matching import match
from cuboid.lab.synthetic.kinds import FRAMES
from cuboid.runs.pipeline.options import ResultOptions, TrackOptions
from cuboid.runs.pipeline.run import track_recording
from cuboid.runs.tracking.posed_tracker import PosedTracker
from proposal_sources import FIT, View, stills
from scenes import Case, MadeScene, made
from still_recordings import SHAKE_M

TRUTH = Path(__file__).resolve().parent / "truth"
# Standard deviation of the added noise of depth, as a fraction of the sensor's.
ADDED_NOISE = 0.3
# Kinds whose way is long: they get half as many frames.
LONG_KINDS = ("occluders", "leave", "tables", "room")
# Frames that watch each still.
STILL_FRAMES = 8
KEYS = ("recall_25", "precision_25", "recall_50", "precision_50", "hota", "idf1_25", "idf1_50", "switches", "fragments")


@dataclass(frozen=True, slots=True)
class RealSet:
    """A real recording with its truth.

    Attributes
    ----------
    recording : str
        Under the folder of data.
    truths : tuple of str
        Boxes, as of `evaluate`, under the folder of data.
    keyframes : tuple of str
        Rectangles, under the folder of data, or under `truth` beside this file.
    every, limit
        As of `cuboid track`.
    """

    recording: str
    truths: tuple[str, ...] = ()
    keyframes: tuple[str, ...] = ()
    every: int = 1
    limit: int | None = None


REAL = {
    "desk": RealSet("desk-realsense", (), ("desk-realsense/keyframes.json", "desk-realsense-second.json")),
    "fr1-xyz": RealSet("rgbd_dataset_freiburg1_xyz", (), ("rgbd_dataset_freiburg1_xyz.json",), limit=210),
    "scene-01": RealSet(
        "rgbd-scenes-v2/imgs/scene_01", ("rgbd-scenes-v2/ground_truth/01.json",), ("rgbd-scenes-v2.json",), every=3
    ),
    "office": RealSet("office-scan", ("office-scan/truth.json",), ("office-scan.json",)),
    "dish": RealSet("dish-from-above", (), ("dish-from-above.json",)),
    "bin-robot-hand": RealSet("bin-robot-hand", (), ("bin-robot-hand/keyframes.json",)),
}
STILLS = "hots"


def judge(name: str, data: Path, work: Path, noise: int | None) -> list[dict[str, Any]]:
    """Return the rows of a set."""
    with added_noise(noise):
        if name == STILLS:
            return [_stills(data, noise)]
        folder = Path(tempfile.mkdtemp(prefix="rules-"))
        try:
            return _judge(name, data, work, folder / "result")
        finally:
            shutil.rmtree(folder)


def _judge(name: str, data: Path, work: Path, output: Path) -> list[dict[str, Any]]:
    if name in REAL:
        real = REAL[name]
        recording = data / real.recording
        _track(recording, output, real.every, real.limit)
        rows = [_row(f"{name} 3D", figures(evaluate(output, data / truth))) for truth in real.truths]
        for truth in real.keyframes:
            path = data / truth if "/" in truth else TRUTH / truth
            rows.append(_row(f"{name} {path.stem}", _of_keyframes(output, path, recording)))
        return rows
    case = made_case(name, work)
    _track(case.recording, output, 1, None)
    return [_row(name, figures(evaluate(output, case.truth)))]


def made_case(name: str, work: Path) -> Case:
    """Return a made recording, such as "bin-3", rendering it unless `work` has it."""
    kind, seed = name.split("-")
    return made(MadeScene(kind, int(seed), FRAMES[kind] // 2 if kind in LONG_KINDS else None), work)


def _track(recording: Path, output: Path, every: int, limit: int | None) -> None:
    track_recording(
        open_recording(recording), output, TrackOptions(every=every, limit=limit), results=ResultOptions(page=False)
    )


def _row(name: str, found: dict[str, Any]) -> dict[str, Any]:
    return {"name": name, **{key: found.get(key) for key in KEYS}}


def _of_keyframes(output: Path, keyframes: Path, recording: Path) -> dict[str, Any]:
    high, low = evaluate_keyframes(output, keyframes, recording).at
    return {
        "recall_25": low.recall,
        "precision_25": low.precision,
        "recall_50": high.recall,
        "precision_50": high.precision,
        "idf1_25": low.idf1,
        "idf1_50": high.idf1,
    }


def _stills(data: Path, noise: int | None) -> dict[str, Any]:

    views = list(stills(data / STILLS))
    if noise is not None:
        rng = np.random.default_rng(noise)
        views = [view._replace(frame=_noisy(view.frame, rng)) for view in views]
    wanted, labelled, false = np.sum([_judge_still(view) for view in views], axis=0).tolist()
    return _row(STILLS, {"recall_50": labelled / wanted, "precision_50": labelled / max(1, labelled + false)})


def _judge_still(view: View) -> np.ndarray:
    """Return of a still the objects to be found, those with a label in the last frame, and the false labels."""
    rng, tracker = np.random.default_rng(0), PosedTracker(view.intrinsics)
    for index in range(STILL_FRAMES):
        T = np.eye(4)
        T[:3, 3] = rng.normal(0.0, SHAKE_M, 3)
        found = tracker.update(Frame(index, index / 30.0, view.frame.color, view.frame.depth_m, T))
    seen = np.array([one.rect_xyxy for one in found.sightings]).reshape(-1, 4)
    pairs = match(rect_iou_matrix(view.rectangles, seen), FIT)
    return np.array([view.wanted.sum(), sum(bool(view.wanted[i]) for i, _ in pairs), len(seen) - len(pairs)])


@contextmanager
def added_noise(seed: int | None) -> Iterator[None]:
    """Add a little noise to the depth of all recordings."""
    if seed is None:
        yield
        return
    read = Recording.read

    def noisy(self: Recording, index: int) -> Frame:
        return _noisy(read(self, index), np.random.default_rng([seed, index]))

    with patch.object(Recording, "read", noisy):
        yield


def _noisy(frame: Frame, rng: np.random.Generator) -> Frame:
    depth_m = frame.depth_m
    sigma_m = ADDED_NOISE * TrackerConfig().depth_noise_per_m * depth_m**2
    noisy_m = depth_m + rng.standard_normal(depth_m.shape, np.float32) * sigma_m
    return replace(frame, depth_m=np.maximum(noisy_m, 0.0).astype(np.float32))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sets", nargs="+", metavar="SET")
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--noise", type=int, default=None, metavar="SEED")
    args = parser.parse_args()
    limit_threads(1)
    rows = [row for name in args.sets for row in judge(name, args.data, args.work, args.noise)]
    print(json.dumps(rows))


if __name__ == "__main__":
    main()
