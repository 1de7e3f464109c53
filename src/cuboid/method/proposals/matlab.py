"""MATLAB files, read in a separate process: SciPy's reader can crash, hang or use all memory on a damaged file."""

from __future__ import annotations

import atexit
import json
import math
import os
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from cuboid.ground.core.errors import InputError
from cuboid.ground.formats.reading import opened

CHILD = Path(__file__).with_name("matlab_child.py")
# Largest file, bytes.
MAX_MATLAB_BYTES = 256 << 20
# Time limit: a file of 256 MB takes one or two seconds, the start of the process as long again.
MATLAB_TIMEOUT_S = 20.0


class MatlabReader:
    """A process that reads one file after another; it starts with the first file, and again after a crash."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._owner = 0
        self._lock = threading.Lock()

    def read(self, path: Path) -> tuple[dict[str, npt.NDArray[Any]], list[str]]:
        """Return the arrays of proposals in a file, cells concatenated, and the names of all its variables.

        Raises
        ------
        InputError
            If it cannot be read, or reading it crashes, or takes too much time or memory.
        """
        with opened(path, MAX_MATLAB_BYTES):
            pass  # checks that it is a regular file of an accepted size
        with self._lock:
            process = self._started()
            timer = threading.Timer(MATLAB_TIMEOUT_S, process.kill)
            timer.start()
            try:
                answer, arrays = _read_by(process, path)
            except (OSError, ValueError, EOFError):
                self.close()
                why = "took too long" if timer.finished.is_set() else "crashed"
                raise InputError(f"{path} cannot be read: its reader {why}; is it a whole MATLAB file?") from None
            finally:
                timer.cancel()
        if "error" in answer:
            raise InputError(f"{path} cannot be read: {answer['error']}")
        return arrays, [str(name) for name in answer["names"]]

    def _started(self) -> subprocess.Popen[bytes]:
        if self._process is None or self._owner != os.getpid() or self._process.poll() is not None:
            self.close()
            self._process = subprocess.Popen(
                [sys.executable, "-P", str(CHILD)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
            )
            self._owner = os.getpid()
        return self._process

    def close(self) -> None:
        """End the process."""
        process, self._process = self._process, None
        if process is None or self._owner != os.getpid():
            return
        process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                with suppress(OSError):  # unsent data of the ended process
                    pipe.close()


def _read_by(process: subprocess.Popen[bytes], path: Path) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
    """Let the process read a file; raise OSError, ValueError or EOFError if it no longer answers."""
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write(json.dumps(str(path.resolve())).encode() + b"\n")
    process.stdin.flush()
    answer = json.loads(process.stdout.readline())
    arrays = {name: _array(process.stdout, kind, shape) for name, kind, shape in answer.get("arrays", ())}
    return answer, arrays


def _array(pipe: IO[bytes], kind: str, shape: list[int]) -> npt.NDArray[Any]:
    dtype = np.dtype(kind)
    content = pipe.read(math.prod(shape) * dtype.itemsize)
    if len(content) < math.prod(shape) * dtype.itemsize:
        raise EOFError
    return np.frombuffer(content, dtype).reshape(shape, order="F")


READER = MatlabReader()
atexit.register(READER.close)
