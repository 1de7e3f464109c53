"""A separate process that reads MATLAB files for `matlab.py`: a damaged file can crash SciPy's reader.

It runs as a script and imports only NumPy and SciPy, so that it starts quickly. For each line of standard input (a path
in JSON) it writes a line of JSON: ``error``, or ``names`` of all variables and ``arrays`` (name, type and shape of
each). The bytes of these arrays follow.
"""

from __future__ import annotations

import json
import math
import sys
from typing import Any, BinaryIO

import numpy as np
from scipy.io import loadmat, whosmat

# Memory limit of the process, bytes; a file that needs more is refused.
MAX_MEMORY = 1 << 30
# Largest number of values of a variable: 800 masks of 640 x 480 pixels.
MAX_VALUES = 256 << 20
# The first bytes of a MATLAB 7.3 file, which is a different format (HDF5).
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
        except Exception as error:  # files may come from any program: every error is reported as an error of the file
            answer, arrays = {"error": (str(error) or type(error).__name__).splitlines()[0]}, []
        write_answer(sys.stdout.buffer, answer, arrays)


def write_answer(out: BinaryIO, answer: dict[str, Any], arrays: list[np.ndarray[Any, Any]]) -> None:
    """Write an answer."""
    out.write(json.dumps(answer).encode() + b"\n")
    for array in arrays:
        out.write(array.data if array.size else b"")
    out.flush()


def limit_memory() -> None:
    """Limit the memory of this process, on systems that support it."""
    if sys.platform != "win32":
        import resource

        resource.setrlimit(resource.RLIMIT_DATA, (MAX_MEMORY, MAX_MEMORY))


def read(path: str) -> tuple[dict[str, Any], list[np.ndarray[Any, Any]]]:
    """Return the answer for a file, and the arrays that belong to it."""
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
    if "labels" in arrays:  # a cell array: concatenate the cells and store the end of each
        cells = [np.asarray(cell).ravel() for cell in np.asarray(arrays["labels"], dtype=object).ravel()]
        arrays["labels"] = np.concatenate(cells) if cells else np.zeros(0)
        arrays["label_ends"] = np.cumsum([len(cell) for cell in cells], dtype=np.int64)
    for name, array in arrays.items():
        if array.dtype.kind not in "iufb":
            raise ValueError(f"{name} must be numbers, got {array.dtype} {array.shape}")
    # Fortran order: arrays that MATLAB wrote column by column are not copied.
    plain = {
        name: np.asfortranarray(array).astype(array.dtype.newbyteorder("="), copy=False)
        for name, array in arrays.items()
    }
    headers = [(name, array.dtype.str, array.shape) for name, array in plain.items()]
    return {"names": sorted(found), "arrays": headers}, [array.T for array in plain.values()]


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
