"""Named models, and the folder in which they are stored."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from cuboid.ground.core.errors import InputError
from cuboid.method.detection.onnx import OnnxDetector, read_options
from cuboid.method.detection.registry import DETECTORS
from cuboid.method.detection.types import Detector

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
        Its classes, and the side of its input.
    size : int or None
        Side of its input, pixels, where the file leaves it open.
    milliseconds : float or None
        Time of one image on one quiet core; None where it was not measured.
    """

    name: str
    url: str
    sha256: str
    size_bytes: int
    license: str
    publisher: str
    what: str
    size: int | None = None
    milliseconds: float | None = None

    @property
    def path(self) -> Path:
        """Path of the file, whether downloaded or not."""
        return models_folder() / f"{self.name}.onnx"

    @property
    def kept(self) -> bool:
        """Whether it was downloaded; raises InputError if the folder cannot be read."""
        try:
            return self.path.is_file()
        except OSError as error:
            raise InputError(
                f"{models_folder()}: cannot be read: {error.strerror}; {FOLDER_VARIABLE} names another folder"
            ) from None


_YOLOX = "https://github.com/Megvii-BaseDetection/YOLOX/releases/download/0.1.1rc0"


_HUGGING_FACE = "https://huggingface.co/onnx-community"
# Side of the images that DETR-like models were trained with, pixels; their files take any size.
_DETR_SIDE = 640


def _yolox(name: str, file: str, sha256: str, size_bytes: int, side: int, milliseconds: float | None = None) -> Model:
    what = f"COCO, {side} px"
    url = f"{_YOLOX}/{file}"
    return Model(name, url, sha256, size_bytes, "Apache-2.0", "Megvii", what, milliseconds=milliseconds)


def _detr(name: str, repository: str, revision: str, sha256: str, size_bytes: int) -> Model:
    """Return a model that the ONNX community exported from its authors' weights, at a fixed revision."""
    what = f"COCO, {_DETR_SIDE} px"
    url = f"{_HUGGING_FACE}/{repository}/resolve/{revision}/onnx/model.onnx"
    return Model(name, url, sha256, size_bytes, "Apache-2.0", "onnx-community", what, _DETR_SIDE)


MODELS = {
    model.name: model
    for model in (
        _yolox(
            "yolox-nano", "yolox_nano.onnx",
            "c789161ed43c8269fcd4e67c67eeeb4e80c622da2eb296a20bc6007bd18a0b7d", 3_659_407, 416, 14.0,
        ),
        _yolox(
            "yolox-tiny", "yolox_tiny.onnx",
            "427cc366d34e27ff7a03e2899b5e3671425c262ea2291f88bb942bc1cc70b0f7", 20_219_662, 416,
        ),
        _yolox(
            "yolox-s", "yolox_s.onnx",
            "c5c2d13e59ae883e6af3b45daea64af4833a4951c92d116ec270d9ddbe998063", 35_858_002, 640,
        ),
        _yolox(
            "yolox-m", "yolox_m.onnx",
            "21ff6cfdeb53b013bac2249599e55f00bff3cfdfdab37ed7a4620818c1d15b3f", 101_259_744, 640,
        ),
        _yolox(
            "yolox-l", "yolox_l.onnx",
            "7860ae79de6c89a3c1eb72ae9a2756c0ccfbe04b7791bb5880afabd97855a411", 216_746_733, 640,
        ),
        _yolox(
            "yolox-x", "yolox_x.onnx",
            "c892d7aaf1c4746d8a4d675bec669a4db4f434b4ee1efb654bc9b353379c7c55", 396_142_663, 640,
        ),
        _detr(
            "d-fine-n", "dfine_n_coco-ONNX", "380d2839c327efaf65dd0fe0c2c10ab7fadd5473",
            "0f684f409618ee8a822410e754a29caa817d1aa16283ce89cad936d0a48e2f35", 15_258_358,
        ),
        _detr(
            "d-fine-s", "dfine_s_coco-ONNX", "a3cf03147a9b86c78475139115c8ac142577352d",
            "cd8a49a945feda6d28c6304ae8ae85c2759ba1d78a5a83a22c5ce8db82ef7238", 41_535_197,
        ),
        _detr(
            "d-fine-s-o365", "dfine_s_obj2coco-ONNX", "f69c4ca98cba7ca58aa15b3d4600867808fecf1b",
            "b9e2e76610053aeeac3b2f1f685d8f9a1182a93a338f624b6c8cb7fb390cb532", 41_535_197,
        ),
        _detr(
            "d-fine-m", "dfine_m_coco-ONNX", "489756db2825cb068a588fe930af239a656d1fe1",
            "70aaa837978a06ba44ad17398c7079ae5a1a7b1a9032b5d7053981e1ada02d6b", 78_624_257,
        ),
        _detr(
            "d-fine-l", "dfine_l_coco-ONNX", "e09b218185400510b68d067bbd0c9379d905ffcd",
            "d678f3baebfb909d3a20f21d1d807544d0172ed47fa1ab88e7fcdec7e365b236", 125_348_332,
        ),
        _detr(
            "rt-detr-v2-r18", "rtdetr_v2_r18vd-ONNX", "936f90b6a476c6da4dfe053fc521af55285976ba",
            "583a236ac21c95a7fd94f284fc21485e42355bfef82c27011ba78fbc09ee87e2", 81_057_510,
        ),
    )
}  # fmt: skip


def models_folder() -> Path:
    """Return the folder of models: from the environment, else in the user's cache; raise InputError if both lack."""
    named = os.environ.get(FOLDER_VARIABLE)
    if named:
        return Path(named)
    try:
        cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    except RuntimeError:  # the user has no home
        raise InputError(f"the home folder is unknown; {FOLDER_VARIABLE} names a folder of models") from None
    return Path(cache) / "cuboid" / "models"


def kept_model(name: str, options: str | None) -> Detector:
    """Return the detector of a downloaded model.

    Raises
    ------
    InputError
        The model was not downloaded, or an option is wrong.
    """
    model = MODELS[name]
    if not model.kept:
        raise InputError(f"the model '{name}' is not at {model.path}; 'cuboid models fetch {name}' fetches it")
    asked = read_options(options or "")
    return OnnxDetector(model.path, asked if asked.size else replace(asked, size=model.size))


for _name in MODELS:
    DETECTORS.register(_name)(partial(kept_model, _name))
