"""An ONNX model that is open: its inputs and outputs, its metadata, and running it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cuboid.core.errors import InputError
from cuboid.core.extras import require

# Where a model takes any size, the image's own rounded up to this: the largest stride of the YOLO family.
STRIDE = 32
# Inputs beside the image that detectors have: the image size of the boxes, and how the image was scaled.
TARGET_SIZE, SCALE_FACTOR, IMAGE_SHAPE = "orig_target_sizes", "scale_factor", "im_shape"
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
        What needs it, as the user asked for it.
    threads : int
    provider : str
        Of ONNX Runtime, such as CPUExecutionProvider.
    extra : str
        The extra that brings ONNX Runtime.

    Raises
    ------
    MissingExtraError
        ONNX Runtime is not installed.
    InputError
        The file is not there, is no model, or takes something else than one image of three colors.
    """

    def __init__(
        self,
        path: Path,
        feature: str,
        threads: int = 1,
        provider: str = "CPUExecutionProvider",
        extra: str = "onnx",
    ) -> None:
        self._session = start(path, feature, threads, provider, extra)
        self.path = path
        self.outputs = tuple(str(one.name) for one in self._session.get_outputs())
        inputs = self._session.get_inputs()
        images = [one for one in inputs if len(one.shape) == 4]
        others = [one for one in inputs if len(one.shape) != 4]
        self._others = {one.name: one.type for one in others}
        unknown = [name for name in self._others if name not in (TARGET_SIZE, SCALE_FACTOR, IMAGE_SHAPE)]
        if len(images) != 1 or unknown:
            seen = ", ".join(f"{one.name} {tuple(one.shape)}" for one in inputs)
            raise InputError(f"{path}: a model with one input (1, 3, height, width) expected, its inputs are {seen}")
        self._image = images[0]
        channels = self._image.shape[1]
        if isinstance(channels, int) and channels != 3:
            raise InputError(f"{path}: a model of 3 color channels expected, it has {channels}")

    @property
    def metadata(self) -> Mapping[str, str]:
        """What the exporter wrote into the file, by key."""
        found: dict[str, str] = self._session.get_modelmeta().custom_metadata_map
        return found

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the inputs beside the image."""
        return tuple(self._others)

    @property
    def dtype(self) -> Any:
        """Type of the image's numbers."""
        return KINDS.get(self._image.type, np.float32)

    @property
    def fixed_size(self) -> tuple[int, int] | None:
        """Rows and columns of its input; None where it takes any."""
        rows, columns = self._image.shape[2:]
        return (rows, columns) if isinstance(rows, int) and isinstance(columns, int) else None

    def size_for(self, height: int, width: int) -> tuple[int, int]:
        """Return rows and columns of the input for an image of this size."""
        return tuple(
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
        values = {TARGET_SIZE: [[columns, rows]], SCALE_FACTOR: [[1, 1]], IMAGE_SHAPE: [[rows, columns]]}
        feeds = {name: np.array(values[name], KINDS.get(kind, np.float32)) for name, kind in self._others.items()}
        try:
            outputs: list[Any] = self._session.run(None, {self._image.name: pixels, **feeds})
        except Exception as error:
            raise InputError(f"{self.path} cannot be run: {_line(error)}") from None
        return [np.asarray(output) for output in outputs]


def start(
    path: Path, feature: str, threads: int = 1, provider: str = "CPUExecutionProvider", extra: str = "onnx"
) -> Any:
    """Return the session of ONNX Runtime of a model; parameters and errors as of `Session`, whatever its inputs."""
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
    except Exception as error:  # ONNX Runtime has no common class of its own for what a file can have wrong
        raise InputError(f"{path} is no ONNX model that can be run: {_line(error)}") from None


def _line(error: Exception) -> str:
    return (str(error) or type(error).__name__).splitlines()[0]
