"""Preparation of images for an image-text model: size and normalisation, from its ``preprocessor_config.json``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import cv2
import msgspec
import numpy as np
from msgspec import Meta

from cuboid.ground.arrays import UInt8Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.formats.json_validation import read_json
from cuboid.method.detection.images import CLIP_DEVIATION, CLIP_MEAN

PREPROCESSOR = "preprocessor_config.json"
# Side of the images of CLIP, pixels.
CLIP_SIDE = 224
# Filters by their number in Pillow, which the file uses; other numbers are treated as bicubic.
FILTERS = {0: cv2.INTER_NEAREST, 2: cv2.INTER_LINEAR}

_Side: TypeAlias = Annotated[int, Meta(ge=1, le=4096)]
_Size: TypeAlias = int | dict[str, Any]
_Three: TypeAlias = tuple[float, float, float]
_Deviation: TypeAlias = Annotated[float, Meta(gt=0.0)]


class _Preprocessor(msgspec.Struct):
    """The used fields of ``preprocessor_config.json``, a file of Hugging Face Transformers."""

    size: _Size = CLIP_SIDE
    crop_size: _Size | None = None
    do_center_crop: bool = False
    do_rescale: bool = True
    rescale_factor: Annotated[float, Meta(gt=0.0)] = 1.0 / 255.0
    do_normalize: bool = True
    image_mean: _Three = CLIP_MEAN
    image_std: tuple[_Deviation, _Deviation, _Deviation] = CLIP_DEVIATION
    resample: int = 3


@dataclass(frozen=True, slots=True)
class Preparation:
    """The preparation of an image for a model.

    Attributes
    ----------
    height, width : int
        Size of its input, pixels.
    scale : float
        Factor for the levels 0..255.
    mean, deviation : (float, float, float)
        Of the scaled red, green and blue; each is normalised as (level - mean) / deviation.
    enlarging : int
        Filter of OpenCV for enlarging an image.
    """

    height: int
    width: int
    scale: float = 1.0 / 255.0
    mean: tuple[float, float, float] = CLIP_MEAN
    deviation: tuple[float, float, float] = CLIP_DEVIATION
    enlarging: int = cv2.INTER_CUBIC

    @property
    def background(self) -> UInt8Array:
        """The color, RGB (3,), that becomes zero in the input of the model."""
        return np.clip(np.rint(np.array(self.mean) / self.scale), 0, 255).astype(np.uint8)

    def prepare(self, color: UInt8Array, dtype: Any) -> Any:
        """Return a square picture (n, n, 3), RGB, as the input of the model, (1, 3, height, width)."""
        smaller = color.shape[0] > self.height
        filtered = cv2.INTER_AREA if smaller else self.enlarging
        resized = cv2.resize(color, (self.width, self.height), interpolation=filtered).astype(np.float32)
        normal = (resized * self.scale - np.array(self.mean)) / np.array(self.deviation)
        return np.ascontiguousarray(normal.transpose(2, 0, 1)[None], dtype=dtype)


def read_preparation(folder: Path, fixed: tuple[int, int] | None) -> Preparation:
    """Return the preparation of images for the model in a folder, from ``preprocessor_config.json``; else that of CLIP.

    Parameters
    ----------
    folder : Path
    fixed : (int, int) or None
        Rows and columns of the model's input; None if it accepts any size.

    Raises
    ------
    InputError
        The file is malformed, or inconsistent with the model.
    """
    path = folder / PREPROCESSOR
    if not path.is_file():
        return Preparation(*(fixed or (CLIP_SIDE, CLIP_SIDE)))
    settings = read_json(path, _Preprocessor)
    named = settings.crop_size if settings.do_center_crop and settings.crop_size is not None else settings.size
    height, width = _sides(named, path)
    if fixed is not None and fixed != (height, width):
        raise InputError(f"{path}: images of {width} x {height} pixels, but the model needs {fixed[1]} x {fixed[0]}")
    return Preparation(
        height,
        width,
        settings.rescale_factor if settings.do_rescale else 1.0,
        settings.image_mean if settings.do_normalize else (0.0, 0.0, 0.0),
        settings.image_std if settings.do_normalize else (1.0, 1.0, 1.0),
        FILTERS.get(settings.resample, cv2.INTER_CUBIC),
    )


def _sides(size: _Size, path: Path) -> tuple[int, int]:
    """Return height and width of a size: a number, its shortest edge (pictures here are square), or both sides."""
    both = size if isinstance(size, dict) else {"shortest_edge": size}
    edge = both.get("shortest_edge")
    try:
        height, width = msgspec.convert((both.get("height", edge), both.get("width", edge)), tuple[_Side, _Side])
    except msgspec.ValidationError:
        raise InputError(
            f"{path}: size: expected a number of pixels, 'shortest_edge', or 'height' and 'width', got {size}"
        ) from None
    return height, width
