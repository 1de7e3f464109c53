"""The layouts of detectors: how the outputs of a model say boxes and scores, recognised from the model itself.

Each layout reads the outputs of one family of models:

- `Yolo`: tables of the YOLO family, with and without masks (YOLOv5 to YOLO11, FastSAM), and those that are final;
- `Yolox`: the same, boxes given within the cells of three grids (Ge et al., "YOLOX: Exceeding YOLO Series in 2021");
- `Distances`: NanoDet and PicoDet: distances to the sides as distributions, per cell of three or four grids;
- `PicoDetFinal`: PicoDet with its own last steps in the model;
- `Queries`: RF-DETR, and RT-DETR and D-FINE as Transformers exports them: a box and logits per query;
  OWL-ViT and OWLv2 the same, a logit for each text;
- `Masks`: SAM and its like: masks of anything, without classes;
- `Final`: RT-DETR and D-FINE as their authors export them: labels, boxes and scores.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from cuboid.core.frame import Float32Array, Float64Array
from cuboid.detection.images import IMAGENET_FORM, STRETCHED_FORM, YOLO_FORM, YOLOX_FORM, ImageForm
from cuboid.detection.vocabulary import COCO

# The strides of the grids of one-stage detectors: a row of the output for each of their cells.
STRIDES = (8, 16, 32)
FOUR_STRIDES = (*STRIDES, 64)
# Sizes above this many cells are none: the logarithm of 1,000.
MAX_LOG = 7.0
# Logits beyond are as sure: the exponential would overflow.
MAX_LOGIT = 60.0
# NanoDet and PicoDet tell the distance to each of 4 sides as a distribution over 0 to 7 cells.
BINS = 8
SIDES = 4 * BINS
# Rows of a table of queries that tell boxes as fractions of the input are no larger than this.
UNIT = 1.01


class Raw(NamedTuple):
    """The boxes of a frame as a model tells them.

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
    """How a family of models takes images and says boxes.

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
        """How it takes its image."""

    def read(self, outputs: Sequence[Any], size: tuple[int, int], least: float) -> Raw | None:
        """Return the boxes with a score of `least` or more; None where the outputs are of another layout.

        `size` is rows and columns of the input.
        """


@dataclass(frozen=True, slots=True)
class Yolo:
    """Tables of the YOLO family.

    - (1, 4 + classes [+ k], N): centre, size, a score a class, k mask coefficients; boxes overlap;
    - (1, N, 5 + classes): the same with rows and columns exchanged and one more score, of there being an object;
    - (1, N, 6 [+ k]) or (N, 6): corners, score, class, k mask coefficients; final as they are;
    - (1, N, 4 + classes), N fewer than columns or boxes as fractions: a row a query, as Ultralytics exports RT-DETR;

    and with k coefficients a second output (1, k, h, w): the prototypes that a mask is the weighted sum of.

    `classes` is how many names are known; 0 where none are.
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
    """NanoDet and PicoDet: scores of classes, and to each side of the box a distribution over distances in cells.

    NanoDet has one output (1, N, classes + 32); PicoDet two for each grid, (1, n, classes) and (1, n, 32).

    `offset` is where within its cell a box's reference point lies, in cells.
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
            sides[likely].reshape(-1, 4, BINS) - sides[likely].reshape(-1, 4, BINS).max(axis=2, keepdims=True)
        )
        distance = (bins * np.arange(BINS)).sum(axis=2) / bins.sum(axis=2)
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

    `boxes`, `logits`, `masks` are the places of the outputs; RF-DETR has masks (1, N, h, w) where it segments.
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

    `labels`, `boxes`, `scores` are the places of the outputs.
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
    """Masks without classes, as SAM and its like give.

    Logits (1, N, h, w) and scores (1, N), or logits (1, Q, M, h, w) and scores (1, Q, M): of the M masks of a query,
    that with the best score counts. `masks`, `scores` are the places of the outputs.
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
    """Return the rectangle around the pixels of a mask (h, w), end exclusive; an empty one has no size."""
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
    """Return how many cells the grids over an input have."""
    return sum(-(-size[0] // stride) * -(-size[1] // stride) for stride in strides)


def _decoded(within: Float64Array, at: Float64Array) -> Float64Array:
    """Return centre and size (N, 4) in pixels of boxes given within cells: offsets in cells, logarithms of sizes."""
    # No box is larger than any input; beyond, the exponential of what is no box would overflow.
    sizes = np.exp(np.minimum(within[:, 2:], MAX_LOG))
    return np.hstack([within[:, :2] + at[:, :2], sizes]) * at[:, 2:]


def _of_rows(rows: Float64Array, k: int, first_score: int) -> Raw:
    """Read centre, size, scores from a column on, and k coefficients at the end."""
    last = rows.shape[1] - k
    half = rows[:, 2:4] / 2.0
    boxes = np.hstack([rows[:, :2] - half, rows[:, :2] + half])
    return Raw(boxes, rows[:, first_score:last], rows[:, last:].astype(np.float32))


def _final(table: Float64Array, k: int, classes: int) -> Raw:
    """Read corners, score, class, k coefficients."""
    found = _of_labels(table[:, :4], table[:, 5], table[:, 4], classes)
    return found._replace(coefficients=table[:, 6:].astype(np.float32))


def _of_labels(boxes: Float64Array, labels: Float64Array, scores: Float64Array, classes: int) -> Raw:
    """Return boxes that have one class each; of classes that are not known, there are COCO's, and all that are seen."""
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
    """Return rows whose first four columns are fractions of the input with these in pixels."""
    height, width = size
    scaled = rows.copy()
    scaled[:, :4] *= (width, height, width, height)
    return scaled
