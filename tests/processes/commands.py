"""The real commands with a tracker that is quick: as processes, or in this one where a process is not the point."""

from __future__ import annotations

import hashlib
import os
import resource
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from called import called
from fakes import FakeTracker
from slowed import slowed

# What a process may take, seconds: of the processor, and, since others may have that, much more by the clock.
MAX_PROCESSOR_S, MAX_S = 120, 900

# Root may write everywhere; without this it is bound by permissions as others are.
BOUND = ("setpriv", "--bounding-set=-dac_override,-dac_read_search,-fowner", "--inh-caps=-dac_override")


def command(*words: object, frame_s: float = 0.0) -> list[str]:
    """Return the call of a cuboid command."""
    return slowed(f"time.sleep({frame_s})", *words)


def bound(words: Sequence[str]) -> list[str]:
    """Return a call that permissions bind; the test skips where root cannot be bound."""
    if os.geteuid() != 0:
        return list(words)
    if shutil.which("setpriv") is None:
        pytest.skip("root is not bound by permissions, and there is no setpriv to change that")
    return [*BOUND, *words]


def run(words: Sequence[str], **options: Any) -> subprocess.CompletedProcess[str]:
    """Run a call to its end: one that works for too long, or hangs, is killed."""
    streams = {name: options.pop(name, subprocess.PIPE) for name in ("stdout", "stderr")}
    before = options.pop("preexec_fn", None)

    def begin() -> None:
        # Here, before the call may become another user's, whom nobody may limit any more.
        if sys.platform == "linux":
            resource.setrlimit(resource.RLIMIT_CPU, (MAX_PROCESSOR_S, MAX_PROCESSOR_S))
        if before is not None:
            before()

    with subprocess.Popen(words, **streams, text=True, preexec_fn=begin, **options) as process:
        try:
            out, err = process.communicate(timeout=MAX_S)
        except subprocess.TimeoutExpired:
            process.kill()
            raise
    return subprocess.CompletedProcess(words, process.returncode, out, err)


def run_here(*words: object, tracker: type | None = FakeTracker) -> subprocess.CompletedProcess[str]:
    """Run a cuboid command in this process, a second sooner than in its own; with the real tracker if it is None."""
    return called(*words, tracker=tracker)


@contextmanager
def at_most(limit_bytes: int) -> Iterator[None]:
    """Stand in for a full disk: no file of this process may grow beyond this."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(sys, "dont_write_bytecode", True)  # Python itself would cut the cached code of a module short
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit_bytes, hard))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def refused(done: subprocess.CompletedProcess[str]) -> str:
    """Return the one line with which a command refused to work."""
    lines = [line for line in done.stderr.splitlines() if not line.startswith("cuboid: warning")]
    assert done.returncode == 2, done.stderr
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("cuboid: error: ")
    assert len(lines[0]) < 300
    return lines[0]


def contents(folder: Path) -> dict[str, str]:
    """Return a digest of each file below a folder, hidden ones included."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }
