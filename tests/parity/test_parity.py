"""Agreement with the well-known evaluators, which live in an environment of their own (requirements.txt here)."""

from __future__ import annotations

import json
import math
import os
import subprocess
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cuboid.lab.evaluation.boxes import THRESHOLDS
from cuboid.lab.evaluation.clear import clear, correspondences
from cuboid.lab.evaluation.hota import hota
from cuboid.lab.evaluation.matching import FrameOverlap

HERE = Path(__file__).parent
PYTHON = os.environ.get("CUBOID_PARITY")

pytestmark = pytest.mark.skipif(
    not PYTHON,
    reason="set CUBOID_PARITY to the python of an environment with tests/parity/requirements.txt",
)


def sequence(rng: np.random.Generator) -> list[FrameOverlap]:
    """Objects that come and go; labels that mostly keep to an object, swap, vanish, and turn up from nowhere."""
    objects, labels, frames = rng.integers(1, 9), rng.integers(1, 12), rng.integers(1, 60)
    seen, swap = rng.uniform(0.2, 1.0), rng.uniform(0.0, 0.3)
    owner = rng.integers(0, objects, labels)
    overlaps = []
    for k in range(frames):
        if rng.random() < swap:
            owner = rng.permutation(owner)
        truth = np.flatnonzero(rng.random(objects) < seen)
        found = rng.permutation(np.flatnonzero(rng.random(labels) < seen))
        near = truth[:, None] == owner[found][None, :]
        iou = np.where(near, rng.beta(4, 2, near.shape), rng.beta(1, 5, near.shape))
        iou[rng.random(near.shape) < 0.2] = 0.0
        overlaps.append(FrameOverlap(k, truth, found, iou))
    return overlaps


def cases() -> list[list[FrameOverlap]]:
    rng = np.random.default_rng(20)
    return [sequence(rng) for _ in range(300)]


def ours(frames: list[FrameOverlap]) -> dict[str, Any]:
    objects, labels = (
        1 + max(int(getattr(frame, name).max(initial=-1)) for frame in frames) for name in ("truth", "found")
    )
    return {
        "hota": asdict(hota(frames, objects, labels)),
        "clear": [asdict(clear(frames, correspondences(frames, threshold), threshold)) for threshold in THRESHOLDS],
    }


def test_metrics_agree_with_motmetrics_and_trackeval() -> None:
    sequences = cases()
    asked = [
        [{"truth": f.truth.tolist(), "found": f.found.tolist(), "iou": f.iou.tolist()} for f in frames]
        for frames in sequences
    ]
    done = subprocess.run(
        [str(PYTHON), str(HERE / "oracles.py")],
        input=json.dumps(asked),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    answers = json.loads(done.stdout.splitlines()[-1])
    differences = [
        (abs(mine - theirs), name)
        for frames, answer in zip(sequences, answers, strict=True)
        for name, mine, theirs in pairs_of(ours(frames), answer)
    ]
    worst, where = max(differences)
    print(f"{len(differences)} figures of {len(sequences)} sequences; largest difference {worst:.1e} ({where})")
    assert worst < 1e-6, where


def pairs_of(mine: dict[str, Any], theirs: dict[str, Any]) -> Iterator[tuple[str, float, float]]:
    """Iterate over the figures that both know: name, ours, theirs; what is undefined for both is left out."""
    parts = [(mine["hota"], theirs["hota"]), *zip(mine["clear"], theirs["clear"], strict=True)]
    for known, reference in parts:
        for name, value in reference.items():
            for a, b in zip(np.atleast_1d(known[name]), np.atleast_1d(value), strict=True):
                undefined = a is None, math.isnan(b)
                assert undefined in ((False, False), (True, True)), f"{name}: {a} against {b}"
                if a is not None:
                    yield name, float(a), float(b)
