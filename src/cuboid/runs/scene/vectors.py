"""Objects' vectors by an image-text model: one row per object, of the model that was used last."""

from __future__ import annotations

import sqlite3
import zlib
from collections.abc import Mapping
from typing import NamedTuple

import cv2
import numpy as np

from cuboid.ground.arrays import Float32Array
from cuboid.method.text_search import TextModel, mean_vector
from cuboid.method.text_search.pictures import squared
from cuboid.runs.scene.validation import columns_of, floats_of, read_rows

TABLE = "embeddings"


class SceneVector(NamedTuple):
    """An object's vector, and the check sum of its source picture, or None if it comes from a run's views."""

    vector: Float32Array
    picture: int | None


def read_vectors(connection: sqlite3.Connection, model: str) -> dict[int, SceneVector]:
    """Return the vectors by a model, by label.

    Raises
    ------
    DamagedError
        A row is invalid.
    """
    columns = columns_of(TABLE, ("label", "picture", "vector"))
    rows = read_rows(connection, columns, f"{TABLE} WHERE model = ?", (model,))
    return {label: SceneVector(floats_of(vector, "<f4", "a vector"), picture) for label, picture, vector in rows}


def write_vectors(connection: sqlite3.Connection, model: str, vectors: Mapping[int, SceneVector]) -> None:
    """Write vectors by a model, within the caller's transaction."""
    rows = [(label, model, vector.picture, vector.vector.astype("<f4").tobytes()) for label, vector in vectors.items()]
    connection.executemany(f"INSERT OR REPLACE INTO {TABLE} VALUES (?, ?, ?, ?)", rows)


def vector_of_picture(model: TextModel, jpeg: bytes) -> SceneVector | None:
    """Return the vector of an object's stored picture; None if the picture is damaged."""
    color = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR_RGB)
    if color is None:
        return None
    vector = mean_vector(model, [squared(np.asarray(color, np.uint8), model.preparation.background)])
    return None if vector is None else SceneVector(vector, zlib.crc32(jpeg))


def is_of(vector: SceneVector | None, jpeg: bytes | None) -> bool:
    """Return whether a vector is up to date: it comes from a run's views, or from this picture."""
    return vector is not None and (vector.picture is None or (jpeg is not None and vector.picture == zlib.crc32(jpeg)))
