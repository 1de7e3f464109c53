"""Open a place for queries by its path."""

from __future__ import annotations

from pathlib import Path

from cuboid.ground.formats.folder import OBJECTS, RUN
from cuboid.method.text_search import TextModel
from cuboid.services.queries.place import Place
from cuboid.services.queries.sources import ResultsSource, SceneSource

SCENE_SUFFIX = ".cuboid"


def is_place(path: str) -> bool:
    """Return whether a path is a scene file or a result folder, and not a store."""
    place = Path(path)
    return place.suffix == SCENE_SUFFIX or place.is_file() or any((place / name).is_file() for name in (RUN, OBJECTS))


def open_place(path: str, model: TextModel | None = None) -> Place:
    """Open a scene file or a result folder for queries.

    Parameters
    ----------
    path : str
    model : TextModel, optional
        The image-text model that ranks objects by a text.

    Raises
    ------
    InputError
        The path is neither of them, or the place is damaged.
    """
    place = Path(path)
    return Place(ResultsSource(place) if place.is_dir() else SceneSource(place), model)
