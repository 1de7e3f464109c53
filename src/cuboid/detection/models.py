"""Models that have a name, and the folder in which they are kept."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from cuboid.core.errors import InputError
from cuboid.detection.onnx import OnnxDetector, read_options
from cuboid.detection.registry import DETECTORS
from cuboid.detection.types import Detector

# Where models are kept, unless the environment names a folder.
FOLDER_VARIABLE = "CUBOID_MODELS"


@dataclass(frozen=True, slots=True)
class Model:
    """A model that its publisher offers.

    Attributes
    ----------
    name : str
    url : str
        The publisher's address.
    sha256 : str
        Of the file, hexadecimal.
    size_bytes : int
    license : str
        SPDX identifier.
    publisher : str
    what : str
        One line.
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
        """Where it is kept, fetched or not."""
        return models_folder() / f"{self.name}.onnx"


MODELS = {
    model.name: model
    for model in (
        Model(
            name="yolox-nano",
            url="https://github.com/Megvii-BaseDetection/YOLOX/releases/download/0.1.1rc0/yolox_nano.onnx",
            sha256="c789161ed43c8269fcd4e67c67eeeb4e80c622da2eb296a20bc6007bd18a0b7d",
            size_bytes=3_659_407,
            license="Apache-2.0",
            publisher="Megvii",
            what="YOLOX-nano, 80 classes of COCO, input 416 x 416",
        ),
    )
}


def models_folder() -> Path:
    """Return the folder in which models are kept: that of the environment, else one in the user's cache."""
    named = os.environ.get(FOLDER_VARIABLE)
    if named:
        return Path(named)
    cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(cache) / "cuboid" / "models"


def kept_model(name: str, options: str | None) -> Detector:
    """Return a model that was fetched.

    Raises
    ------
    InputError
        It was not fetched, or an option is wrong.
    """
    model = MODELS[name]
    if not model.path.is_file():
        raise InputError(f"the model '{name}' is not at {model.path}; 'cuboid models fetch {name}' fetches it")
    return OnnxDetector(model.path, read_options(options or ""))


@DETECTORS.register("yolox-nano")
def yolox_nano(options: str | None) -> Detector:
    """Return YOLOX-nano; see `kept_model`."""
    return kept_model("yolox-nano", options)
