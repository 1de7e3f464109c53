"""Conditions on objects, the same for a store, a result folder, a scene and a running tracker."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from datetime import datetime

from cuboid.ground.core.errors import InputError, shown
from cuboid.ground.core.values import RelationKind
from cuboid.method.relations.levels import FLOOR, TABLE
from cuboid.method.text_search import TextQuery
from cuboid.services.queries.likeness import COLOR_WORDS

# Minimum probability of a class, other than the name, by which an object is found.
LIKELY = 0.2
# Where an object is, as the camera of the last sighting of another one saw both.
SIDES = ("left of", "right of", "behind", "in front of")
# The order of answers to superlatives, of which the first object is the answer.
ORDERS = ("largest", "smallest", "tallest", "lowest", "nearest")
SURFACE = re.compile(r"(plane|wall):\d{1,9}")
# Maximum number of objects of an answer, unless another one is asked for.
LIMIT = 50
_LABEL = re.compile(r"#?(\d{1,9})")


@dataclass(frozen=True, slots=True, kw_only=True)
class Filters:
    """Conditions on objects; None matches everything.

    Attributes
    ----------
    size_m : (float, float) or None
        Minimum and maximum length of the longest side.
    near : (float, float, float) or None
        A point in the world, metres.
    near_object : str or None
        Label or name of another object.
    within_m : float
        Maximum distance from `near` or `near_object`.
    on, inside, beside : str or None
        Label or name of the object on, in or beside which it is; or "plane:k", "floor" or "table".
    side : (str, str) or None
        One of `SIDES`, and label or name of another object, which is seen from the camera of its last sighting.
    order : str or None
        One of `ORDERS`: only the first object in this order is found; the nearest is that to the other object.
    recording : str or None
        Glob pattern for names of recordings.
    since, until : datetime or None
        Range of the time of the last sighting.
    color : str or None
        One of `COLOR_WORDS`.
    name : str or None
        Its name, or one of the next most likely classes with a probability of at least `LIKELY`; case is ignored.
    min_probability : float or None
        Minimum probability that it is one whole object, 0..1.
    like : (str, int) or None
        Recording and label of an object; the most similar objects come first.
    text : TextQuery or None
        Objects are ranked by the similarity of their pictures to the text; objects without a vector of the model are
        omitted.
    limit : int
        Maximum number of objects.
    """

    size_m: tuple[float, float] | None = None
    near: tuple[float, float, float] | None = None
    near_object: str | None = None
    within_m: float = 0.5
    on: str | None = None
    inside: str | None = None
    beside: str | None = None
    side: tuple[str, str] | None = None
    order: str | None = None
    recording: str | None = None
    since: datetime | None = None
    until: datetime | None = None
    color: str | None = None
    name: str | None = None
    min_probability: float | None = None
    like: tuple[str, int] | None = None
    text: TextQuery | None = None
    limit: int = LIMIT

    def __post_init__(self) -> None:
        if self.color is not None and self.color not in COLOR_WORDS:
            raise InputError(f"unknown color '{self.color}'; known colors: {', '.join(COLOR_WORDS)}")
        if self.order not in (None, *ORDERS) or (self.side is not None and self.side[0] not in SIDES):
            raise InputError(f"expected one of {', '.join((*SIDES, *ORDERS))}")
        for what in (self.on, self.inside, self.beside, self.near_object, *(self.side or ())[1:]):
            if what is not None and not what.strip():
                raise InputError(
                    f"expected the label or the name of an object, or plane:N, floor or table, got {shown(what)}"
                )

    def related(self) -> Iterator[tuple[RelationKind, str]]:
        """Iterate over the requested relations: kind, and label or name of the other object or surface."""
        kinds: tuple[tuple[RelationKind, str | None], ...] = (
            ("on", self.on),
            ("in", self.inside),
            ("beside", self.beside),
        )
        for kind, to in kinds:
            if to is not None:
                yield kind, to


def both(first: Filters, second: Filters) -> Filters:
    """Return the conditions of both filters together, with the limit of the second.

    Raises
    ------
    InputError
        They name different things in one condition, such as two colors.
    """
    values = {one.name: getattr(second, one.name) for one in fields(Filters)}
    for name, value in values.items():
        other = getattr(first, name)
        if name == "limit" or other is None or other == value:
            continue
        if name == "within_m":
            values[name] = value if first.near_object is None else other
        elif value is None:
            values[name] = other
        elif name == "size_m":
            values[name] = max(other[0], value[0]), min(other[1], value[1])
        elif name in ("since", "min_probability"):
            values[name] = max(other, value)
        elif name == "until":
            values[name] = min(other, value)
        else:
            raise InputError(f"{name}: expected one condition, got '{other}' and '{value}'")
    return replace(second, **values)


def not_present(label_or_name: str) -> InputError:
    """Return the error of a question about the surroundings of an object that is not there."""
    return InputError(f"no present object has the label or the name {shown(label_or_name)}")


def label_of(text: str) -> int | None:
    """Return the label in a text such as 7 or #7; None for a name or a surface."""
    found = _LABEL.fullmatch(text.strip())
    return None if found is None else int(found[1])


def is_surface(text: str) -> bool:
    """Return whether a text names a surface, such as plane:0 or wall:1."""
    return SURFACE.fullmatch(text.strip()) is not None


def is_kind(text: str) -> bool:
    """Return whether a text names a kind of surface, floor or table."""
    return text.strip().lower() in (FLOOR, TABLE)
