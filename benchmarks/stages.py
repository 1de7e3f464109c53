"""Stages of a frame side by side with Open3D and OpenCV: proposals, odometry, fusion, the whole frame.

python benchmarks/stages.py RECORDING --work DIR [--limit N] [--json]

RECORDING has poses. The first call makes an environment for the peers in DIR (`requirements-peers.txt`), or
`--peers-python` names one. Each frame goes to Open3D, to OpenCV (each in a process of its own) and to Cuboid, by turns;
a figure is the processor time of a stage in a frame, one thread, without decoding. The peers get images of half the
width and height, the size at which Cuboid works; its own reduction is part of its time.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
import venv
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from cuboid import CuboidError, open_recording
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.downscaling import downscale
from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.threads import limit_threads
from cuboid.inputs.readers import Recording
from cuboid.lab.evaluation.timed_poses import TimedPoses
from cuboid.lab.evaluation.trajectory import evaluate_trajectory
from cuboid.method.poses import PoseEstimator
from cuboid.method.proposals import make_source
from cuboid.runs.tracking import measuring
from cuboid.runs.tracking.posed_tracker import PosedTracker
from tables import cell, dump, show

HERE = Path(__file__).parent
PEER_SCALE = 2
# Frames that load and fill caches are not timed.
WARM_UP = 10
STAGES = ("proposals", "odometry", "fusion", "whole, given poses", "whole, own poses")
PEERS = {"Open3D": "open3d", "OpenCV": "opencv"}


class Ours:
    """The stages of Cuboid."""

    def __init__(self, intrinsics: Intrinsics) -> None:
        measuring.working_s = time.thread_time  # stages of the tracker in processor time
        self._intrinsics = intrinsics
        self._propose = make_source(None, TrackerConfig())
        self._estimator, self._tracker = PoseEstimator(intrinsics), PosedTracker(intrinsics)

    def stages(self, frame: Frame) -> dict[str, Any]:
        """Run all stages on a frame."""
        begun = time.thread_time()
        proposals = self._propose(frame, self._intrinsics)
        proposed = time.thread_time()
        self._estimator.update(Frame(frame.index, frame.timestamp_s, frame.color, frame.depth_m))
        located = time.thread_time()
        result = self._tracker.update(frame)
        whole = 1e3 * (time.thread_time() - located)
        odometry = 1e3 * (located - proposed)
        return {
            "proposals": 1e3 * (proposed - begun),
            "odometry": odometry,
            "fusion": result.milliseconds["fuse"],
            "whole, given poses": whole,
            "whole, own poses": whole + odometry,
            "count": len(proposals),
            "labels": [item.label for item in self._tracker.objects],
        }

    def trajectory(self) -> dict[int, np.ndarray]:
        """Return the corrected poses."""
        return self._estimator.trajectory()


@contextmanager
def peer_of(python: Path, name: str, K: Intrinsics, voxel_m: float) -> Iterator[subprocess.Popen[bytes]]:
    """Start a peer in a process of its own."""
    words = [name, K.width, K.height, K.fx, K.fy, K.cx, K.cy, voxel_m]
    call = [str(python), str(HERE / "peer_stages.py"), *map(str, words)]
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"} | {"OMP_NUM_THREADS": "1"}
    with subprocess.Popen(call, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment) as process:
        yield process


def ask(peer: subprocess.Popen[bytes], frame: Frame) -> dict[str, Any]:
    """Let a peer run its stages on a frame."""
    assert peer.stdin is not None
    assert peer.stdout is not None
    assert frame.T_world_camera is not None
    peer.stdin.write(
        frame.color.tobytes() + frame.depth_m.tobytes() + frame.T_world_camera.astype(np.float64).tobytes()
    )
    peer.stdin.flush()
    line = peer.stdout.readline()
    if not line:
        raise InputError("a peer has ended; its message is above")
    answer: dict[str, Any] = json.loads(line)
    return answer


def peers_python(work: Path) -> Path:
    """Return the Python of an environment with the peers, made if there is none."""
    python = work / "peers" / "bin" / "python"
    if not python.exists():
        venv.create(work / "peers", with_pip=True)
        pip = [str(python), "-m", "pip", "install", "-q", "-r", str(HERE / "requirements-peers.txt")]
        subprocess.run(pip, check=True)
    return python


def measure(recording: Recording, python: Path, limit: int, names: Sequence[str] = tuple(PEERS)) -> dict[str, Any]:
    """Run all stages of Cuboid and of the named peers; return medians, and what came out."""
    K = recording.intrinsics
    small, voxel_m = K.downscaled(PEER_SCALE), TrackerConfig().voxel_m
    rows: dict[str, list[dict[str, Any]]] = {name: [] for name in ("Cuboid", *names)}
    ours, true = Ours(K), dict[int, np.ndarray]()
    times_s = dict[int, float]()
    with ExitStack() as opened:
        peers = {name: opened.enter_context(peer_of(python, PEERS[name], small, voxel_m)) for name in names}
        for index in range(min(limit, len(recording))):
            with suppress(FrameError):
                frame = recording.read(index)
                if frame.T_world_camera is None:
                    continue
                reduced = downscale(frame, PEER_SCALE)
                answers = {name: ask(peer, reduced) for name, peer in peers.items()}
                answers["Cuboid"] = ours.stages(frame)
                for name, row in answers.items():
                    rows[name].append(row)
                times_s[index], true[index] = frame.timestamp_s, frame.T_world_camera
        for peer in peers.values():
            assert peer.stdin is not None
            peer.stdin.close()
    found = {name: {k: np.array(row["T"]) for k, row in zip(times_s, rows[name], strict=True)} for name in names}
    found["Cuboid"] = ours.trajectory()
    truth = timed_poses(recording.path, true, times_s)
    return {name: figures(rows[name], timed_poses(recording.path, found[name], times_s), truth) for name in rows}


def timed_poses(path: Path, poses: Mapping[int, np.ndarray], times_s: Mapping[int, float]) -> TimedPoses:
    """Return the poses of frames at their times, both by frame; a frame may have no pose, or no time."""
    frames = [k for k in times_s if k in poses]
    T_world_camera = np.array([poses[k] for k in frames]).reshape(-1, 4, 4)
    return TimedPoses(path, np.array([times_s[k] for k in frames]), T_world_camera)


def figures(rows: list[dict[str, Any]], estimate: TimedPoses, truth: TimedPoses) -> dict[str, Any]:
    """Return the figures of one program."""
    timed = rows[WARM_UP:] or rows
    labels = {label for row in rows for label in row.get("labels", ())}
    return {
        **{stage: float(np.median([row[stage] for row in timed])) for stage in STAGES if stage in rows[0]},
        "frames": len(rows),
        "proposals in a frame": float(np.median([row["count"] for row in timed])),
        "ATE cm": evaluate_trajectory(estimate, truth).ate_cm.rmse,
        "labels": len(labels) if "labels" in rows[0] else None,
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--work", type=Path, required=True, metavar="DIR")
    parser.add_argument("--peers-python", type=Path, default=None, metavar="PYTHON")
    parser.add_argument("--limit", type=int, default=100, metavar="N", help="use at most N frames")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    limit_threads(1)
    try:
        found = measure(open_recording(args.recording), args.peers_python or peers_python(args.work), args.limit)
    except CuboidError as error:
        print(f"stages: {error}", file=sys.stderr)
        return 2
    if args.json:
        dump(found)
        return 0
    own = found["Cuboid"]
    rows = [
        [stage, *(ratio_cell(found[name].get(stage), own[stage]) for name in ("Cuboid", *PEERS))] for stage in STAGES
    ]
    rows += [
        [what, *(cell(found[name][what], 2) for name in found)] for what in ("proposals in a frame", "ATE cm", "labels")
    ]
    show(f"{own['frames']} frames, milliseconds of processor time (times Cuboid's)", ("stage", *found), rows)
    return 0


def ratio_cell(ms: float | None, own_ms: float) -> str:
    """Return a time with its ratio to Cuboid's."""
    return "-" if ms is None else f"{ms:.1f} ({ms / own_ms:.1f})"


if __name__ == "__main__":
    sys.exit(main())
