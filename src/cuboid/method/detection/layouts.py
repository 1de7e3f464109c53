"""The output layouts of detectors: decoding of boxes and scores; the layout is recognised from the model itself.

Each layout reads the outputs of one family of models:

- `Yolo`: tables of the YOLO family, with and without masks (YOLOv5 to YOLO11, FastSAM), and those that are final;
- `Yolox`: the same, boxes given within the cells of three grids (Ge et al., "YOLOX: Exceeding YOLO Series in 2021");
- `Distances`: NanoDet and PicoDet: distances to the sides as distributions, per cell of three or four grids;
- `PicoDetFinal`: PicoDet with its own last steps in the model;
- `Queries`: RF-DETR, and RT-DETR and D-FINE as Transformers exports them: a box and logits per query;
  OWL-ViT and OWLv2 the same, a logit for each text;
- `Masks`: SAM-style models: masks of any object, without classes;
- `Final`: RT-DETR and D-FINE as their authors export them: labels, boxes and scores.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.method.detection.images import IMAGENET_FORM, STRETCHED_FORM, YOLO_FORM, YOLOX_FORM, ImageForm
from cuboid.method.detection.vocabulary import COCO

# The strides of the grids of one-stage detectors: the output has a row for each cell.
STRIDES = (8, 16, 32)
FOUR_STRIDES = (*STRIDES, 64)
# Maximum logarithm of a box's size in cells: that of 1,000.
MAX_LOG = 7.0
# Maximum logit, so that the exponential does not overflow.
MAX_LOGIT = 60.0
# NanoDet and PicoDet give the distance to each of 4 sides as a distribution over 0 to 7 cells.
SIDE_BINS = 8
SIDES = 4 * SIDE_BINS
# Maximum value of boxes that are given as fractions of the input.
UNIT = 1.01


class Raw(NamedTuple):
    """The decoded boxes of a frame, before selection.

    Attributes
    ----------
    boxes_xyxy : (N, 4) float64
        Pixels of the input.
    scores : (N, C) float64
    coefficients : (N, k) float32
        Weights of the mask prototypes; k is 0 without masks.
    prototypes : (k, h, w) float32 or None
    logits : (N, h, w) float32 or None
        A mask for each box over the whole input, above 0 inside.
    """

    boxes_xyxy: Float64Array
    scores: Float64Array
    coefficients: Float32Array
    prototypes: Float32Array | None = None
    logits: Float32Array | None = None


class Layout(Protocol):
    """The input preprocessing and output decoding of a family of models.

    Attributes
    ----------
    name : str
    form : ImageForm
    """

    @property
    def name(self) -> str:
        """Name of the layout in messages."""

    @property
    def form(self) -> ImageForm:
        """Preprocessing of the image."""

    def read(self, outputs: Sequence[Any], size: tuple[int, int], least: float) -> Raw | None:
        """Return the boxes with a score of at least `least`; None if the outputs have another layout.

        `size` is the number of rows and columns of the input.
        """


@dataclass(frozen=True, slots=True)
class Yolo:
    """Tables of the YOLO family.

    - (1, 4 + classes [+ k], N): centre, size, a score per class, k mask coefficients; boxes overlap;
    - (1, N, 5 + classes): the same with rows and columns exchanged and one more score, of there being an object;
    - (1, N, 6 [+ k]) or (N, 6): corners, score, class, k mask coefficients; final;
    - (1, N, 4 + classes), N fewer than columns or boxes as fractions: a row per query, as Ultralytics exports RT-DETR;

    and with k coefficients a second output (1, k, h, w): the prototypes that a mask is the weighted sum of.

    `classes` is the number of known names, or 0.
    """

    classes: int = 0
    name: str = "YOLO"
    form: ImageForm = YOLO_FORM

    def read(self, outputs: Sequence[Any], size: tuple[int, int], least: float) -> Raw | None:
        """See `Layout`."""
        prototypes = next((output[0].astype(np.float32) for output in outputs if output.ndim == 4), None)
        k = 0 if prototypes is None else len(prototypes)
        for output in outputs:
            table = output[0] if output.ndim == 3 and output.shape[0] == 1 else output
            if table.ndim != 2:
                continue
            table = table.astype(np.float64)
            raw = self._table(table, k, size, least)
            if raw is not None:
                return raw._replace(prototypes=prototypes)
        return None

    def _table(self, table: Float64Array, k: int, size: tuple[int, int], least: float) -> Raw | None:
        rows, columns = table.shape
        if columns == 6 + k:
            return _final(table, k, self.classes)
        if self.classes and columns == 4 + self.classes and rows > columns and _is_unit(table[:, :4]):
            return _of_rows(_scaled(table, size), 0, first_score=4)
        if 5 + k <= rows < columns:
            return _of_rows(table.T, k, first_score=4)
        if 6 + k <= columns < rows:
            likely = table[table[:, 4] >= least]
            found = _of_rows(likely, k, first_score=5)
            return found._replace(scores=found.scores * likely[:, 4:5])
        return None


@dataclass(frozen=True, slots=True)
class Yolox:
    """YOLOX as its authors export it: (1, N, 5 + classes), offsets in cells and logarithms of sizes; BGR images."""

    name: str = "YOLOX"
    form: ImageForm = YOLOX_FORM

    def read(self, outputs: Sequence[Any], size: tuple[int, int], least: float) -> Raw | None:
        """See `Layout`."""
        table = outputs[0][0].astype(np.float64)
        likely = table[:, 4] >= least
        rows = table[likely]
        rows[:, :4] = _decoded(rows[:, :4], cells(size, STRIDES)[likely])
        found = _of_rows(rows, 0, first_score=5)
        return found._replace(scores=found.scores * rows[:, 4:5])


@dataclass(frozen=True, slots=True)
class Distances:
    """NanoDet and PicoDet: class scores, and for each side of the box a distribution over distances in cells.

    NanoDet has one output (1, N, classes + 32); PicoDet two for each grid, (1, n, classes) and (1, n, 32).

    `offset` is the position of a box's reference point within its cell, in cells.
    """

    name: str
    form: ImageForm
    strides: tuple[int, ...]
    offset: float

    def read(self, outputs: Sequence[Any], size: tuple[int, int], least: float) -> Raw | None:
        """See `Layout`."""
        if len(outputs) == 1:
            table = outputs[0][0].astype(np.float64)
            scores, sides = table[:, :-SIDES], table[:, -SIDES:]
        else:
            parts = [output[0].astype(np.float64) for output in outputs]
            scores = np.concatenate([part for part in parts if part.shape[1] != SIDES])
            sides = np.concatenate([part for part in parts if part.shape[1] == SIDES])
        likely = scores.max(axis=1, initial=0.0) >= least
        at = cells(size, self.strides)[likely]
        bins = np.exp(
            sides[likely].reshape(-1, 4, SIDE_BINS) - sides[likely].reshape(-1, 4, SIDE_BINS).max(axis=2, keepdims=True)
        )
        distance = (bins * np.arange(SIDE_BINS)).sum(axis=2) / bins.sum(axis=2)
        centre = at[:, :2] + self.offset
        boxes = np.hstack([centre - distance[:, :2], centre + distance[:, 2:]]) * at[:, 2:]
        return Raw(boxes, scores[likely], _no_coefficients(len(boxes)))


@dataclass(frozen=True, slots=True)
class PicoDetFinal:
    """PicoDet with its last steps: (N, 6): class, score, corners; an input `scale_factor`. `classes` as of `Yolo`."""

    classes: int
    name: str = "PicoDet"
    form: ImageForm = IMAGENET_FORM

    def read(self, outputs: Sequence[Any], size: tuple[int, int], least: float) -> Raw | None:
        """See `Layout`."""
        table = next((o.reshape(-1, 6).astype(np.float64) for o in outputs if o.ndim >= 2 and o.shape[-1] == 6), None)
        if table is None:
            return None
        table = table[table[:, 0] >= 0]
        return _of_labels(table[:, 2:], table[:, 0], table[:, 1], self.classes)


@dataclass(frozen=True, slots=True)
class Queries:
    """A box and logits per query: (1, N, 4) as fractions of the input, centre and size; (1, N, classes).

    `boxes`, `logits`, `masks` are the indices of the outputs; segmenting RF-DETR models have masks (1, N, h, w).
    """

    name: str
    form: ImageForm
    boxes: int
    logits: int
    masks: int | None = None

    def read(self, outputs: Sequence[Any], size: tuple[int, int], least: float) -> Raw | None:
        """See `Layout`."""
        logits = np.clip(outputs[self.logits][0].astype(np.float64), -MAX_LOGIT, MAX_LOGIT)
        scores = 1.0 / (1.0 + np.exp(-logits))
        likely = scores.max(axis=1, initial=0.0) >= least
        rows = np.hstack([outputs[self.boxes][0].astype(np.float64), scores])[likely]
        found = _of_rows(_scaled(rows, size), 0, first_score=4)
        masks = None if self.masks is None else outputs[self.masks][0][likely].astype(np.float32)
        return found._replace(logits=masks)


@dataclass(frozen=True, slots=True)
class Final:
    """RT-DETR and D-FINE: labels (1, N), boxes (1, N, 4) in pixels, scores (1, N); `classes` as of `Yolo`.

    `labels`, `boxes`, `scores` are the indices of the outputs.
    """

    labels: int
    boxes: int
    scores: int
    classes: int
    name: str = "RT-DETR or D-FINE"
    form: ImageForm = STRETCHED_FORM

    def read(self, outputs: Sequence[Any], size: tuple[int, int], least: float) -> Raw | None:
        """See `Layout`."""
        labels, boxes, scores = (outputs[k][0].astype(np.float64) for k in (self.labels, self.boxes, self.scores))
        return _of_labels(boxes, labels, scores, self.classes)


@dataclass(frozen=True, slots=True)
class Masks:
    """Masks without classes, as from SAM-style models.

    Logits (1, N, h, w) and scores (1, N), or logits (1, Q, M, h, w) and scores (1, Q, M): of the M masks of a query,
    the one with the best score is used. `masks`, `scores` are the indices of the outputs.
    """

    masks: int
    scores: int
    name: str = "SAM"
    form: ImageForm = STRETCHED_FORM

    def read(self, outputs: Sequence[Any], size: tuple[int, int], least: float) -> Raw | None:
        """See `Layout`."""
        masks, scores = outputs[self.masks][0], outputs[self.scores][0].astype(np.float64)
        if masks.ndim == 4:
            best, rows = scores.argmax(axis=1), np.arange(len(scores))
            masks, scores = masks[rows, best], scores[rows, best]
        likely = scores >= least
        logits, scores = masks[likely].astype(np.float32), scores[likely]
        inside = logits > 0
        scale = np.tile([size[1] / logits.shape[2], size[0] / logits.shape[1]], 2)
        boxes = np.array([_around(mask) for mask in inside], np.float64).reshape(-1, 4) * scale
        return Raw(boxes, scores[:, None], _no_coefficients(len(boxes)), logits=logits)


def _around(mask: Any) -> list[int]:
    """Return the rectangle around the pixels of a mask (h, w), end exclusive; of zero size for an empty mask."""
    columns, rows = np.flatnonzero(mask.any(axis=0)), np.flatnonzero(mask.any(axis=1))
    return [columns[0], rows[0], columns[-1] + 1, rows[-1] + 1] if len(columns) else [0, 0, 0, 0]


def cells(size: tuple[int, int], strides: Sequence[int]) -> Float64Array:
    """Return column, row and stride of the cells of the grids over an input, (N, 3), grid by grid, row by row."""
    rows, columns = size
    found = []
    for stride in strides:
        down, across = -(-rows // stride), -(-columns // stride)
        y, x = np.divmod(np.arange(down * across), across)
        found.append(np.column_stack([x, y, np.full(len(x), stride)]))
    return np.concatenate(found).astype(np.float64)


def count_cells(size: tuple[int, int], strides: Sequence[int]) -> int:
    """Return the number of cells of the grids over an input."""
    return sum(-(-size[0] // stride) * -(-size[1] // stride) for stride in strides)


def _decoded(within: Float64Array, at: Float64Array) -> Float64Array:
    """Return centre and size (N, 4) in pixels of boxes given within cells: offsets in cells, logarithms of sizes."""
    # Sizes are limited, because the exponential of invalid values would overflow.
    sizes = np.exp(np.minimum(within[:, 2:], MAX_LOG))
    return np.hstack([within[:, :2] + at[:, :2], sizes]) * at[:, 2:]


def _of_rows(rows: Float64Array, k: int, first_score: int) -> Raw:
    """Read rows of centre, size, scores from column `first_score` on, and k coefficients at the end."""
    last = rows.shape[1] - k
    half = rows[:, 2:4] / 2.0
    boxes = np.hstack([rows[:, :2] - half, rows[:, :2] + half])
    return Raw(boxes, rows[:, first_score:last], rows[:, last:].astype(np.float32))


def _final(table: Float64Array, k: int, classes: int) -> Raw:
    """Read a table of corners, score, class, k coefficients."""
    found = _of_labels(table[:, :4], table[:, 5], table[:, 4], classes)
    return found._replace(coefficients=table[:, 6:].astype(np.float32))


def _of_labels(boxes: Float64Array, labels: Float64Array, scores: Float64Array, classes: int) -> Raw:
    """Return boxes with one class each; if no names are known, there are at least COCO's number of classes."""
    whole = np.where(np.isfinite(labels), labels, 0.0).astype(np.int64)
    count = classes or max(len(COCO), 1 + int(whole.max(initial=0)))
    inside = (whole >= 0) & (whole < count)
    table = np.zeros((len(whole), count))
    table[inside, whole[inside]] = scores[inside]
    return Raw(boxes, table, _no_coefficients(len(whole)))


def _no_coefficients(n: int) -> Float32Array:
    return np.zeros((n, 0), np.float32)


def _is_unit(boxes: Float64Array) -> bool:
    return len(boxes) > 0 and bool((boxes >= -UNIT).all() and (boxes <= UNIT).all())


def _scaled(rows: Float64Array, size: tuple[int, int]) -> Float64Array:
    """Return rows with the first four columns converted from fractions of the input to pixels."""
    height, width = size
    scaled = rows.copy()
    scaled[:, :4] *= (width, height, width, height)
    return scaled
