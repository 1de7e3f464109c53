"""Camera poses from the video: this program's, OpenCV's odometry and Open3D's, on the same frames.

python benchmarks/odometry.py RECORDING ... [--peers-python PYTHON] [--every N] [--limit N] [--json]

Each RECORDING has true poses (`docs/recordings.md`; what `cuboid synth` writes). OpenCV is `cv2.Odometry` with color
and depth as it comes. Open3D is `peer_open3d_odometry.py`, run by `--peers-python` (`requirements-peers.txt` says what
that needs), on images of half the width and height: at full size it takes six times as long. Both go from each frame
to the one before, or to a keyframe (a new one after 10 cm or 8 degrees); where they fail the camera is taken to stand
still. ATE is after the rigid motion that fits best, RPE that of stretches of a second, times are processor time of a
frame on one thread, without decoding.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from cuboid import CuboidError, open_recording
from cuboid.ground.core.downscaling import downscale
from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.threads import limit_threads
from cuboid.inputs.readers import Recording
from cuboid.lab.evaluation.timed_poses import TimedPoses
from cuboid.lab.evaluation.trajectory import evaluate_trajectory
from cuboid.method.poses import PoseEstimator
from following import Follower
from tables import cell, dump, show

# Open3D gets images smaller by this.
PEER_SCALE = 2
# Frames that compile and load are not timed.
WARM_UP = 10
HEADER = ("recording", "poses by", "ATE cm", "RPE cm / s", "RPE degrees / s", "without a pose", "ms median", "ms p95")
# Takes a frame in; returns T_world_camera or None, and milliseconds.
Way = Callable[[Frame], tuple[np.ndarray | None, float]]


class Ours:
    """The pose estimator; its poses are those as corrected at the end."""

    def __init__(self, intrinsics: Intrinsics) -> None:
        self._estimator = PoseEstimator(intrinsics)

    def __call__(self, frame: Frame) -> tuple[np.ndarray | None, float]:
        """Take a frame in."""
        begun = time.thread_time()
        found = self._estimator.update(frame).T_world_camera
        return found, 1e3 * (time.thread_time() - begun)

    def final(self) -> dict[int, np.ndarray]:
        """Return the corrected poses."""
        return self._estimator.trajectory()


def opencv(intrinsics: Intrinsics, keyframes: bool) -> Way:
    """Return `cv2.Odometry` with its own settings."""
    settings = cv2.OdometrySettings()
    K = np.array([[intrinsics.fx, 0, intrinsics.cx], [0, intrinsics.fy, intrinsics.cy], [0, 0, 1]])
    settings.setCameraMatrix(K.astype(np.float32))
    odometry = cv2.Odometry(cv2.ODOMETRY_TYPE_RGB_DEPTH, settings, cv2.ODOMETRY_ALGO_TYPE_COMMON)

    def align(reference: Any, frame: Any, T: np.ndarray) -> np.ndarray | None:
        done, found = odometry.compute(frame, reference, T.copy())
        return np.asarray(found) if done and np.isfinite(found).all() else None

    follower = Follower(align, keyframes)

    def way(frame: Frame) -> tuple[np.ndarray | None, float]:
        begun = time.thread_time()
        image = cv2.OdometryFrame(frame.depth_m, cv2.cvtColor(frame.color, cv2.COLOR_RGB2BGR))
        odometry.prepareFrame(image)
        T = follower.add(image)
        return T, 1e3 * (time.thread_time() - begun)

    return way


@contextmanager
def open3d(python: Path, intrinsics: Intrinsics, keyframes: bool) -> Iterator[Way]:
    """Give Open3D's odometry, in a process of its own."""
    K = intrinsics.downscaled(PEER_SCALE)
    script = Path(__file__).with_name("peer_open3d_odometry.py")
    words = [K.width, K.height, K.fx, K.fy, K.cx, K.cy, *(["--keyframes"] if keyframes else [])]
    with subprocess.Popen(
        [python, script, *map(str, words)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    ) as peer:
        assert peer.stdin is not None
        assert peer.stdout is not None
        stdin, stdout = peer.stdin, peer.stdout

        def way(frame: Frame) -> tuple[np.ndarray | None, float]:
            small = downscale(frame, PEER_SCALE)
            stdin.write(small.color.tobytes() + small.depth_m.tobytes())
            stdin.flush()
            values = [float(word) for word in stdout.readline().split()]
            return np.array(values[:16]).reshape(4, 4), values[16]

        yield way
        stdin.close()


def frames_of(recording: Recording, every: int, limit: int | None) -> Iterator[Frame]:
    """Iterate over the frames that can be used, without their poses."""
    bare = recording.without_poses()
    for index in range(0, len(bare), every)[:limit]:
        with suppress(FrameError):
            yield bare.read(index)


def truth_of(recording: Recording, frames: list[int]) -> TimedPoses:
    """Return the true poses of those frames that have one."""
    times, poses = [], []
    for index in frames:
        with suppress(FrameError):
            pose = recording.pose(index)
            if pose is not None:
                times.append(recording.timestamp_s(index))
                poses.append(pose)
    return TimedPoses(recording.path, np.array(times), np.array(poses).reshape(-1, 4, 4))


def measure(recording: Recording, way: Way, args: argparse.Namespace) -> dict[str, Any]:
    """Run over a recording; return the figures."""
    poses: dict[int, np.ndarray] = {}
    milliseconds, frames = [], []
    for frame in frames_of(recording, args.every, args.limit):
        T, ms = way(frame)
        frames.append(frame.index)
        milliseconds.append(ms)
        if T is not None:
            poses[frame.index] = T
    lost = len(frames) - len(poses)
    poses = way.final() if isinstance(way, Ours) else poses
    times = np.array([recording.timestamp_s(index) for index in sorted(poses)])
    estimate = TimedPoses(recording.path, times, np.array([poses[index] for index in sorted(poses)]))
    found = evaluate_trajectory(estimate, truth_of(recording, frames))
    second = found.per_second
    timed = milliseconds[WARM_UP:] or milliseconds
    return {
        "ate_cm": found.ate_cm.rmse,
        "rpe_cm_s": None if second.translation_cm is None else second.translation_cm.rmse,
        "rpe_deg_s": None if second.rotation_deg is None else second.rotation_deg.rmse,
        "frames": len(frames),
        "lost": lost,
        "ms_median": float(np.median(timed)),
        "ms_p95": float(np.percentile(timed, 95)),
    }


def compare(recording: Recording, args: argparse.Namespace) -> dict[str, dict[str, Any]]:
    """Return the figures of every way."""
    K = recording.intrinsics
    found = {"Cuboid": measure(recording, Ours(K), args)}
    for keyframes, how in ((False, "frame to frame"), (True, "frame to keyframe")):
        found[f"cv2.Odometry, {how}"] = measure(recording, opencv(K, keyframes), args)
        if args.peers_python is not None:
            with open3d(args.peers_python, K, keyframes) as way:
                found[f"Open3D, {how}"] = measure(recording, way, args)
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", nargs="+", type=Path, metavar="RECORDING")
    parser.add_argument("--peers-python", type=Path, default=None, metavar="PYTHON")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="use each n-th frame")
    parser.add_argument("--limit", type=int, default=None, metavar="N", help="use at most so many frames")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    limit_threads(1)
    try:
        found = {path.name: compare(open_recording(path), args) for path in args.recordings}
    except CuboidError as error:
        print(f"odometry: {error}", file=sys.stderr)
        return 2
    if args.json:
        dump(found)
        return 0
    rows = [
        [
            name,
            by,
            cell(row["ate_cm"], 2),
            cell(row["rpe_cm_s"], 2),
            cell(row["rpe_deg_s"], 2),
            f"{row['lost']} of {row['frames']}",
            cell(row["ms_median"], 1),
            cell(row["ms_p95"], 1),
        ]
        for name, ways in found.items()
        for by, row in ways.items()
    ]
    show("Poses from the video", HEADER, rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
