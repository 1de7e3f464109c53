"""Tracking loads what it needs and no more."""

from __future__ import annotations

import subprocess
import sys

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
