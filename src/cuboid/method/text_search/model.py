"""An image-text model: two ONNX files, for pictures and for texts; a matching picture and text have similar vectors."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cuboid.ground.arrays import Float32Array, UInt8Array
from cuboid.ground.core.errors import InputError, one_line
from cuboid.ground.core.paths import PathLike, as_path
from cuboid.method.detection.session import IDS, KINDS, MASK, Session, start
from cuboid.method.detection.tokens import Tokens
from cuboid.method.text_search.preparation import Preparation, read_preparation

# File names of the two models: the names of this program, and those of published folders.
IMAGE_NAMES = ("image.onnx", "vision_model.onnx", "onnx/vision_model.onnx")
TEXT_NAMES = ("text.onnx", "text_model.onnx", "onnx/text_model.onnx")
# Outputs with the vector, of CLIP and of SigLIP; the first existing one is used.
IMAGE_OUTPUTS = ("image_embeds", "pooler_output")
TEXT_OUTPUTS = ("text_embeds", "pooler_output")
# The environment variable with the default folder of the model.
MODEL_VARIABLE = "CUBOID_TEXT_MODEL"
EXTRA = "names"
# Number of digits in a model's identity; with them, a collision between the models of a user is practically impossible.
IDENTITY_DIGITS = 16


class TextQuery(NamedTuple):
    """A text by which objects are ranked.

    Attributes
    ----------
    text : str
    model : str
        Identity of the model.
    vector : (D,) float32
        Unit vector of the text.
    """

    text: str
    model: str
    vector: Float32Array


class TextModel:
    """An image-text model in a folder: `image.onnx`, `text.onnx`, `tokenizer.json`.

    Parameters
    ----------
    folder : path
    feature : str
        Feature that needs the model, for error messages.

    Raises
    ------
    InputError
        A file is missing, or is not a model of this kind.
    """

    def __init__(self, folder: PathLike, feature: str = "--text-model") -> None:
        self.folder, self._feature = as_path(folder), feature
        if not self.folder.is_dir():
            raise InputError(f"{self.folder}: expected a folder with image.onnx, text.onnx and tokenizer.json")
        self._image_path = _found(self.folder, IMAGE_NAMES)
        self._text_path = _found(self.folder, TEXT_NAMES)

    def __repr__(self) -> str:
        return f"TextModel({self.folder})"

    @cached_property
    def identity(self) -> str:
        """Digits that identify the model: vectors of two models cannot be compared."""
        with self._image_path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()[:IDENTITY_DIGITS]

    @cached_property
    def preparation(self) -> Preparation:
        """The preparation of its images."""
        return read_preparation(self.folder, self._image.fixed_size)

    @cached_property
    def _image(self) -> Session:
        return Session(self._image_path, self._feature, extra=EXTRA)

    @cached_property
    def _text(self) -> _TextSession:
        return _TextSession(self.folder, self._text_path, self._feature)

    def embed_pictures(self, pictures: Iterable[UInt8Array]) -> Float32Array:
        """Return the unit vectors (N, D) of square pictures (n, n, 3), RGB.

        Raises
        ------
        InputError
            The model cannot be run, or returns no vector.
        """
        rows = []
        for color in pictures:
            outputs = self._image.run(self.preparation.prepare(color, self._image.dtype))
            rows.append(_vector(self._image_path, self._image.outputs, outputs, IMAGE_OUTPUTS))
        return np.array(rows, np.float32).reshape(len(rows), -1)

    def query(self, text: str) -> TextQuery:
        """Return a text with its vector.

        Raises
        ------
        InputError
            The text is empty, or the model cannot be run or returns no vector.
        """
        if not text.strip():
            raise InputError("expected a text that describes an object, got an empty text")
        return TextQuery(text.strip(), self.identity, self._text.vector(text.strip()))


class _TextSession:
    """The open text model with its tokenizer."""

    def __init__(self, folder: Path, path: Path, feature: str) -> None:
        self._path = path
        self._session = start(path, feature, extra=EXTRA)
        inputs = self._session.get_inputs()
        self._kinds = {one.name: one.type for one in inputs}
        shapes = {one.name: one.shape for one in inputs}
        if IDS not in shapes or not {*shapes} <= {IDS, MASK} or len(shapes[IDS]) != 2:
            seen = ", ".join(f"{name} {tuple(shape)}" for name, shape in shapes.items())
            raise InputError(f"{path}: expected a model with an input {IDS} (1, length); its inputs are {seen}")
        length = shapes[IDS][1]
        self._tokens = Tokens(folder, length if isinstance(length, int) else None, feature)

    def vector(self, text: str) -> Float32Array:
        """Return the unit vector of a text."""
        feeds = {
            name: np.array([values], KINDS.get(self._kinds[name], np.int64))
            for name, values in zip((IDS, MASK), self._tokens.of(text), strict=True)
            if name in self._kinds
        }
        try:
            outputs = self._session.run(None, feeds)
        except Exception as error:  # ONNX Runtime has no common base class of its errors
            raise InputError(f"{self._path} cannot be run: {one_line(str(error))}") from None
        names = [str(one.name) for one in self._session.get_outputs()]
        return _vector(self._path, names, outputs, TEXT_OUTPUTS)


def open_text_model(model: PathLike | TextModel | None, feature: str = "--text-model") -> TextModel:
    """Return the image-text model in a folder (default: the folder in the environment variable `MODEL_VARIABLE`).

    Parameters
    ----------
    model : path, TextModel or None
    feature : str
        Feature that needs the model, for error messages.

    Raises
    ------
    InputError
        No folder is given, or it has no such model.
    """
    if isinstance(model, TextModel):
        return model
    named = model or os.environ.get(MODEL_VARIABLE)
    if not named:
        raise InputError(f"a text needs an image-text model: name its folder, or set {MODEL_VARIABLE}")
    return TextModel(named, feature)


def _found(folder: Path, names: Iterable[str]) -> Path:
    """Return the first of these files that exists in a folder."""
    paths = [folder / name for name in names]
    found = next((path for path in paths if path.is_file()), None)
    if found is None:
        expected = " or ".join(path.relative_to(folder).as_posix() for path in paths)
        raise InputError(f"{folder}: expected {expected}")
    return found


def _vector(path: Path, names: Iterable[str], outputs: Iterable[Any], wanted: Iterable[str]) -> Float32Array:
    """Return the unit vector from the outputs of a model: a named output, or the only output that is a vector."""
    arrays = {name: np.asarray(output) for name, output in zip(names, outputs, strict=True)}
    flat = {name: array for name, array in arrays.items() if array.ndim == 2 and array.shape[0] == 1}
    chosen = next((flat[name] for name in wanted if name in flat), None)
    if chosen is None and len(flat) == 1:
        (chosen,) = flat.values()
    if chosen is None:
        seen = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
        raise InputError(f"{path}: expected an output {' or '.join(wanted)} (1, n); its outputs are {seen}")
    vector = chosen[0].astype(np.float32)
    length = float(np.linalg.norm(vector))
    if not np.isfinite(length) or length == 0.0:
        raise InputError(f"{path}: expected an output vector of finite length above 0, got length {length}")
    return np.asarray(vector / length, np.float32)
