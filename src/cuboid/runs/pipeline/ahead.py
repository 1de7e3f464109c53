"""Compilation of all kernels of tracking ahead of their first call, by several processes at once.

The kernels and the types of their arguments are in `kernels.json`. No kernel is compiled twice: a process that needs
one that another process compiles waits for it (`cuboid.ground.compiling.kernelcache`).
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path
from typing import Any

from cuboid.ground.compiling.compiled import KERNELS, Kernel
from cuboid.ground.compiling.kernelcache import is_writable
from cuboid.ground.compiling.signatures import decode
from cuboid.ground.core.threads import limit_threads

LIST = Path(__file__).with_name("kernels.json")
# More processes gain nothing: the slowest kernels call others, and each process imports numba.
MAX_PROCESSES = 4
# Another process is started if at least this number of kernels is missing: its start takes a second or two.
MIN_MISSING = 10


def listed() -> list[tuple[str, list[Any]]]:
    """Return the kernels that tracking calls, each with the types of its arguments as JSON, in the order of need."""
    return [(name, signature) for name, signature in json.loads(LIST.read_text(encoding="utf-8"))]


def listed_kernels() -> list[Kernel]:
    """Return the kernels of the list, each once, in the order of need; their modules are imported."""
    names = dict.fromkeys(name for name, _ in listed())
    for name in names:
        import_module(name.rpartition(".")[0])
    return [KERNELS[name] for name in names]


def compile_listed(
    begin: float = 0.0, progress: Callable[[int, int], None] = lambda done, total: None, *, wait: bool = False
) -> None:
    """Load the listed kernels, and compile those that are not in the cache.

    Parameters
    ----------
    begin : float
        Where in the list this process begins, from 0 to 1; it ends there as well.
    progress : callable
        Called with the number of finished kernels and the total number.
    wait : bool
        Wait for a kernel that another process compiles; otherwise leave it out.
    """
    kernels = listed()
    first = int(begin * len(kernels))
    for done, (name, signature) in enumerate(kernels[first:] + kernels[:first]):
        progress(done, len(kernels))
        module, _, function = name.rpartition(".")
        dispatcher = getattr(import_module(module), function)
        if wait or not KERNELS[name].cache.busy:
            dispatcher.compile(tuple(map(decode, signature)))
    progress(len(kernels), len(kernels))


@contextmanager
def helpers(count: int) -> Iterator[list[subprocess.Popen[bytes]]]:
    """Let other processes compile the listed kernels, each from another place in the list on; they end at the exit."""
    running: list[subprocess.Popen[bytes]] = []
    try:
        for k in range(1, count + 1):
            words = [sys.executable, "-m", "cuboid.runs.pipeline.ahead", str(k / (count + 1)), str(os.getpid())]
            none = subprocess.DEVNULL
            with suppress(OSError):  # too many processes, or too little memory: the run compiles alone
                running.append(subprocess.Popen(words, stdin=none, stdout=none, stderr=none))
        yield running
    finally:
        for process in running:
            process.kill()
            process.wait()


def useful_helpers(processes: int) -> int:
    """Return the number of helpers beside this process, if `processes` may compile.

    It is 0 if few kernels are missing, and if no process can store any.
    """
    missing = sum(not kernel.cached for kernel in listed_kernels())
    return min(processes, MAX_PROCESSES) - 1 if missing >= MIN_MISSING and is_writable() else 0


def compile_all(progress: Callable[[int, int], None] = lambda done, total: None) -> None:
    """Compile all listed kernels, beside the helpers that the display of progress starts, and wait for theirs."""
    compile_listed(progress=progress)
    compile_listed(wait=True)


def main() -> None:
    """Compile from the place of the first argument on, for the process of the second."""
    limit_threads(1)
    begin, parent = float(sys.argv[1]), int(sys.argv[2])

    def end_with_parent(done: int, total: int) -> None:
        if os.name == "posix" and os.getppid() != parent:
            sys.exit()

    compile_listed(begin, end_with_parent)


if __name__ == "__main__":
    main()
