from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from fakes import write_recording

TESTS = Path(__file__).resolve().parents[1]

# The command with another tracker; then all threads that are left, those of idle pools included.
SCRIPT = """
import os, sys
sys.path.insert(0, {tests!r})
from cuboid.cli import main
from cuboid.cli import track
def run(args):
    import cuboid.runs.pipeline.run, scipy.linalg
    from fakes import FakeTracker
    cuboid.runs.pipeline.run._tracker = FakeTracker
    return original(args)
original, track.run = track.run, run
main(sys.argv[1:])
import cv2
print(len(os.listdir("/proc/self/task")), cv2.getNumThreads())
"""


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="counts threads the Linux way")
@pytest.mark.parametrize(("threads", "pool"), [(1, 1), (2, 1)])
def test_no_library_has_more_threads_than_it_may(tmp_path: Path, threads: int, pool: int) -> None:
    recording = write_recording(tmp_path / "recording", 4)
    words = ["track", str(recording), "--output", str(tmp_path / "out"), "--threads", str(threads)]
    script = SCRIPT.format(tests=str(TESTS))
    done = subprocess.run([sys.executable, "-c", script, *words], capture_output=True, text=True, check=True)
    left, opencv = map(int, done.stdout.splitlines()[-1].split())
    assert (left, opencv) == (1, pool)
