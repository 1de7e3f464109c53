"""Tracking loads what it needs and no more."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

# What only some features need, of the packages that `pip install .` brings and of the extras.
RARE = ("scipy.spatial", "scipy.optimize", "scipy.sparse", "scipy.special", "av", "rich", "argcomplete", "sqlite3")
RARE += ("trimesh", "onnxruntime", "fsspec", "matplotlib", "distributed", "duckdb", "pyarrow", "starlette", "skimage")

SCRIPT = f"""
import sys
import cuboid
cuboid.Tracker(cuboid.Intrinsics(270.0, 270.0, 159.5, 119.5, 320, 240))
print(*(name for name in {RARE!r} if name in sys.modules))
"""


def test_a_tracker_loads_nothing_rare() -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


RUN = f"""
import sys
from pathlib import Path
sys.path.append({str(Path(__file__).parents[1] / "benchmarks")!r})
from cuboid import track_recording
from warm_up import WarmUpRecording
track_recording(WarmUpRecording(), Path(sys.argv[1]))
print(*sorted({{name.partition(".")[2].partition(".")[0] for name in sys.modules if name.startswith("scipy.")}}))
"""


def test_a_run_with_compiled_kernels_loads_no_large_part_of_scipy(tmp_path: Path) -> None:
    for attempt in ("first", "second"):  # the first one may compile kernels, which loads SciPy's linear algebra
        words = [sys.executable, "-c", RUN, str(tmp_path / attempt)]
        done = subprocess.run(words, capture_output=True, text=True, check=True)
        loaded = {"linalg", "sparse", "spatial", "special", "optimize"} & set(done.stdout.split())
        if not loaded:
            break
    assert not loaded
