"""Proposals by a detector or mask model that the user names: an ONNX file, run by ONNX Runtime on the CPU.

The usual exports of the YOLO family, FastSAM among them, are understood, classes taken together:

- (1, 4 + classes [+ k], N): centre, size, a score a class, k mask coefficients; boxes overlap and are thinned out;
- (1, N, 5 + classes): the same with rows and columns exchanged and one more score, of there being an object;
- (1, N, 6 [+ k]) or (N, 6): corners, score, class, k mask coefficients; final as they are;

and with k coefficients a second output (1, k, h, w): the prototypes that a mask is the weighted sum of.

YOLOX as its authors export it (Ge et al., "YOLOX: Exceeding YOLO Series in 2021") is a table (1, N, 5 + classes) too,
but tells centres and sizes within the cells of three grids, and takes BGR images of 0..255 at its input's upper left.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from cuboid.core.config import TrackerConfig
from cuboid.core.errors import InputError
from cuboid.core.extras import require
from cuboid.core.frame import Float32Array, Float64Array, Frame, Intrinsics, UInt8Array
from cuboid.proposals.boxes import MAX_BOXES, best_boxes, thin_out
from cuboid.proposals.registry import SOURCES
from cuboid.proposals.types import Proposals, ProposalSource

# Detections below this are left out: detectors list hundreds of boxes that they do not believe in.
MIN_SCORE = 0.05
# Boxes that overlap more say the same: what the family's own code uses.
OVERLAP = 0.7
# Where a model takes any size, the image's own rounded up to this: the largest stride of the family.
STRIDE = 32
# The strides of YOLOX's grids: a row of its table for each of their cells.
STRIDES = (8, 16, STRIDE)
# Sizes above this many cells are none: the logarithm of 1,000.
MAX_LOG = 7.0
# Grey of the bars beside an image of another shape than the input.
GREY = 114


class _Fit(NamedTuple):
    """How the image lies in the input: input pixel = scale * image pixel + offset."""

    scale: float
    left: int
    top: int


class _Detections(NamedTuple):
    """Boxes in input pixels, scores, mask coefficients (N, k)."""

    boxes_xyxy: Float64Array
    scores: Float64Array
    coefficients: Float32Array


class OnnxModel:
    """Proposes what a detector or mask model finds.

    Parameters
    ----------
    path : Path
        The ONNX file.

    Raises
    ------
    MissingExtraError
        If ONNX Runtime is not installed.
    InputError
        If the file is not there or is no model of a known kind.
    """

    def __init__(self, path: Path) -> None:
        onnxruntime = require("onnxruntime", "--proposals onnx", "onnx")
        if not path.is_file():
            raise InputError(f"no model at {path}")
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        options.inter_op_num_threads = 1
        options.log_severity_level = 4  # errors come as exceptions
        try:
            self._session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        except Exception as error:  # ONNX Runtime has no common class of its own for what a file can have wrong
            raise InputError(f"{path} is no ONNX model that can be run: {_line(error)}") from None
        self._path = path
        self._input = self._session.get_inputs()[0]
        if len(self._session.get_inputs()) != 1 or len(self._input.shape) != 4:
            raise InputError(f"{path}: a model with one input (1, 3, height, width) expected")
        if self._input.shape[1] not in (3, None) and not isinstance(self._input.shape[1], str):
            raise InputError(f"{path}: a model of 3 color channels expected, it has {self._input.shape[1]}")
        # Of YOLOX the cell of each row (N, 3): column, row, stride. None: boxes are told in pixels of the input.
        self._cells: Float64Array | None = None
        self._cells = self._grid_cells()

    def __call__(self, frame: Frame, intrinsics: Intrinsics) -> Proposals:
        """Return the proposals of `frame`, the best first.

        Raises
        ------
        InputError
            If the model's outputs are of no known kind.
        """
        pixels, fit = self._letterbox(frame.color)
        outputs = self._run(pixels)
        prototypes = next((np.asarray(o) for o in outputs if np.ndim(o) == 4), None)
        found = self._detections(outputs, 0 if prototypes is None else prototypes.shape[1])
        kept = np.flatnonzero(found.scores >= MIN_SCORE)
        kept = kept[thin_out(found.boxes_xyxy[kept], found.scores[kept], OVERLAP)][:MAX_BOXES]
        shift = np.array([fit.left, fit.top, fit.left, fit.top], dtype=np.float64)
        given = (found.boxes_xyxy[kept] - shift) / fit.scale
        boxes, scores, rows = best_boxes(given, found.scores[kept], intrinsics.width, intrinsics.height)
        if prototypes is None:
            return Proposals(boxes, scores)
        masks = tuple(
            _mask(box, weights, np.asarray(prototypes[0], np.float32), fit, pixels.shape)
            for box, weights in zip(boxes, found.coefficients[kept][rows], strict=True)
        )
        return Proposals(boxes, scores, masks)

    def _run(self, pixels: npt.NDArray[Any]) -> list[Any]:
        try:
            outputs: list[Any] = self._session.run(None, {self._input.name: pixels})
        except Exception as error:
            raise InputError(f"{self._path} cannot be run: {_line(error)}") from None
        return outputs

    def _grid_cells(self) -> Float64Array | None:
        """Return the cells (N, 3) of the grids of YOLOX: column, row, stride; None for any other model.

        Others that have a row a cell (YOLOv6, YOLOX exported with its boxes decoded) tell centres in pixels of the
        input, which they fill; within a cell, centres are no farther than a few cells from 0.
        """
        height, width = self._input.shape[2:]
        if not (isinstance(height, int) and isinstance(width, int)):
            return None
        cells = np.concatenate([_cells_of(height // s, width // s, s) for s in STRIDES])
        if list(self._session.get_outputs()[0].shape[1:2]) != [len(cells)]:
            return None
        output = np.asarray(self._run(self._letterbox(np.full((height, width, 3), GREY, np.uint8))[0])[0])
        within = output.ndim == 3 and output.shape[2] > 5 and np.abs(output[0, :, :2]).max() < STRIDE
        return cells if within else None

    def _letterbox(self, color: UInt8Array) -> tuple[Any, _Fit]:
        """Return the image as the model takes it, and how it lies there: in the middle, for YOLOX at the corner."""
        import cv2

        height, width = color.shape[:2]
        rows, columns = (
            side if isinstance(side, int) else -(-own // STRIDE) * STRIDE
            for side, own in zip(self._input.shape[2:], (height, width), strict=True)
        )
        scale = min(columns / width, rows / height)
        w, h = max(1, round(width * scale)), max(1, round(height * scale))
        yolox = self._cells is not None
        left, top = (0, 0) if yolox else ((columns - w) // 2, (rows - h) // 2)
        padded = np.full((rows, columns, 3), GREY, np.uint8)
        padded[top : top + h, left : left + w] = cv2.resize(color, (w, h), interpolation=cv2.INTER_LINEAR)
        planes = padded.transpose(2, 0, 1)[None].astype(np.float32)
        planes = planes[:, ::-1] if yolox else planes / np.float32(255.0)
        kind = np.float16 if self._input.type == "tensor(float16)" else np.float32
        return np.ascontiguousarray(planes, dtype=kind), _Fit(scale, left, top)

    def _detections(self, outputs: list[Any], k: int) -> _Detections:
        """Read the detections of whichever form the outputs have, with k mask coefficients each."""
        for output in outputs:
            table = np.asarray(output)
            if table.ndim == 3 and table.shape[0] == 1:
                table = table[0]
            if table.ndim != 2:
                continue
            table = table.astype(np.float64)
            if table.shape[1] == 6 + k:
                return _Detections(table[:, :4], table[:, 4], table[:, 6:].astype(np.float32))
            if 5 + k <= table.shape[0] < table.shape[1]:
                return _of_rows(table.T, k, first_score=4)
            if 6 + k <= table.shape[1] < table.shape[0]:
                likely = table[:, 4] >= MIN_SCORE
                rows = table[likely]
                if self._cells is not None:
                    rows[:, :4] = _decoded(rows[:, :4], self._cells[likely])
                found = _of_rows(rows, k, first_score=5)
                return found._replace(scores=found.scores * rows[:, 4])
        shapes = ", ".join(str(np.shape(output)) for output in outputs)
        raise InputError(
            f"{self._path}: outputs {shapes} are of no known kind; expected are (1, 4 + classes, N), "
            "(1, N, 5 + classes) or (1, N, 6), with masks also (1, k, h, w)"
        )


def _cells_of(rows: int, columns: int, stride: int) -> Float64Array:
    """Return column, row and stride of the cells of a grid, (rows * columns, 3), row by row."""
    y, x = np.divmod(np.arange(rows * columns), columns)
    return np.column_stack([x, y, np.full(len(x), stride)]).astype(np.float64)


def _decoded(within: Float64Array, cells: Float64Array) -> Float64Array:
    """Return centre and size (N, 4) in pixels of boxes told within cells: offsets in cells, logarithms of sizes."""
    # No box is larger than any input; beyond, the exponential of what is no box would overflow.
    sizes = np.exp(np.minimum(within[:, 2:], MAX_LOG))
    return np.hstack([within[:, :2] + cells[:, :2], sizes]) * cells[:, 2:]


def _of_rows(rows: Float64Array, k: int, first_score: int) -> _Detections:
    """Read centre, size, scores from a column on, and k coefficients at the end."""
    last = rows.shape[1] - k
    half = rows[:, 2:4] / 2.0
    boxes = np.hstack([rows[:, :2] - half, rows[:, :2] + half])
    scores = rows[:, first_score:last].max(axis=1) if len(rows) else np.zeros(0)
    return _Detections(boxes, np.asarray(scores), rows[:, last:].astype(np.float32))


def _mask(
    box: npt.NDArray[np.int32], weights: Float32Array, prototypes: Float32Array, fit: _Fit, shape: tuple[int, ...]
) -> UInt8Array:
    """Return the weighted sum of the prototypes, above 0, in the box's own pixels."""
    import cv2

    x0, y0, x1, y1 = (int(x) for x in box)
    k, height, width = prototypes.shape
    heat = (weights @ prototypes.reshape(k, -1)).reshape(height, width)
    # Prototype pixel of the centre of image pixel x: ((x + 1/2) * scale + offset) * (width / input width) - 1/2.
    sx, sy = width / shape[3], height / shape[2]
    columns = ((np.arange(x0, x1) + 0.5) * fit.scale + fit.left) * sx - 0.5
    rows = ((np.arange(y0, y1) + 0.5) * fit.scale + fit.top) * sy - 0.5
    at_x, at_y = np.meshgrid(columns.astype(np.float32), rows.astype(np.float32))
    logits = cv2.remap(heat, at_x, at_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(logits > 0, dtype=np.uint8)


def _line(error: Exception) -> str:
    return (str(error) or type(error).__name__).splitlines()[0]


@SOURCES.register("onnx")
def onnx_source(options: str | None, config: TrackerConfig) -> ProposalSource:
    """Return the model in the ONNX file that `options` names.

    Raises
    ------
    InputError
        If no file is named, or it cannot be used.
    MissingExtraError
        If ONNX Runtime is not installed.
    """
    if not options:
        raise InputError("proposal source 'onnx' needs the file of a model: onnx:MODEL.onnx")
    return OnnxModel(Path(options))
