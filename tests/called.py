"""A command of the program, run in this process: it loads packages and kernels no second time."""

from __future__ import annotations

import contextlib
import io
import subprocess

from cuboid.cli import main


def called(*words: object) -> subprocess.CompletedProcess[str]:
    """Run a command, and return its status and what it printed."""
    call, out, err = [*map(str, words)], io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = main(call)
    return subprocess.CompletedProcess(call, status, out.getvalue(), err.getvalue())
