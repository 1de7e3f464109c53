"""Recognition of a model's layout from its inputs, outputs, their names, and its output for a grey image."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cuboid.ground.core.errors import InputError
from cuboid.method.detection.images import (
    GREY,
    IMAGENET_FORM,
    NANODET_FORM,
    OWL_2_FORM,
    OWL_FORM,
    STRETCHED_FORM,
    YOLO_FORM,
)
from cuboid.method.detection.layouts import (
    FOUR_STRIDES,
    SIDES,
    STRIDES,
    Distances,
    Final,
    Layout,
    Masks,
    PicoDetFinal,
    Queries,
    Yolo,
    Yolox,
    count_cells,
)
from cuboid.method.detection.session import IDS, SCALE_FACTOR, STRIDE, TARGET_SIZE, Session

# Side of the test image for models that accept any size, pixels.
TRIED_PX = 640
# Output names of models with a box and logits per query.
RF_DETR = ("dets", "labels")
TRANSFORMERS = ("pred_boxes", "logits")
# Output names of models with masks without classes: the masks, and their scores.
MASK_NAMES = ("masks", "output_masks", "pred_masks")
MASK_SCORES = ("iou_predictions", "iou_scores", "scores")
# The additional output of OWLv2 compared with OWL-ViT.
OWL_2 = "objectness_logits"


def recognise(session: Session, classes: int) -> Layout:
    """Return the layout of a model.

    Parameters
    ----------
    session : Session
    classes : int
        Number of known class names, or 0.

    Raises
    ------
    InputError
        The layout is unknown; the message describes the inputs and outputs.
    """
    size = session.fixed_size or (TRIED_PX, TRIED_PX)
    grey = np.full((*size, 3), GREY, np.uint8)
    outputs = session.run(YOLO_FORM.prepare(grey, *size, session.dtype)[0])
    found = _by_names(session, outputs, classes)
    if found is None and IDS not in session.input_names:  # what looks for texts has no classes, so no table of them
        found = _by_grids(session, outputs, size, classes)
        if found is None and Yolo(classes).read(outputs, size, 1.0) is not None:
            found = Yolo(classes)
    if found is None:
        seen = ", ".join(f"{name} {np.shape(out)}" for name, out in zip(session.outputs, outputs, strict=True))
        beside = f"inputs {', '.join(session.input_names)}; " if session.input_names else ""
        raise InputError(
            f"{session.path}: {beside}outputs {seen} are of no known kind; docs/detectors.md has the known ones"
        )
    return found


def _by_names(session: Session, outputs: Sequence[Any], classes: int) -> Layout | None:
    """Recognise models by the names of their outputs."""
    place = {name: k for k, name in enumerate(session.outputs)}
    shapes = [output.shape for output in outputs]
    if SCALE_FACTOR in session.input_names and any(len(s) >= 2 and s[-1] == 6 for s in shapes):
        return PicoDetFinal(classes)
    if TARGET_SIZE in session.input_names and {"labels", "boxes", "scores"} <= {*place}:
        return Final(place["labels"], place["boxes"], place["scores"], classes)
    masks = next((place[name] for name in MASK_NAMES if name in place), None)
    scores = next((place[name] for name in MASK_SCORES if name in place), None)
    if masks is not None and scores is not None and len(shapes[masks]) in (4, 5):
        return Masks(masks, scores) if shapes[masks][:-2] == shapes[scores] else None
    if IDS in session.input_names and {*TRANSFORMERS} <= {*place}:
        boxes, logits = (place[one] for one in TRANSFORMERS)
        two = OWL_2 in place
        return Queries("OWLv2" if two else "OWL-ViT", OWL_2_FORM if two else OWL_FORM, boxes, logits)
    for names, name, form in ((RF_DETR, "RF-DETR", IMAGENET_FORM), (TRANSFORMERS, "RT-DETR", STRETCHED_FORM)):
        if not {*names} <= {*place}:
            continue
        boxes, logits = (place[one] for one in names)
        if len(shapes[boxes]) == 3 == len(shapes[logits]) and shapes[boxes][2] == 4:
            n = shapes[boxes][1]
            masks = next((k for k, shape in enumerate(shapes) if len(shape) == 4 and shape[1] == n), None)
            return Queries(name, form, boxes, logits, masks)
    return None


def _by_grids(session: Session, outputs: Sequence[Any], size: tuple[int, int], classes: int) -> Layout | None:
    """Recognise models with a row for each cell of their grids."""
    if not outputs or any(output.ndim != 3 or output.shape[0] != 1 for output in outputs):
        return None
    rows = [output.shape[1] for output in outputs]
    of_strides = {count_cells(size, strides): strides for strides in (STRIDES, FOUR_STRIDES)}
    if len(outputs) == 1:
        strides, table = of_strides.get(rows[0]), outputs[0][0].astype(np.float64)
        if strides is None:
            return None
        if _has_distances(table, classes):
            # The older NanoDet with three grids measures from the middle of a cell, NanoDet-Plus from its corner.
            return Distances("NanoDet", NANODET_FORM, strides, 0.5 if strides == STRIDES else 0.0)
        return Yolox() if strides == STRIDES and _is_within_cells(table) else None
    widths = [output.shape[2] for output in outputs]
    sides = [n for n, width in zip(rows, widths, strict=True) if width == SIDES]
    scores = [n for n, width in zip(rows, widths, strict=True) if width != SIDES]
    strides = of_strides.get(sum(sides))
    if strides is None or sides != scores or sides != [count_cells(size, (stride,)) for stride in strides]:
        return None
    return Distances("PicoDet", IMAGENET_FORM, strides, 0.5)


def _has_distances(table: Any, classes: int) -> bool:
    """Tell whether the last columns of a table are distributions over distances rather than scores."""
    columns = table.shape[1]
    if classes:
        return bool(columns == classes + SIDES)
    last = table[:, -SIDES:]
    return bool(columns > SIDES and ((last < 0) | (last > 1)).any() and (table[:, :-SIDES] >= 0).all())


def _is_within_cells(table: Any) -> bool:
    """Tell whether a table (N, 5 + classes) has centres relative to cells.

    Other models with a row per cell (YOLOv6, YOLOX with decoded boxes) have centres in pixels, which are spread over
    the whole input; relative to cells, centres are at most a few cells from 0.
    """
    return bool(table.shape[1] > 5 and np.abs(table[:, :2]).max() < STRIDE)
