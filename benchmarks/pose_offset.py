"""The offset between the clocks of given poses and images: made recordings with a known one, and real ones as they are.

python benchmarks/pose_offset.py --work DIR [--recordings RECORDING ...] [--seed N] [--json]

Made recordings: hand-held, 30 Hz, 10 s, six kinds of scenes. The times of their poses are moved by each offset. With
true times, poses get noise of 5 mm, of 0.5 degrees, drift and jumps, which must give no offset. Columns: the offset
that was found with its 95 % interval, whether a run corrects it, processor time with reading,
and whether a warning names poses that fit worse than the images' own motion.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from cuboid.cli import main as cuboid
from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.pose_stream import PoseStream
from cuboid.ground.core.threads import limit_threads
from cuboid.ground.geometry import se3
from cuboid.inputs.readers import Recording
from cuboid.inputs.readers import open_recording as read_recording
from cuboid.lab.synthetic.paths import POSE_NOISES
from cuboid.runs.pipeline.opening import measured as measured_clock
from tables import cell, dump, show

KINDS = ("table", "tables", "clutter", "room", "desk", "kitchen")
FRAMES, SIZE = 300, "320x240"
# Moved times, milliseconds; noise of each pose, metres and radians.
OFFSETS_MS = (-80, -40, -15, 0, 15, 40, 80)
NOISE_M, NOISE_RAD = 0.005, np.radians(0.5)
# A found offset is right within this, milliseconds.
RIGHT_MS = 3.0
HEADER = (
    "recording",
    "poses",
    "found ms",
    "95 % +-",
    "corrected",
    "disagreement mm",
    "with it",
    "motions",
    "s",
    "misfit named",
)


class Moved(Recording):
    """A recording with other poses."""

    def __init__(self, recording: Recording, poses: dict[int, Float64Array]) -> None:
        self.__dict__.update(recording.__dict__)
        self._other = poses

    def pose(self, index: int) -> Float64Array:
        """Return the other pose; raises FrameError where there is none."""
        if index not in self._other:
            raise FrameError("no pose")
        return self._other[index]


def variants(recording: Recording) -> Iterator[tuple[str, float | None, Recording]]:
    """Yield the recording with moved times, and with noise: a name, the true offset in ms, the recording."""
    poses = [recording.pose(k) for k in range(len(recording))]
    true = np.array([pose for pose in poses if pose is not None])
    times_s = np.array([recording.timestamp_s(k) for k in range(len(recording))])
    stream = PoseStream("the recording", times_s, list(true))
    for offset_ms in OFFSETS_MS:
        moved = {}
        for k, time_s in enumerate(times_s):
            at_s = time_s + 1e-3 * offset_ms
            if times_s[0] <= at_s <= times_s[-1]:
                moved[k] = stream.at(at_s)
        yield f"{-offset_ms:+d} ms", -offset_ms, Moved(recording, moved)
    rng = np.random.default_rng(5)
    noisy = {"5 mm": (NOISE_M, 0.0), "0.5 degrees": (0.0, NOISE_RAD)}
    for name, deviations in noisy.items():
        motions = rng.normal(size=(len(true), 6)) * np.repeat(deviations, 3)
        yield (
            name,
            0.0,
            Moved(recording, {k: T @ se3.exp(x) for k, (T, x) in enumerate(zip(true, motions, strict=True))}),
        )
    for name in ("drift", "jumps"):
        yield name, 0.0, Moved(recording, dict(enumerate(POSE_NOISES[name](true, np.random.default_rng(5)))))


def measured(name: str, poses: str, true_ms: float | None, recording: Recording) -> dict[str, Any]:
    """Return the figures of one recording whose times of poses are off by `true_ms`: its negative is to be added."""
    begun_s = time.process_time()
    found, misfit = measured_clock(recording)
    row: dict[str, Any] = {
        "recording": name,
        "poses": poses,
        "seconds": time.process_time() - begun_s,
        "misfit": misfit,
    }
    if found is None:
        return {**row, "found": None, "right": True, "corrected": False}
    applied_ms = 0.0 if found.doubt else 1e3 * found.offset_s
    wanted_ms = None if true_ms is None else -true_ms
    right = wanted_ms is None or (abs(applied_ms - wanted_ms) <= RIGHT_MS if wanted_ms else applied_ms == 0.0)
    return {
        **row,
        "found": 1e3 * found.offset_s,
        "error": 1e3 * found.error_s,
        "corrected": not found.doubt,
        "before": 1e3 * found.before_m,
        "after": 1e3 * found.after_m,
        "motions": found.motions,
        "right": right,
    }


def made(kind: str, seed: int, work: Path) -> Recording:
    """Return a made recording, which is kept."""
    folder = work / f"{kind}-{seed}"
    if not folder.is_dir():
        words = ["--kind", kind, "--seed", str(seed), "--motion", "handheld", "--frames", str(FRAMES), "--size", SIZE]
        cuboid(["synth", *words, "--output", str(folder)])
    return read_recording(folder)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, required=True, metavar="DIR", help="keeps made recordings")
    parser.add_argument("--recordings", type=Path, nargs="+", default=[], metavar="RECORDING", help="real recordings")
    parser.add_argument("--seed", type=int, default=5, metavar="N")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    limit_threads(1)
    rows = []
    for kind in KINDS:
        recording = made(kind, args.seed, args.work)
        rows += [measured(kind, *variant) for variant in variants(recording)]
    judged = [row for row in rows if row["poses"].endswith(" ms")]
    rows += [measured(path.name, "as recorded", None, read_recording(path)) for path in args.recordings]
    if args.json:
        dump(rows)
        return
    lines = [
        [
            row["recording"],
            row["poses"],
            *(cell(row.get(key), 1) for key in ("found", "error")),
            "yes" if row["corrected"] else "no",
            *(cell(row.get(key), 2) for key in ("before", "after")),
            str(row.get("motions", "")),
            cell(row["seconds"], 1),
            "yes" if row["misfit"] else "no",
        ]
        for row in rows
    ]
    show("Offset of the clock of poses", HEADER, lines)
    print(f"{sum(row['right'] for row in judged)} of {len(judged)} moved clocks are found within {RIGHT_MS:g} ms")
    others = [row for row in rows if row not in judged and row["poses"] != "as recorded"]
    print(f"{sum(row['corrected'] for row in others)} of {len(others)} with noise, drift or jumps are corrected")


if __name__ == "__main__":
    main()
