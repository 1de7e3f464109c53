from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parents[1]

# The largest file that the process may write stands in for a full disk: the rows, the map, or what is still
# in a buffer when the files are closed do not fit.
SCRIPT = """
import resource, sys
sys.path.insert(0, {tests!r})
from pathlib import Path
import numpy as np
from fakes import FakeRecording, FakeTracker
from cuboid.ground.core.errors import OutputError
from cuboid.ground.core.results import MapPoints
from cuboid.runs.pipeline.options import ResultOptions, RunHooks
from cuboid.runs.pipeline.run import track_recording

class Tracker(FakeTracker):
    def map_points(self):
        n = {points}
        return MapPoints(np.zeros((n, 3), np.float32), np.zeros((n, 3), np.uint8), np.zeros(n, np.float32),
                         np.zeros(n, np.int32))

resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))
try:
    results, hooks = ResultOptions(force={force}), RunHooks(make_tracker=Tracker)
    track_recording(FakeRecording({frames}), Path({output!r}), results=results, hooks=hooks)
except OutputError as error:
    print(error)
    sys.exit(2)
"""


@pytest.mark.parametrize(
    ("frames", "points", "limit", "named"),
    [(1000, 10, 20_000, "tracks.csv"), (10, 10_000, 50_000, "map.ply"), (20, 10, 1_000, "out")],
)
@pytest.mark.parametrize("force", [False, True])
def test_nothing_that_looks_whole_is_left(
    tmp_path: Path, frames: int, points: int, limit: int, named: str, force: bool
) -> None:
    output = tmp_path / "out"
    if force:
        output.mkdir()
        (output / "run.json").write_text("old")
    script = SCRIPT.format(tests=str(TESTS), points=points, limit=limit, frames=frames, output=str(output), force=force)
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 2, done.stderr
    assert named in done.stdout
    assert "cannot be written" in done.stdout
    assert ".partial" not in done.stdout
    assert done.stderr == ""
    left = {path.name: path.read_text() for path in output.iterdir()} if output.exists() else {}
    assert left == ({"run.json": "old"} if force else {})
    assert [path.name for path in tmp_path.iterdir()] == (["out"] if force else [])
