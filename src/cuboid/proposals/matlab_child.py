"""A process of its own that reads MATLAB files for `cuboid.proposals.matlab`: a bad one can crash SciPy's reader.

Run as a script. It knows NumPy and SciPy alone, so that it starts quickly. For each line of standard input (a path, as
JSON) it writes a line of JSON (``error``, or ``names`` of all variables and ``arrays``: name, type and shape of each
that follows), and the bytes of these arrays.
"""

from __future__ import annotations

import json
import math
import sys
from typing import Any, BinaryIO

import numpy as np
from scipy.io import loadmat, whosmat

# Bytes that the process may hold; a file that wants more is refused.
MAX_MEMORY = 1 << 30
# Values of a variable: 800 masks of 640 x 480 pixels.
MAX_VALUES = 256 << 20
# The first bytes of a file of MATLAB 7.3, which is another format altogether (HDF5).
MATLAB_73 = b"MATLAB 7.3"
KNOWN = ("bboxes", "bboxes_scores", "masks", "scores", "superpixels", "labels")


def main() -> None:
    """Answer until standard input ends."""
    limit_memory()
    for line in sys.stdin:
        try:
            answer, arrays = read(json.loads(line))
        except MemoryError:
            answer, arrays = {"error": f"it takes more than {MAX_MEMORY >> 20} MB of memory"}, []
        except Exception as error:  # of programs of any age: whatever is wrong with a file, it is the file's fault
            answer, arrays = {"error": (str(error) or type(error).__name__).splitlines()[0]}, []
        say(sys.stdout.buffer, answer, arrays)


def say(out: BinaryIO, answer: dict[str, Any], arrays: list[np.ndarray[Any, Any]]) -> None:
    """Write an answer."""
    out.write(json.dumps(answer).encode() + b"\n")
    for array in arrays:
        out.write(array.data if array.size else b"")
    out.flush()


def limit_memory() -> None:
    """Let the system refuse this process more memory, where it can."""
    if sys.platform != "win32":
        import resource

        resource.setrlimit(resource.RLIMIT_DATA, (MAX_MEMORY, MAX_MEMORY))


def read(path: str) -> tuple[dict[str, Any], list[np.ndarray[Any, Any]]]:
    """Return the answer for a file, and the arrays that go with it."""
    with open(path, "rb") as file:
        if file.read(len(MATLAB_73)) == MATLAB_73:
            raise ValueError("it is of MATLAB 7.3; save it with '-v7'")
        file.seek(0)
        largest = max((math.prod(shape) for _, shape, _ in whosmat(file)), default=0)  # type: ignore[arg-type]
        if largest > MAX_VALUES:
            raise ValueError(f"a variable has {largest} values, expected at most {MAX_VALUES}")
        file.seek(0)
        loaded: dict[str, Any] = loadmat(file, squeeze_me=False, struct_as_record=True)  # type: ignore[arg-type]
    found = fields(loaded)
    arrays = {name: np.asarray(found[name]) for name in KNOWN if name in found}
    if "labels" in arrays:  # a cell array: its cells one after the other, and where each ends
        cells = [np.asarray(cell).ravel() for cell in np.asarray(arrays["labels"], dtype=object).ravel()]
        arrays["labels"] = np.concatenate(cells) if cells else np.zeros(0)
        arrays["label_ends"] = np.cumsum([len(cell) for cell in cells], dtype=np.int64)
    for name, array in arrays.items():
        if array.dtype.kind not in "iufb":
            raise ValueError(f"{name} must be numbers, got {array.dtype} {array.shape}")
    # memory as it lies: what MATLAB wrote column by column is not copied
    plain = {
        name: np.asfortranarray(array).astype(array.dtype.newbyteorder("="), copy=False)
        for name, array in arrays.items()
    }
    told = [(name, array.dtype.str, array.shape) for name, array in plain.items()]
    return {"names": sorted(found), "arrays": told}, [array.T for array in plain.values()]


def fields(loaded: dict[str, Any]) -> dict[str, Any]:
    """Return the variables of a file, or the fields of the first struct that has scores."""
    variables = {name: value for name, value in loaded.items() if not name.startswith("__")}
    if not any("scores" in name for name in variables):
        for value in variables.values():
            names = getattr(getattr(value, "dtype", None), "names", None)
            if names and value.size == 1 and any("scores" in name for name in names):
                return {name: value.flat[0][name] for name in names}
    return variables


if __name__ == "__main__":
    main()
