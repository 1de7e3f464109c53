"""The vectors of objects by an image-text model: stored beside the results as `embeddings.npz`, and ranked by a text.

::

    embeddings.npz
      model       digits that identify the model
      labels      (N,) int64
      vectors     (N, D) float16, of length 1
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cuboid.ground.arrays import Float32Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.results import TrackedObject
from cuboid.ground.formats.reading import MAX_BINARY_BYTES, read_bytes
from cuboid.method.text_search.model import TextQuery


class TextMatch(NamedTuple):
    """An object with its similarity to a text.

    Attributes
    ----------
    item : TrackedObject
    score : float
        Cosine of the angle between the vectors of the text and of the object, -1..1. It orders objects, but is no
        probability. CLIP gives about 0.2 to objects that do not match, and 0.3 to objects that match.
    """

    item: TrackedObject
    score: float


@dataclass(frozen=True, slots=True, eq=False)
class Embeddings:
    """Vectors of objects.

    Attributes
    ----------
    model : str
        Identity of the model, from `TextModel`.
    vectors : mapping of int to (D,) float32
        Unit vectors by label.
    """

    model: str
    vectors: Mapping[int, Float32Array]

    def content(self) -> bytes:
        """Return the content of the file `embeddings.npz`."""
        target, labels = io.BytesIO(), sorted(self.vectors)
        vectors = np.array([self.vectors[label] for label in labels], np.float16).reshape(len(labels), -1)
        np.savez(target, model=np.array(self.model), labels=np.array(labels, np.int64), vectors=vectors)
        return target.getvalue()

    @staticmethod
    def read(path: Path) -> Embeddings:
        """Read `embeddings.npz`.

        Raises
        ------
        InputError
            The file cannot be read, or is damaged.
        """
        content = read_bytes(path, MAX_BINARY_BYTES)
        try:
            with np.load(io.BytesIO(content), allow_pickle=False) as file:
                model, labels, vectors = str(file["model"]), file["labels"], file["vectors"].astype(np.float32)
            if labels.dtype.kind != "i" or labels.ndim != 1 or vectors.ndim != 2 or len(vectors) != len(labels):
                raise ValueError(f"labels {labels.shape} and vectors {vectors.shape}")
            if not np.isfinite(vectors).all():
                raise ValueError("a vector has non-finite numbers")
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            raise InputError(f"{path}: expected vectors of objects by an image-text model: {error}") from None
        return Embeddings(model, dict(zip(labels.tolist(), vectors, strict=True)))


def ranked(items: Iterable[TrackedObject], vectors: Mapping[int, Float32Array], query: TextQuery) -> list[TextMatch]:
    """Return the objects with a vector, the best match of a text first.

    Parameters
    ----------
    items : iterable of TrackedObject
    vectors : mapping of int to (D,) float32
        By label.
    query : TextQuery

    Raises
    ------
    InputError
        The vectors differ in length: the files for pictures and texts belong to different models.
    """
    found = []
    for item in items:
        vector = vectors.get(item.label)
        if vector is None:
            continue
        if vector.shape != query.vector.shape:
            raise InputError(
                f"the vectors of pictures have {len(vector)} numbers, that of the text {len(query.vector)}: "
                "the two files belong to different models"
            )
        found.append(TextMatch(item, float(vector @ query.vector)))
    return sorted(found, key=lambda one: (-one.score, one.item.label))
