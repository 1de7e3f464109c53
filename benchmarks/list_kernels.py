"""Write the list of the kernels that tracking calls, with the types of their arguments, to compile them ahead.

python benchmarks/list_kernels.py [--check]

The kernels are found by tracking a made recording: with its poses, with estimated poses, into a scene, with corrections
of the poses, and with depth from a camera of its own. The list is `src/cuboid/runs/pipeline/kernels.json`, in the order
of need. `--check` writes nothing; the exit status is 1 if the list would change.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from cuboid.ground.compiling import compiletime
from cuboid.ground.compiling.compiled import KERNELS
from cuboid.ground.compiling.kernelcache import KernelCache
from cuboid.ground.compiling.signatures import encode
from cuboid.inputs.readers.depth_camera import DepthCamera
from cuboid.inputs.readers.registration import Registration
from cuboid.runs.pipeline.ahead import LIST
from cuboid.runs.pipeline.options import ResultOptions, TrackOptions
from cuboid.runs.pipeline.run import track_recording
from cuboid.runs.scene.running import IntoScene
from cuboid.runs.tracking.posed_tracker import PosedTracker
from warm_up import CAMERA, MADE_FRAMES, WarmUpRecording


def use_kernels(folder: Path) -> None:
    """Call all kernels of tracking."""
    results = ResultOptions(page=False)
    track_recording(WarmUpRecording(), folder / "given", results=results)
    track_recording(WarmUpRecording(poses=False), folder / "estimated", results=results)
    for visit, memory_mb in enumerate((1e6, 0.0)):  # the second with all parts of the map out of view evicted
        recording, into = WarmUpRecording(noise=0.03), IntoScene(folder / "scene.cuboid")
        options = TrackOptions(memory_mb=memory_mb)
        track_recording(recording, folder / f"visit-{visit}", options, results=results, into=into)
    correct()
    register()


def correct() -> None:
    """Track a few frames, with a correction of the keyframes to which they are anchored."""
    recording, tracker = WarmUpRecording(), PosedTracker(CAMERA)
    for index in range(MADE_FRAMES):
        if index == MADE_FRAMES // 2:
            T_new_old = np.eye(4)
            T_new_old[0, 3] = 0.03
            tracker.apply_correction({1: T_new_old, 2: T_new_old})
        tracker.update(recording.read(index), 1 + index // (MADE_FRAMES // 4))
    tracker.map_points()


def register() -> None:
    """Register a depth image to the color camera beside it."""
    T_color_depth = np.eye(4)
    T_color_depth[0, 3] = 0.02
    c = CAMERA
    depth = DepthCamera(c.fx, c.fy, c.cx, c.cy, (c.width, c.height), T_color_depth)
    Registration(depth, c)(WarmUpRecording().read(0).depth_m, "warm-up")


def called_kernels() -> list[list[Any]]:
    """Return the kernels that are called, each with the types of its arguments, in the order of their first call."""
    found: dict[str, list[Any]] = {}
    load = KernelCache.load_overload

    def recorded(self: KernelCache, sig: Any, target_context: Any) -> Any:
        if not compiletime.compiling():  # a kernel that another one calls is compiled with it
            entry = [self.name, [encode(one) for one in getattr(sig, "args", sig)]]
            found[json.dumps(entry)] = entry
        return load(self, sig, target_context)

    KernelCache.load_overload = recorded  # type: ignore[method-assign]
    try:
        with tempfile.TemporaryDirectory(prefix="cuboid-kernels-") as folder:
            use_kernels(Path(folder))
    finally:
        KernelCache.load_overload = load  # type: ignore[method-assign]
    return list(found.values())


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="only compare with the list")
    args = parser.parse_args()
    entries = called_kernels()
    if any(kernel.cache.compiled for kernel in KERNELS.values()):  # kernels compiled for others were not seen
        os.execv(sys.executable, [sys.executable, *sys.argv])
    lines = [json.dumps(entry) for entry in entries]
    if args.check:  # the order of the first calls is no matter of right and wrong
        return int(sorted(map(json.dumps, json.loads(LIST.read_bytes()))) != sorted(lines))
    LIST.write_text("[\n" + ",\n".join(lines) + "\n]\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
