"""Files of proposals, one for each frame, in the common layouts.

``.csv``
    A header line with at least ``x0,y0,x1,y1,score`` in any order, then one line for each box; x1 and y1 are exclusive.
    A file with only the header has no proposals.
``.npz``
    ``boxes`` (N, 4), x0 y0 x1 y1, or ``masks`` (N, H, W), and ``scores`` (N,). If both are present, masks are used.
``.mat`` of MCG
    ``bboxes`` (N, 4): up, left, down, right, counted from 1, all inclusive; ``bboxes_scores`` or ``scores`` (N, 1).
    Or, for masks, ``superpixels`` (H, W), ``scores`` (N, 1), and ``labels``: one cell for each proposal with the
    numbers of its superpixels.
    The variables are at the top level of the file, or fields of one struct (``candidates_mcg``, ``proposals``, any
    name).
``.mat`` of CPMC
    ``masks`` (H, W, N) logical and ``scores`` (N, 1).

If a score lies outside 0..1, all scores of the file are scaled to 0..1. MATLAB files up to version 7 can be read.
"""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.formats.reading import opened
from cuboid.ground.formats.rows_files import RectangleEntry
from cuboid.ground.formats.table_validation import read_table
from cuboid.method.proposals.boxes import boxes_as_proposals, masks_as_proposals
from cuboid.method.proposals.matlab import READER
from cuboid.method.proposals.types import Proposals

# Largest unpacked file: 800 masks of 640 x 480 pixels.
MAX_UNPACKED_BYTES = 256 << 20

Loader = Callable[[Path, int, int], Proposals]


def load_csv(path: Path, width: int, height: int) -> Proposals:
    """Read a ``.csv`` file of boxes for an image of width x height pixels.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    rows = [(row.x0, row.y0, row.x1, row.y1, row.score) for _, row in read_table(path, RectangleEntry, any_order=True)]
    table = np.array(rows, dtype=np.float64).reshape(-1, 5)
    return _boxes(path, table[:, :4], table[:, 4], width, height)


def load_npz(path: Path, width: int, height: int) -> Proposals:
    """Read a ``.npz`` file; parameters and errors are those of `load_csv`."""
    with opened(path, MAX_UNPACKED_BYTES) as file:
        try:
            with zipfile.ZipFile(file) as members:
                unpacked = sum(member.file_size for member in members.infolist())
            if unpacked > MAX_UNPACKED_BYTES:
                raise ValueError(f"it unpacks to {unpacked >> 20} MB, expected at most {MAX_UNPACKED_BYTES >> 20}")
            file.seek(0)
            with np.load(file, allow_pickle=False) as arrays:
                found = {name: np.asarray(arrays[name]) for name in arrays.files}
        except Exception as error:  # zip, deflate and array headers raise different errors
            raise InputError(f"{path} cannot be read: {_line(error)}") from None
    if "scores" not in found or not {"boxes", "masks"} & set(found):
        raise InputError(f"{path} holds {_listed(found)}; expected: scores, and boxes or masks")
    if "masks" in found:
        return _masks(path, found["masks"], found["scores"], width, height)
    return _boxes(path, found["boxes"], found["scores"], width, height)


def load_mat(path: Path, width: int, height: int) -> Proposals:
    """Read a ``.mat`` file of MCG or CPMC; parameters and errors are those of `load_csv`."""
    found, names = READER.read(path)
    scores = found.get("bboxes_scores", found.get("scores"))
    if scores is not None and "masks" in found:
        masks = np.atleast_3d(found["masks"])
        return _masks(path, np.moveaxis(masks, 2, 0), scores, width, height)
    if "scores" in found and {"superpixels", "labels"} <= set(found):
        masks = _masks_of_superpixels(path, found["superpixels"], found["labels"], found["label_ends"])
        return _masks(path, masks, found["scores"], width, height)
    if scores is not None and "bboxes" in found:
        inclusive = _table(path, found["bboxes"])
        up, left, down, right = inclusive.T
        boxes = np.stack([left - 1.0, up - 1.0, right, down], axis=1)
        return _boxes(path, boxes, scores, width, height)
    raise InputError(
        f"{path} holds {_listed(names)}; expected MCG's bboxes (or superpixels and labels) or CPMC's masks, with scores"
    )


def _masks_of_superpixels(
    path: Path, pixels: npt.NDArray[Any], labels: npt.NDArray[Any], ends: npt.NDArray[Any]
) -> npt.NDArray[np.bool_]:
    """Return one mask for each cell of labels, made of its superpixels; `ends` (N,) are the ends of the cells."""
    if pixels.ndim != 2 or pixels.dtype.kind not in "iuf":
        raise InputError(f"{path}: superpixels must be an image of numbers, got {pixels.dtype} {pixels.shape}")
    number, cells = _whole(path, "superpixels", pixels), np.split(_whole(path, "labels", labels), ends)[:-1]
    if (
        number.size == 0
        or number.min() < 0
        or number.max() > number.size
        or len(cells) * number.size > MAX_UNPACKED_BYTES
    ):
        raise InputError(f"{path}: superpixels must be numbered from 0 or 1, at most one a pixel, with labels for some")
    masks = np.zeros((len(cells), *number.shape), dtype=np.bool_)
    for k, cell in enumerate(cells):
        masks[k] = np.isin(number, cell)
    return masks


def _whole(path: Path, name: str, values: npt.NDArray[Any]) -> npt.NDArray[np.int64]:
    """Return numbers as integers."""
    if values.dtype.kind not in "iuf" or not (np.abs(values.astype(np.float64)) < 2**53).all():
        raise InputError(f"{path}: {name} must be numbers, got {values.dtype} {values.shape}")
    return values.astype(np.int64)


def _boxes(path: Path, boxes: npt.ArrayLike, scores: npt.ArrayLike, width: int, height: int) -> Proposals:
    table = _table(path, boxes)
    values = _scores(path, scores, len(table))
    outside = (table[:, 0] >= width) | (table[:, 1] >= height)
    if outside.any():
        raise InputError(
            f"{path}: box {int(np.flatnonzero(outside)[0])} lies outside the image of {width} x {height} pixels; "
            "the boxes must be made for the images that are tracked"
        )
    return boxes_as_proposals(table, values, width, height)


def _table(path: Path, boxes: Any) -> Float64Array:
    """Return boxes (N, 4)."""
    table = np.asarray(boxes)
    if table.dtype.kind not in "iuf" or (table.size and (table.ndim != 2 or table.shape[1] != 4)):
        raise InputError(f"{path}: boxes must be (N, 4) numbers, got {table.dtype} {table.shape}")
    return table.astype(np.float64).reshape(-1, 4)


def _masks(path: Path, masks: npt.NDArray[Any], scores: npt.ArrayLike, width: int, height: int) -> Proposals:
    if masks.ndim != 3 or masks.shape[1:] != (height, width):
        size = " x ".join(str(n) for n in reversed(masks.shape[1:]))
        raise InputError(f"{path}: masks of {size} pixels, expected {width} x {height} as the images that are tracked")
    return masks_as_proposals(masks, _scores(path, scores, len(masks)))


def _scores(path: Path, scores: npt.ArrayLike, count: int) -> Float64Array:
    """Return scores in 0..1; if any lies outside, all are scaled to 0..1."""
    values = np.asarray(scores)
    if values.size != count or values.dtype.kind not in "iufb":
        raise InputError(f"{path}: {count} scores expected, got {values.size} of type {values.dtype}")
    numbers = values.astype(np.float64).ravel()
    finite = numbers[np.isfinite(numbers)]
    if len(finite) == 0 or (finite.min() >= 0.0 and finite.max() <= 1.0):
        return numbers
    low, high = float(finite.min()), float(finite.max())
    return np.asarray((numbers - low) / (high - low) if high > low else np.where(np.isfinite(numbers), 1.0, numbers))


def _listed(names: Iterable[str]) -> str:
    return ", ".join(sorted(names)) or "nothing"


def _line(error: Exception) -> str:
    return (str(error) or type(error).__name__).splitlines()[0]


# Loaders by file suffix.
LOADERS: dict[str, Loader] = {".csv": load_csv, ".npz": load_npz, ".mat": load_mat}
