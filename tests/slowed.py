"""The real command as a process, with a tracker that takes its time."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

SCRIPT = """
import sys, time
sys.path[:0] = {paths!r}
import cuboid.runs.pipeline.run
from cuboid.cli import main
from fakes import FakeTracker
{before}

class Slowed(FakeTracker):
    def update(self, frame, anchor=0):
        {step}
        return super().update(frame, anchor)

cuboid.runs.pipeline.run._tracker = Slowed
sys.exit(main(sys.argv[1:]))
"""

SAID = "print('frame', frame.index, file=sys.stderr, flush=True)"


def slowed(step: str, *words: object, before: str = "", folder: Path | None = None) -> list[str]:
    """Return the call of a cuboid command.

    Parameters
    ----------
    step : str
        Statements that are run before each frame.
    *words : object
    before : str
        Statements that are run before the command, with the modules of a folder.
    folder : Path, optional
    """
    tests = Path(__file__).resolve().parent
    script = SCRIPT.format(paths=[str(tests), str(folder or tests)], before=before, step=step)
    return [sys.executable, "-c", script, *map(str, words)]


def started(call: list[str], frame: int) -> subprocess.Popen[str]:
    """Start a call of `slowed` that says its frames, and wait for one."""
    process = subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    next(line for line in process.stderr if line.startswith(f"frame {frame}"))
    return process
