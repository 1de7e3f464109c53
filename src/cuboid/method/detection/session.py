"""An open ONNX model: its inputs, outputs and metadata, and its execution."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cuboid.ground.core.errors import InputError
from cuboid.ground.core.extras import require

# The image size is rounded up to a multiple of this for models that accept any size: the YOLO family's largest stride.
STRIDE = 32
# Other inputs of detectors: image size for the boxes, and scale of the image.
TARGET_SIZE, SCALE_FACTOR, IMAGE_SHAPE = "orig_target_sizes", "scale_factor", "im_shape"
# Texts to search for, as token numbers, and the mask of valid tokens.
IDS, MASK = "input_ids", "attention_mask"
# Query points for masks, (1, queries, points per query, 2), and their kinds: inside (1) or unused (-1).
POINTS, POINT_LABELS = "batched_point_coords", "batched_point_labels"
OTHERS = (TARGET_SIZE, SCALE_FACTOR, IMAGE_SHAPE, IDS, MASK, POINTS, POINT_LABELS)
# Number of query points per side of their grid, unless the model fixes it: each point costs a mask, and objects smaller
# than a sixteenth of the image are rarely of interest.
GRID = 16
KINDS = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
    "tensor(double)": np.float64,
    "tensor(int64)": np.int64,
    "tensor(int32)": np.int32,
}


class Session:
    """A model run by ONNX Runtime.

    Parameters
    ----------
    path : Path
        The ONNX file.
    feature : str
        Option of the user that needs the model, for messages.
    threads : int
    provider : str
        Execution provider of ONNX Runtime, such as CPUExecutionProvider.
    extra : str
        The extra that installs ONNX Runtime.
    side : int, optional
        Side of the input, if it accepts any size; default: the image's own size.

    Raises
    ------
    MissingExtraError
        ONNX Runtime is not installed.
    InputError
        The file is missing, is no model, or does not take one image with three channels.
    """

    def __init__(
        self,
        path: Path,
        feature: str,
        threads: int = 1,
        provider: str = "CPUExecutionProvider",
        extra: str = "onnx",
        side: int | None = None,
    ) -> None:
        self._session = start(path, feature, threads, provider, extra)
        self.path = path
        self.outputs = tuple(str(one.name) for one in self._session.get_outputs())
        inputs = self._session.get_inputs()
        images = [one for one in inputs if len(one.shape) == 4 and one.name not in OTHERS]
        others = [one for one in inputs if len(one.shape) != 4 or one.name in OTHERS]
        self._others = {one.name: one.type for one in others}
        self._shapes = {one.name: one.shape for one in others}
        self._texts: dict[str, list[list[int]]] = {}
        self._side = side
        unknown = [name for name in self._others if name not in OTHERS]
        if len(images) != 1 or unknown:
            seen = ", ".join(f"{one.name} {tuple(one.shape)}" for one in inputs)
            raise InputError(f"{path}: a model with one input (1, 3, height, width) expected, its inputs are {seen}")
        self._image = images[0]
        channels = self._image.shape[1]
        if isinstance(channels, int) and channels != 3:
            raise InputError(f"{path}: a model of 3 color channels expected, it has {channels}")

    @property
    def metadata(self) -> Mapping[str, str]:
        """Metadata that the exporter wrote into the file, by key."""
        found: dict[str, str] = self._session.get_modelmeta().custom_metadata_map
        return found

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the inputs other than the image."""
        return tuple(self._others)

    @property
    def dtype(self) -> Any:
        """Data type of the image input."""
        return KINDS.get(self._image.type, np.float32)

    @property
    def fixed_size(self) -> tuple[int, int] | None:
        """Rows and columns of the input; None if it accepts any size."""
        rows, columns = (side if isinstance(side, int) else self._side for side in self._image.shape[2:])
        return None if rows is None or columns is None else (rows, columns)

    @property
    def text_length(self) -> int | None:
        """Number of tokens per text; None if it accepts any number."""
        length = self._shapes[IDS][-1]
        return length if isinstance(length, int) else None

    def look_for(self, texts: Sequence[tuple[list[int], list[int]]]) -> None:
        """Set the texts to search for: tokens and mask of each, all with the same length."""
        self._texts = {IDS: [ids for ids, _ in texts], MASK: [mask for _, mask in texts]}

    def size_for(self, height: int, width: int) -> tuple[int, int]:
        """Return rows and columns of the input for an image of this size."""
        return self.fixed_size or tuple(
            side if isinstance(side, int) else -(-own // STRIDE) * STRIDE
            for side, own in zip(self._image.shape[2:], (height, width), strict=True)
        )  # type: ignore[return-value]

    def run(self, pixels: Any) -> list[Any]:
        """Return the outputs for an image (1, 3, rows, columns); boxes are in its pixels.

        Raises
        ------
        InputError
            The model cannot be run.
        """
        rows, columns = pixels.shape[2:]
        values: dict[str, Any] = {
            TARGET_SIZE: [[columns, rows]],
            SCALE_FACTOR: [[1, 1]],
            IMAGE_SHAPE: [[rows, columns]],
            **self._texts,
            **(self._points(rows, columns) if POINTS in self._others else {}),
        }
        feeds = {name: np.array(values[name], KINDS.get(kind, np.float32)) for name, kind in self._others.items()}
        try:
            outputs: list[Any] = self._session.run(None, {self._image.name: pixels, **feeds})
        except Exception as error:
            raise InputError(f"{self.path} cannot be run: {_line(error)}") from None
        return [np.asarray(output) for output in outputs]

    def _points(self, rows: int, columns: int) -> dict[str, Any]:
        """Return a grid of query points over the input."""
        queries, points = (n if isinstance(n, int) else None for n in self._shapes[POINTS][1:3])
        side = GRID if queries is None else max(1, int(queries**0.5))
        y, x = np.divmod(np.arange(side * side), side)
        place = np.zeros((1, queries or side * side, points or 1, 2))
        kind = np.full(place.shape[:3], -1)
        place[0, : len(x), 0] = np.column_stack([(x + 0.5) / side * columns, (y + 0.5) / side * rows])
        kind[0, : len(x), 0] = 1
        return {POINTS: place, POINT_LABELS: kind}


def start(
    path: Path, feature: str, threads: int = 1, provider: str = "CPUExecutionProvider", extra: str = "onnx"
) -> Any:
    """Return an ONNX Runtime session with any inputs; parameters and errors as for `Session`."""
    onnxruntime = require("onnxruntime", feature, extra)
    if not path.is_file():
        raise InputError(f"no model at {path}")
    if provider not in onnxruntime.get_available_providers():
        there = ", ".join(onnxruntime.get_available_providers())
        raise InputError(f"ONNX Runtime has no provider '{provider}' here; there are {there}")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = 4  # errors come as exceptions
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=[provider])
    except Exception as error:  # ONNX Runtime has no common error class
        raise InputError(f"{path} is no ONNX model that can be run: {_line(error)}") from None


def _line(error: Exception) -> str:
    return (str(error) or type(error).__name__).splitlines()[0]
