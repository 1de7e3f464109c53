"""`cuboid serve` and `cuboid mcp --http` as processes of their own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def served(path: str, *words: str, command: str = "serve") -> Iterator[str]:
    """Serve a store or a place, and give the address that the command prints; Ctrl-C ends it."""
    environment = {name: value for name, value in os.environ.items() if name != "CUBOID_TOKEN"}
    call = [sys.executable, "-m", "cuboid", command, path, "--port", "0", *words]
    process = subprocess.Popen(call, stdout=subprocess.PIPE, text=True, env=environment)
    try:
        assert process.stdout is not None
        yield process.stdout.readline().split(" at ")[1].split(" (")[0].rstrip("/")
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=20)
        assert process.returncode == 0
    finally:
        process.kill()
        process.communicate()
