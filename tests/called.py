"""A command of the program, run in this process: it loads packages and kernels no second time."""

from __future__ import annotations

import argparse
import contextlib
import io
import subprocess
from types import ModuleType

import pytest

from cuboid.cli import main


def called(*words: object, tracker: type | None = None) -> subprocess.CompletedProcess[str]:
    """Run a command, with another tracker if one is given; return its status and what it printed."""
    call, out, err = [*map(str, words)], io.StringIO(), io.StringIO()
    with (
        pytest.MonkeyPatch.context() as patched,
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        if tracker is not None:
            patched.setattr("cuboid.runs.pipeline.run._tracker", tracker)
        try:
            status = main(call)
        except SystemExit as ended:
            status = int(ended.code or 0)
    return subprocess.CompletedProcess(call, status, out.getvalue(), err.getvalue())


def run_command(command: ModuleType, *words: object) -> int:
    """Run the module of a command, and return its status; a mistake of the user is raised."""
    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    status: int = command.run(parser.parse_args([str(word) for word in words]))
    return status
