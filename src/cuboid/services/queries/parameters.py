"""The parameters of pages and APIs: their meaning, and the conversion of a request into filters."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from cuboid.ground.core.errors import InputError
from cuboid.method.text_search import TextModel, TextQuery
from cuboid.services.queries.filters import LIMIT, Filters
from cuboid.services.queries.likeness import COLOR_WORDS
from cuboid.services.queries.words import count, length, moment, place, thing

# Only a server with an image-text model accepts this parameter.
TEXT = "text"
MAX_ROWS = 1000
MAX_SIZE_M = 1e9
# The parameters of the size, and fields of the filters whose names differ from those of their parameters.
SIZES, _FIELDS = ("min_size", "max_size"), {"in": "inside", "within": "within_m"}


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of a request.

    Attributes
    ----------
    schema : dict
        OpenAPI schema of its type.
    meaning : str
    field : str
        Name of its field in the search form.
    """

    schema: dict[str, Any]
    meaning: str
    field: str


# The names are the same as on the command line; the order is that of the form.
PARAMETERS: dict[str, Parameter] = {
    TEXT: Parameter(
        {"type": "string", "example": "something to drink from"},
        "objects ranked by how well their pictures fit a text; the server needs an image-text model",
        "text",
    ),
    "name": Parameter({"type": "string", "example": "cup"}, "name of the object, or a likely class of it", "name"),
    "color": Parameter({"type": "string", "enum": list(COLOR_WORDS)}, "color of 30 % of its points or more", "color"),
    "min_size": Parameter(
        {"type": "string", "example": "8cm"}, "minimum length of the longest side", "longest side from"
    ),
    "max_size": Parameter(
        {"type": "string", "example": "0.5m"}, "maximum length of the longest side", "longest side to"
    ),
    "recording": Parameter({"type": "string", "example": "kitchen*"}, "glob of names of recordings", "recording"),
    "like": Parameter(
        {"type": "string", "example": "kitchen-3#7"},
        "RECORDING#LABEL: the objects most similar to it first",
        "similar to",
    ),
    "on": Parameter(
        {"type": "string", "example": "tray"},
        "on an object, by label or name, or on floor, table or plane:N",
        "standing on",
    ),
    "in": Parameter({"type": "string", "example": "box"}, "in an object, by label or name", "in"),
    "beside": Parameter({"type": "string", "example": "7"}, "beside an object, by label or name", "beside"),
    "since": Parameter(
        {"type": "string", "example": "2026-03-01"},
        "last seen since a date, a time, or for 7d, 12h, 30min",
        "last seen since",
    ),
    "until": Parameter(
        {"type": "string", "example": "2026-04-01"}, "last seen before, written as since", "last seen before"
    ),
    "near": Parameter(
        {"type": "string", "example": "1.5,0,0.8"}, "X,Y,Z: a place in the recordings' world, metres", "near, m"
    ),
    "near_object": Parameter({"type": "string", "example": "7"}, "near an object, by label or name", "near object"),
    "within": Parameter({"type": "string", "default": "0.5m"}, "maximum distance from that", "within"),
    "min_probability": Parameter(
        {"type": "number", "example": 0.5},
        "minimum probability that it is one whole object, 0 to 1",
        "probability from",
    ),
    "limit": Parameter({"type": "integer", "default": 50, "maximum": MAX_ROWS}, "maximum number of rows", "rows"),
}

# The parameter of a question in English.
QUESTION = Parameter(
    {"type": "string", "example": "the blue bin beside the chair"},
    "names, colors, sizes, times, and on, in, beside or near something, in English",
    "question",
)


def given(asked: Mapping[str, str]) -> dict[str, str]:
    """Return the parameters of a request that have a value; a form also sends its empty fields.

    Raises
    ------
    InputError
        A parameter is unknown.
    """
    unknown = sorted(set(asked) - set(PARAMETERS))
    if unknown:
        raise InputError(f"unknown parameter '{unknown[0]}'; known parameters: {', '.join(PARAMETERS)}")
    return {name: value.strip() for name, value in asked.items() if value.strip()}


def filters_of(asked: Mapping[str, str], model: TextModel | None = None) -> Filters:
    """Return the parameters of a request, from `given`, as filters; `model` as in `text_query`.

    Raises
    ------
    InputError
        A value is invalid, or there is a text and no model.
    """

    def read(name: str) -> Any:
        try:
            return _READERS.get(name, str)(asked[name])
        except ValueError as error:
            raise InputError(f"{name}: {error}") from None

    low_m, high_m = (
        read(name) if name in asked else limit for name, limit in zip(SIZES, (0.0, MAX_SIZE_M), strict=True)
    )
    if low_m > high_m:
        raise InputError(f"min_size {asked['min_size']} is larger than max_size {asked['max_size']}")
    values = {
        _FIELDS.get(name, name): read(name) for name in asked if name in PARAMETERS and name not in (*SIZES, TEXT)
    }
    values["limit"] = min(MAX_ROWS, values.get("limit", LIMIT))
    size_m = None if asked.keys().isdisjoint(SIZES) else (low_m, high_m)
    return Filters(**values, size_m=size_m, text=text_query(asked.get(TEXT), model))


def asked_of(filters: Filters) -> dict[str, str]:
    """Return filters as the parameters of a request, the inverse of `filters_of`; without text and limit."""
    low_m, high_m = filters.size_m or (0.0, MAX_SIZE_M)
    near = filters.near is not None or filters.near_object is not None
    texts = ("name", "color", "recording", "on", "in", "beside", "near_object")
    values = {
        **{name: getattr(filters, _FIELDS.get(name, name)) for name in texts},
        "min_size": f"{100 * low_m:g}cm" if low_m > 0.0 else None,
        "max_size": f"{100 * high_m:g}cm" if high_m < MAX_SIZE_M else None,
        "like": None if filters.like is None else "{}#{}".format(*filters.like),
        "since": None if filters.since is None else f"{filters.since:%Y-%m-%dT%H:%M:%S}",
        "until": None if filters.until is None else f"{filters.until:%Y-%m-%dT%H:%M:%S}",
        "near": None if filters.near is None else ",".join(f"{value:g}" for value in filters.near),
        "within": f"{filters.within_m:g}m" if near else None,
        "min_probability": None if filters.min_probability is None else f"{filters.min_probability:g}",
    }
    return {name: value for name, value in values.items() if value is not None}


def text_query(text: str | None, model: TextModel | None) -> TextQuery | None:
    """Return a text with its vector; None without a text.

    Parameters
    ----------
    text : str or None
    model : TextModel or None
        The image-text model of the server.

    Raises
    ------
    InputError
        There is a text and no model, or the model cannot be run.
    """
    if text is None:
        return None
    if model is None:
        raise InputError(
            "text: this server has no image-text model; 'cuboid serve' and 'cuboid mcp' take one by --text-model DIR"
        )
    return model.query(text)


def _probability(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 <= value <= 1.0:
        raise ValueError(f"expected a number from 0 to 1, got '{text}'")
    return value


# Readers of the parameters that are no texts.
_READERS: dict[str, Callable[[str], Any]] = {
    **dict.fromkeys((*SIZES, "within"), length),
    **dict.fromkeys(("since", "until"), moment),
    "near": place,
    "min_probability": _probability,
    "like": thing,
    "limit": count,
}
