"""An image-text model: two ONNX files, one for pictures and one for texts, whose vectors are alike where these are."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cuboid.core.errors import InputError, one_line
from cuboid.core.frame import Float32Array, UInt8Array
from cuboid.core.paths import PathLike, as_path
from cuboid.detection.session import IDS, KINDS, MASK, Session, start
from cuboid.detection.tokens import Tokens
from cuboid.text_search.preparation import Preparation, read_preparation

# Names that the two models have: ours, and those in folders that are published.
IMAGE_NAMES = ("image.onnx", "vision_model.onnx", "onnx/vision_model.onnx")
TEXT_NAMES = ("text.onnx", "text_model.onnx", "onnx/text_model.onnx")
# Outputs that hold the vector, the first of these that there is: CLIP's, and SigLIP's.
IMAGE_OUTPUTS = ("image_embeds", "pooler_output")
TEXT_OUTPUTS = ("text_embeds", "pooler_output")
# The folder of the model, where nobody names one.
MODEL_VARIABLE = "CUBOID_TEXT_MODEL"
EXTRA = "names"
# Digits of a model's identity: two of the models of one user never have the same.
IDENTITY_DIGITS = 16


class TextQuery(NamedTuple):
    """A text that objects are ranked by.

    Attributes
    ----------
    text : str
    model : str
        Identity of the model.
    vector : (D,) float32
        Of the text; of length 1.
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
        What needs it, as the user asked for it.

    Raises
    ------
    InputError
        A file is missing, or is no model of the kind.
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
        """Digits that tell models apart: vectors of two models cannot be compared."""
        with self._image_path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()[:IDENTITY_DIGITS]

    @cached_property
    def preparation(self) -> Preparation:
        """How it takes its images."""
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
            The model cannot be run, or tells no vector.
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
            The text is empty, or the model cannot be run or tells no vector.
        """
        if not text.strip():
            raise InputError("expected a text that describes an object, got an empty one")
        return TextQuery(text.strip(), self.identity, self._text.vector(text.strip()))


class _TextSession:
    """The text model that is open, with its tokenizer."""

    def __init__(self, folder: Path, path: Path, feature: str) -> None:
        self._path = path
        self._session = start(path, feature, extra=EXTRA)
        inputs = self._session.get_inputs()
        self._kinds = {one.name: one.type for one in inputs}
        shapes = {one.name: one.shape for one in inputs}
        if IDS not in shapes or not {*shapes} <= {IDS, MASK} or len(shapes[IDS]) != 2:
            seen = ", ".join(f"{name} {tuple(shape)}" for name, shape in shapes.items())
            raise InputError(f"{path}: a model with an input {IDS} (1, length) expected, its inputs are {seen}")
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
        except Exception as error:  # ONNX Runtime has no common class of its own for what a model can refuse
            raise InputError(f"{self._path} cannot be run: {one_line(str(error))}") from None
        names = [str(one.name) for one in self._session.get_outputs()]
        return _vector(self._path, names, outputs, TEXT_OUTPUTS)


def open_text_model(model: PathLike | TextModel | None, feature: str = "--text-model") -> TextModel:
    """Return the image-text model in a folder; that of the environment variable `MODEL_VARIABLE` where None is named.

    Parameters
    ----------
    model : path, TextModel or None
    feature : str
        What needs it, as the user asked for it.

    Raises
    ------
    InputError
        None is named at all, or there is no such model.
    """
    if isinstance(model, TextModel):
        return model
    named = model or os.environ.get(MODEL_VARIABLE)
    if not named:
        raise InputError(f"a text needs an image-text model: name its folder, or set {MODEL_VARIABLE}")
    return TextModel(named, feature)


def _found(folder: Path, names: Iterable[str]) -> Path:
    """Return the first of these files that a folder has."""
    paths = [folder / name for name in names]
    found = next((path for path in paths if path.is_file()), None)
    if found is None:
        expected = " or ".join(path.relative_to(folder).as_posix() for path in paths)
        raise InputError(f"{folder}: has no {expected}")
    return found


def _vector(path: Path, names: Iterable[str], outputs: Iterable[Any], wanted: Iterable[str]) -> Float32Array:
    """Return the vector that a model tells, of length 1: its named output, else its only one that is a vector."""
    arrays = {name: np.asarray(output) for name, output in zip(names, outputs, strict=True)}
    flat = {name: array for name, array in arrays.items() if array.ndim == 2 and array.shape[0] == 1}
    chosen = next((flat[name] for name in wanted if name in flat), None)
    if chosen is None and len(flat) == 1:
        (chosen,) = flat.values()
    if chosen is None:
        seen = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
        raise InputError(f"{path}: an output {' or '.join(wanted)} (1, n) expected, its outputs are {seen}")
    vector = chosen[0].astype(np.float32)
    length = float(np.linalg.norm(vector))
    if not np.isfinite(length) or length == 0.0:
        raise InputError(f"{path}: its output is no direction: its length is {length}")
    return np.asarray(vector / length, np.float32)
