"""The questions about objects, written once for every source of objects: a scene, results, a run, a store.

A source makes conditions and selects the objects that meet all of them. A condition of a place is a mask over its
objects; one of a store is SQL.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from datetime import datetime
from typing import Any, Protocol, TypeVar

from cuboid.ground.core.errors import InputError, shown
from cuboid.ground.core.values import RelationKind
from cuboid.results.files.naming import listed_names, nameless
from cuboid.services.queries.english import Understood, understand
from cuboid.services.queries.filters import Filters, both, label_of

C = TypeVar("C")
F = TypeVar("F")


class ObjectSource(Protocol[C, F]):
    """Objects of one moment; the methods that return a condition raise InputError if the source cannot have it.

    Gone objects are among them. They meet conditions of size and time, in a scene also of name and color, and none of
    where they are: near a point, or in a relation.
    """

    def sized(self, low_m: float, high_m: float) -> C:
        """Return the condition that the longest side is within a range."""

    def probable(self, least: float) -> C:
        """Return the condition that the probability of an object is at least this."""

    def named(self, name: str) -> C:
        """Return the condition that this is the name or a likely class of an object; case is ignored."""

    def called(self, label_or_name: str) -> C:
        """Return the condition that an object has this label, had it before it was merged, or is named so."""

    def colored(self, word: str) -> C:
        """Return the condition that an object has a color, one of `COLOR_WORDS`."""

    def seen(self, since: datetime | None, until: datetime | None) -> C:
        """Return the condition that the last sighting is within a range of time, its end excluded."""

    def near(self, point: tuple[float, float, float], within_m: float) -> C:
        """Return the condition that an object is near a point of the world."""

    def near_object(self, label_or_name: str, within_m: float) -> C:
        """Return the condition that an object is near another one."""

    def related(self, kind: RelationKind, to: str) -> C:
        """Return the condition that an object has a relation to an object (label or name) or to a surface."""

    def placed(self, side: str, to: str) -> C:
        """Return the condition that an object is on a side, one of `SIDES`, of another one as a camera saw it."""

    def names(self) -> list[str]:
        """Return the names and likely classes that objects have."""

    def recorded(self, pattern: str) -> C:
        """Return the condition that the name of the recording matches a glob pattern."""

    def other_than(self, recording: str, label: int) -> C:
        """Return the condition that it is not this object, with which the others are compared."""

    def select(self, conditions: Sequence[C], by: Filters) -> list[F]:
        """Return the objects that meet all conditions, best first by the ranking filters, at most `by.limit`.

        Gone objects are last.
        """

    def latest(self, conditions: Sequence[C]) -> list[F]:
        """Return the objects that meet all conditions, the last seen first."""


def find(source: ObjectSource[C, F], filters: Filters) -> list[F]:
    """Return the objects that pass all filters; gone ones are last, and say so.

    Raises
    ------
    InputError
        A named object does not exist, or the source cannot answer one of the filters.
    """
    return source.select(list(_conditions(source, filters)), filters)


def no_such_name(source: ObjectSource[C, F], name: str | None) -> str | None:
    """Return why no object is found by a name: none has this name, or any; None if that is not the reason."""
    names = source.names()
    if name is None or name.strip().lower() in names:
        return None
    return f"no object has the name {shown(name)}; {listed_names(names)}" if names else nameless(name)


def last_seen(source: ObjectSource[C, F], label_or_name: str, also: Filters | None = None) -> list[F]:
    """Return the objects with a label or name, gone ones included, with their last sightings, the latest first.

    Parameters
    ----------
    source : ObjectSource
    label_or_name : str
    also : Filters, optional
        Further conditions; with a text or `like`, the best match is first.

    Raises
    ------
    InputError
        No object has, or had, the label or name.
    """
    called = source.called(label_or_name)
    found = source.latest([called])
    if found and also is not None:
        conditions = [called, *_conditions(source, also)]
        ranked = also.text is not None or also.like is not None
        return source.select(conditions, also) if ranked else source.latest(conditions)
    if found:
        return found
    if label_of(label_or_name) is not None:
        raise InputError(f"no object has the label {label_or_name.strip()}")
    raise InputError(no_such_name(source, label_or_name) or f"no object has the name {shown(label_or_name)}")


# Fields of filters that `counts_without` keeps: rankings, and conditions that have no field in a form.
NEVER_DROPPED = ("limit", "within_m", "text", "like", "side", "order")
SourceOf = Callable[[Filters], ObjectSource[C, F]]


def understood_with(source_of: SourceOf[C, F], question: str, also: Filters) -> Understood:
    """Return a question in English together with further conditions; an empty question has none.

    Parameters
    ----------
    source_of : callable
        Returns the source for the filters of a search.
    question : str
        In the grammar of `cuboid.services.queries.english`.
    also : Filters

    Raises
    ------
    InputError
        A part of the question is not understood, or it contradicts the further conditions.
    """
    if not question.strip():
        return Understood(also, None, ())
    asked = understand(question, source_of(Filters()).names(), also.limit)
    return replace(asked, filters=both(asked.filters, also))


def answer(source_of: SourceOf[C, F], asked: Understood, also: Filters) -> tuple[list[F], str | None]:
    """Return the objects that a question asks for, and why there are none if a name is not known.

    Parameters
    ----------
    source_of : callable
        Returns the source for the filters of a search.
    asked : Understood
        From `understood_with`.
    also : Filters
        The further conditions in it.

    Raises
    ------
    InputError
        As `find` and `last_seen`.
    """
    source = source_of(asked.filters)
    note = None if asked.last is None or label_of(asked.last) is not None else no_such_name(source, asked.last)
    if note is not None:
        return [], note
    found = find(source, asked.filters) if asked.last is None else last_seen(source, asked.last, also)
    return found[: also.limit], None if found else no_such_name(source, asked.filters.name)


def counts_without(source_of: SourceOf[C, F], filters: Filters) -> Mapping[str, int]:
    """Return how many objects pass the filters without one of them, by its field; fields without objects are omitted.

    At most `filters.limit` are counted.
    """
    counts = {}
    for one in fields(Filters):
        if one.name not in NEVER_DROPPED and getattr(filters, one.name) is not None:
            dropped: dict[str, Any] = {one.name: None}
            without = replace(filters, **dropped)
            counts[one.name] = len(find(source_of(without), without))
    return {name: count for name, count in counts.items() if count}


def _conditions(source: ObjectSource[C, F], filters: Filters) -> Iterator[C]:
    """Iterate over the conditions of those filters that are given."""
    if filters.recording is not None:
        yield source.recorded(filters.recording)
    if filters.like is not None:
        yield source.other_than(*filters.like)
    if filters.size_m is not None:
        yield source.sized(*filters.size_m)
    if filters.min_probability is not None:
        yield source.probable(filters.min_probability)
    if filters.name is not None:
        yield source.named(filters.name)
    if filters.color is not None:
        yield source.colored(filters.color)
    if filters.since is not None or filters.until is not None:
        yield source.seen(filters.since, filters.until)
    for kind, to in filters.related():
        yield source.related(kind, to)
    if filters.side is not None:
        yield source.placed(*filters.side)
    if filters.near is not None:
        yield source.near(filters.near, filters.within_m)
    if filters.near_object is not None:
        yield source.near_object(filters.near_object, filters.within_m)
