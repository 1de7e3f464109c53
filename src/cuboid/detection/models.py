"""Named models, and the folder in which they are stored."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from cuboid.core.errors import InputError
from cuboid.detection.onnx import OnnxDetector, read_options
from cuboid.detection.registry import DETECTORS
from cuboid.detection.types import Detector

# Environment variable for the folder of models.
FOLDER_VARIABLE = "CUBOID_MODELS"


@dataclass(frozen=True, slots=True)
class Model:
    """A model that can be downloaded from its publisher.

    Attributes
    ----------
    name : str
    url : str
        The publisher's address.
    sha256 : str
        SHA-256 checksum of the file, hexadecimal.
    size_bytes : int
    license : str
        SPDX identifier.
    publisher : str
    what : str
        Description in one line.
    """

    name: str
    url: str
    sha256: str
    size_bytes: int
    license: str
    publisher: str
    what: str

    @property
    def path(self) -> Path:
        """Path of the file, whether downloaded or not."""
        return models_folder() / f"{self.name}.onnx"


_YOLOX = "https://github.com/Megvii-BaseDetection/YOLOX/releases/download/0.1.1rc0"


def _yolox(name: str, file: str, sha256: str, size_bytes: int, side: int) -> Model:
    what = f"80 classes of COCO, input {side} x {side}"
    return Model(name, f"{_YOLOX}/{file}", sha256, size_bytes, "Apache-2.0", "Megvii", what)


MODELS = {
    model.name: model
    for model in (
        _yolox(
            "yolox-nano", "yolox_nano.onnx",
            "c789161ed43c8269fcd4e67c67eeeb4e80c622da2eb296a20bc6007bd18a0b7d", 3_659_407, 416,
        ),
        _yolox(
            "yolox-tiny", "yolox_tiny.onnx",
            "427cc366d34e27ff7a03e2899b5e3671425c262ea2291f88bb942bc1cc70b0f7", 20_219_662, 416,
        ),
        _yolox(
            "yolox-s", "yolox_s.onnx",
            "c5c2d13e59ae883e6af3b45daea64af4833a4951c92d116ec270d9ddbe998063", 35_858_002, 640,
        ),
    )
}  # fmt: skip


def models_folder() -> Path:
    """Return the folder of models: from the environment, else in the user's cache."""
    named = os.environ.get(FOLDER_VARIABLE)
    if named:
        return Path(named)
    cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(cache) / "cuboid" / "models"


def kept_model(name: str, options: str | None) -> Detector:
    """Return the detector of a downloaded model.

    Raises
    ------
    InputError
        The model was not downloaded, or an option is wrong.
    """
    model = MODELS[name]
    if not model.path.is_file():
        raise InputError(f"the model '{name}' is not at {model.path}; 'cuboid models fetch {name}' fetches it")
    return OnnxDetector(model.path, read_options(options or ""))


for _name in MODELS:
    DETECTORS.register(_name)(partial(kept_model, _name))
