"""A detector from an ONNX file, run by ONNX Runtime, by default on the CPU."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cuboid.ground.arrays import Float32Array, UInt8Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.method.detection.boxes import MAX_BOXES, best_boxes, thin_out
from cuboid.method.detection.images import Fit
from cuboid.method.detection.layouts import Masks, Raw
from cuboid.method.detection.recognition import recognise
from cuboid.method.detection.session import IDS, Session
from cuboid.method.detection.tokens import Tokens
from cuboid.method.detection.types import Detections
from cuboid.method.detection.vocabulary import known_names, names_for

# Minimum score of a detection: detectors return hundreds of boxes with very low scores. YOLOX-nano has two thirds of
# its recall on single images between this and 0.3; accumulating evidence over frames removes the false ones.
MIN_DETECTION_SCORE = 0.05
# IoU above which the worse of two boxes is removed: the value of the YOLO family's own code.
DUPLICATE_IOU = 0.7
ENDING = ".onnx"
# Maximum side of a model's input, pixels: a larger one would take all memory.
MAX_SIZE = 4096
HOW = "FILE.onnx[:score=S,labels=FILE,threads=N,provider=NAME,size=PIXELS]"
# The only class of class-agnostic models: it is not used as a name.
ANYTHING = "object"


@dataclass(frozen=True, slots=True)
class OnnxOptions:
    """Options of a model.

    Attributes
    ----------
    score : float
        Minimum score of a detection, 0..1.
    labels : Path or None
        File with the names of the classes.
    threads : int
        Number of threads of ONNX Runtime.
    provider : str
        Execution provider of ONNX Runtime.
    size : int or None
        Side of the input of a model that accepts any size; None for the image's own size.
    """

    score: float = MIN_DETECTION_SCORE
    labels: Path | None = None
    threads: int = 1
    provider: str = "CPUExecutionProvider"
    size: int | None = None


class OnnxDetector:
    """A detector from a model in an ONNX file; the layout is recognised from the model itself.

    Parameters
    ----------
    path : Path
        The ONNX file.
    options : OnnxOptions, optional
    feature : str
        Option of the user that needs the model, for messages.

    Raises
    ------
    MissingExtraError
        ONNX Runtime is not installed.
    InputError
        The file is missing or is no model of a known layout.
    """

    def __init__(self, path: Path, options: OnnxOptions | None = None, feature: str = "--detector") -> None:
        self._options = options or OnnxOptions()
        of = self._options
        self._session = Session(path, feature, of.threads, of.provider, side=of.size)
        self._class_names = known_names(path, self._session.metadata, of.labels)
        if IDS in self._session.input_names:
            self._look_for_names(path, feature)
        self._layout = recognise(self._session, len(self._class_names or ()))

    def _look_for_names(self, path: Path, feature: str) -> None:
        """Set the class names as the texts of a model that searches for texts."""
        if self._class_names is None:
            raise InputError(f"{path}: looks for texts: name a file of them, one a line, with labels=FILE")
        tokens = Tokens(path.parent, self._session.text_length, feature)
        self._session.look_for([tokens.of(name) for name in self._class_names])

    @property
    def layout(self) -> str:
        """Name of the recognised layout in messages."""
        return self._layout.name

    def __call__(self, frame: Frame, intrinsics: Intrinsics) -> Detections:
        """Return the detections of `frame`, the best first.

        Raises
        ------
        InputError
            The model's outputs have no known layout, or the numbers of names and classes differ.
        """
        least = self._options.score
        size = self._session.size_for(*frame.color.shape[:2])
        pixels, fit = self._layout.form.prepare(frame.color, *size, self._session.dtype)
        outputs = self._session.run(pixels)
        raw = self._layout.read(outputs, size, least)
        if raw is None:
            shapes = ", ".join(str(np.shape(output)) for output in outputs)
            raise InputError(f"{self._session.path}: outputs {shapes} are of no known kind")
        names = self._names(raw.scores.shape[1])
        used = [k for k, name in enumerate(names) if name or len(names) == 1]
        scores = np.nan_to_num(raw.scores[:, used], nan=0.0, posinf=0.0, neginf=0.0)  # NaN and infinity count as 0
        best = scores.max(axis=1, initial=0.0)
        kept = np.flatnonzero(best >= least)
        kept = kept[thin_out(raw.boxes_xyxy[kept], best[kept], DUPLICATE_IOU)][:MAX_BOXES]
        boxes, _, rows = best_boxes(fit.to_image(raw.boxes_xyxy[kept]), best[kept], intrinsics.width, intrinsics.height)
        kept = kept[rows]
        values = np.clip(scores[kept].astype(np.float32), 0.0, 1.0)
        masks = _masks(raw, kept, boxes, fit, size)
        return Detections(boxes, values, tuple(names[k] for k in used), masks)

    def _names(self, count: int) -> tuple[str, ...]:
        """Return the names of `count` classes; the class of a class-agnostic model has the empty name."""
        if isinstance(self._layout, Masks):
            return ("",)
        names = names_for(count, self._class_names, self._session.path)
        return ("",) if names == (ANYTHING,) else names


def onnx_detector(spec: str, feature: str = "--detector") -> OnnxDetector:
    """Return the model that ``FILE.onnx[:OPTIONS]`` names.

    Raises
    ------
    InputError
        An option is unknown or out of range, or the model cannot be used.
    MissingExtraError
        ONNX Runtime is not installed.
    """
    end = spec.lower().find(ENDING + ":")
    path, options = (spec, "") if end < 0 else (spec[: end + len(ENDING)], spec[end + len(ENDING) + 1 :])
    return OnnxDetector(Path(path), read_options(options), feature)


def read_options(text: str) -> OnnxOptions:
    """Read ``NAME=VALUE,...``.

    Raises
    ------
    InputError
        An option is unknown or out of range.
    """
    given: dict[str, str] = {}
    for word in text.split(",") if text else []:
        name, equals, value = word.partition("=")
        if name not in ("score", "labels", "threads", "provider", "size") or not equals or not value or name in given:
            raise InputError(f"unknown option '{word}' of a detector; expected {HOW}")
        given[name] = value
    try:
        score, threads = float(given.get("score", MIN_DETECTION_SCORE)), int(given.get("threads", "1"))
        size = int(given["size"]) if "size" in given else None
    except ValueError:
        score, threads, size = -1.0, 0, None
    if not (0.0 < score <= 1.0) or threads < 1 or (size is not None and not 1 <= size <= MAX_SIZE):
        raise InputError(f"score must lie in 0..1, threads be 1 or more and size 1 to {MAX_SIZE} pixels, got '{text}'")
    labels = Path(given["labels"]) if "labels" in given else None
    return OnnxOptions(score, labels, threads, given.get("provider", OnnxOptions().provider), size)


def _masks(
    raw: Raw,
    kept: np.ndarray[tuple[int], np.dtype[np.intp]],
    boxes: np.ndarray[tuple[int, int], np.dtype[np.int32]],
    fit: Fit,
    size: tuple[int, int],
) -> tuple[UInt8Array, ...] | None:
    """Return the masks of the selected boxes; None if the model has no masks."""
    if raw.logits is not None:
        heats = list(raw.logits[kept])
    elif raw.prototypes is not None:
        k, height, width = raw.prototypes.shape
        flat = raw.prototypes.reshape(k, -1)
        heats = [(weights @ flat).reshape(height, width) for weights in raw.coefficients[kept]]
    else:
        return None
    return tuple(_mask(box, heat, fit, size) for box, heat in zip(boxes, heats, strict=True))


def _mask(
    box: np.ndarray[tuple[int], np.dtype[np.int32]], heat: Float32Array, fit: Fit, size: tuple[int, int]
) -> UInt8Array:
    """Return the mask of a box, in the box's pixels: where the heat over the input is above 0."""
    import cv2

    x0, y0, x1, y1 = (int(x) for x in box)
    height, width = heat.shape
    # Heat pixel of the centre of image pixel x: ((x + 1/2) * scale + offset) * (width / input width) - 1/2.
    sx, sy = width / size[1], height / size[0]
    columns = ((np.arange(x0, x1) + 0.5) * fit.scale_x + fit.left) * sx - 0.5
    rows = ((np.arange(y0, y1) + 0.5) * fit.scale_y + fit.top) * sy - 0.5
    at_x, at_y = np.meshgrid(columns.astype(np.float32), rows.astype(np.float32))
    logits = cv2.remap(heat, at_x, at_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(logits > 0, dtype=np.uint8)
