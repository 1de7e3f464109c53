"""Search for objects in a store by size, place, time, color, text, or similarity to another object."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from typing import Any, NamedTuple

import numpy as np

from cuboid.fleet.store.query import SUPERSEDED, Tables
from cuboid.fleet.store.schema import ALL_OBJECTS, OBJECTS, RUNS
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.values import RelationKind
from cuboid.method.text_search import TextQuery
from cuboid.services.queries import questions
from cuboid.services.queries.filters import LIKELY, LIMIT, Filters, is_kind, is_surface, label_of, not_present
from cuboid.services.queries.likeness import COLOR_WORDS, COLORED, colors_of
from cuboid.services.queries.rows import CENTER, sigma_names
from cuboid.services.queries.rows import SIDES as LWH

SIDES = ("longest_m", "middle_m", "shortest_m")
# Columns that are never null; all columns that are shown.
NEVER_NULL = ("recording", "label", *SIDES, *CENTER, "frames_seen")
SHOWN = (
    *(*NEVER_NULL[:-1], "name", "color", "colors", "score", "probability"),
    *LWH,
    *("frames_seen", "first_frame", "last_frame", "last_seen", "run"),
    *("camera_x_m", "camera_y_m", "camera_z_m", "camera_distance_m", "later", "later_frame"),
    *("state", *sigma_names(LWH), *sigma_names(CENTER), "sides_seen"),
)
# Columns that are not in the table.
AS = {"state": "if(gone, 'gone', 'present') as state"}

# Objects of recordings without dates are ordered by frame.
LATEST = "last_seen desc nulls last, last_frame desc"
NEWEST = f"run not in (select run from {SUPERSEDED})"

# Dissimilarity: sizes that differ by a factor of e in every side, disjoint colors and disjoint shapes weigh the same.
_SIZE = " + ".join(f"abs(ln(greatest({side}, 1e-3) / greatest(?, 1e-3)))" for side in SIDES)
# Lists are cast to arrays, because DuckDB refuses lists in a column with nulls.
_APART = "array_distance(try_cast({name} as FLOAT[{n}]), ?::FLOAT[{n}]) / sqrt(2)"
# Cosine of the angle between an object's vector and another one, both of length 1.
FITTING = "array_inner_product(try_cast(embedding as FLOAT[{n}]), ?::FLOAT[{n}])"


class Sql(NamedTuple):
    """A condition in SQL, and the values of its placeholders."""

    text: str
    values: Sequence[Any] = ()


class StoreObjects:
    """The objects of the newest runs in a store, as rows: an `ObjectSource`.

    Parameters
    ----------
    tables : Tables
    more : sequence of str
        Columns of each row in addition to `SHOWN`, as SQL.
    """

    def __init__(self, tables: Tables, more: Sequence[str] = ()) -> None:
        self._tables, self._more = tables, more

    def sized(self, low_m: float, high_m: float) -> Sql:
        """Return the objects whose longest side is within a range."""
        return Sql("longest_m between ? and ?", (low_m, high_m))

    def probable(self, least: float) -> Sql:
        """Return the objects with at least a probability."""
        return Sql("score >= ?", (least,))

    def named(self, name: str) -> Sql:
        """Return the objects with a name or a likely class."""
        of_class = "select 1 from unnest(names) as next(one) where lower(one.name) = lower(?) and one.score >= ?"
        return Sql(f"(lower(name) = lower(?) or exists ({of_class}))", (name, name, LIKELY))

    def called(self, label_or_name: str) -> Sql:
        """Return the objects with a label or a name."""
        label = label_of(label_or_name)
        return self.named(label_or_name.strip()) if label is None else Sql("label = ?", (label,))

    def colored(self, word: str) -> Sql:
        """Return the objects of whose points enough have a color."""
        return Sql("colors[?] >= ?", (COLOR_WORDS.index(word) + 1, COLORED))

    def seen(self, since: datetime | None, until: datetime | None) -> Sql:
        """Return the objects that were seen last within a range of time."""
        ends = {"last_seen >= ?": since, "last_seen < ?": until}
        given = {text: moment for text, moment in ends.items() if moment is not None}
        return Sql(" and ".join(given), tuple(given.values()))

    def near(self, point: tuple[float, float, float], within_m: float) -> Sql:
        """Return the objects whose boxes are near a point."""
        return Sql(f"not gone and {_distance(_coordinates(point))} <= ?", (within_m,))

    def near_object(self, label_or_name: str, within_m: float) -> Sql:
        """Return the objects whose boxes are near the centre of another one of their recording."""
        label = self._present(label_or_name)
        which = "lower(b.name) = lower(?)" if label is None else "b.label = ?"
        away = _distance([f"b.center_{axis}_m" for axis in "xyz"], "a.")
        others = f"{OBJECTS} as a join {OBJECTS} as b on b.run = a.run and b.label <> a.label"
        found = f"select a.run, a.label from {others} where {which} and {away} <= ?"
        return Sql(f"(run, label) in ({found})", (label_or_name.strip() if label is None else label, within_m))

    def related(self, kind: RelationKind, to: str) -> Sql:
        """Return the objects with a relation to an object of their recording or to a surface."""
        if not self._tables.rows(f"select 1 from {OBJECTS} where relations is not null limit 1"):
            raise InputError(f"{self._tables.url}: {kind}: no object has relations; 'cuboid batch' adds them now")
        surface = is_surface(to) or is_kind(to)
        label = None if surface else self._present(to)
        if label is not None or surface:
            end = "surface" if label is None else "label"
            one = f"select 1 from unnest(relations) as rel(one) where one.kind = ? and one.{end} = ?"
            to_it = Sql(f"exists ({one})", (kind, to.strip().lower() if label is None else label))
            return _either(to_it, self._related_by_name(kind, to)) if is_kind(to) else to_it
        return self._related_by_name(kind, to)

    def _present(self, label_or_name: str) -> int | None:
        """Return the label in a text, None for a name; raise InputError if no present object has the label or name."""
        label = label_of(label_or_name)
        which, value = ("lower(name) = lower(?)", label_or_name.strip()) if label is None else ("label = ?", label)
        found = self._tables.rows(f"select 1 from {OBJECTS} where {which} and {NEWEST} limit 1", [value])
        if not found and label is not None:  # furniture is no object, but objects are on it
            of_others = f"select unnest(relations) as one from {OBJECTS} where {NEWEST}"
            found = self._tables.rows(f"select 1 from ({of_others}) where one.label = ? limit 1", [label])
        if not found:
            raise not_present(label_or_name)
        return label

    def _related_by_name(self, kind: RelationKind, to: str) -> Sql:
        each = f"(select run, unnest(relations) as one, label from {OBJECTS})"
        others = f"{each} as a join {OBJECTS} as b on b.run = a.run and b.label = a.one.label"
        named = "a.one.kind = ? and lower(b.name) = lower(?)"
        return Sql(f"(run, label) in (select a.run, a.label from {others} where {named})", (kind, to.strip()))

    def names(self) -> list[str]:
        """Return the names and likely classes of the objects, in lower case."""
        if "names" not in self._tables.kept:
            self._tables.kept["names"] = self._read_names()
        found: list[str] = self._tables.kept["names"]
        return found

    def _read_names(self) -> list[str]:
        given = f"select lower(name) as one from {ALL_OBJECTS} where name is not null and {NEWEST}"
        likely = f"select unnest(names) as next from {ALL_OBJECTS} where {NEWEST}"
        classes = f"select lower(next.name) as one from ({likely}) where next.score >= ?"
        rows = self._tables.rows(f"select distinct one from ({given} union all {classes}) order by one", [LIKELY])
        return [row["one"] for row in rows]

    def placed(self, side: str, to: str) -> Sql:
        """Raise InputError: a store has no camera of its own for all recordings."""
        raise InputError(f"{side}: this question needs one place: results, a scene or a run")

    def recorded(self, pattern: str) -> Sql:
        """Return the objects of recordings whose name matches a glob pattern."""
        return Sql("recording glob ?", (pattern,))

    def other_than(self, recording: str, label: int) -> Sql:
        """Return all objects but one."""
        one = the_one(self._tables, recording, label, "run", "label")
        return Sql("not (run = ? and label = ?)", (one["run"], one["label"]))

    def select(self, conditions: Sequence[Sql], by: Filters) -> list[dict[str, Any]]:
        """Return rows: the best match of a text first, else the most similar, else the nearest, else the last seen.

        Gone objects are last.
        """
        kept, extra, order = [*conditions], dict[str, Sql](), LATEST
        if by.order is not None:
            raise InputError(f"{by.order}: this question needs one place: results, a scene or a run")
        if by.near is not None:
            extra["distance_m"], order = Sql(_distance(_coordinates(by.near))), "distance_m"
        if by.like is not None:
            features = (*SIDES, "colors", "shape")
            one = the_one(self._tables, *by.like, *features)
            if one["colors"] is None or one["shape"] is None:
                recording, label = by.like
                raise InputError(f"{recording}#{label}: a gone object has no shape and colors to compare with")
            kept.append(Sql("colors is not null and shape is not null"))
            apart = [_APART.format(name=name, n=len(one[name])) for name in ("colors", "shape")]
            unlike = " + ".join((f"({_SIZE}) / 3", *apart))
            extra["unlike"], order = Sql(unlike, [one[name] for name in features]), "unlike"
        if by.text is not None:
            _refuse_other_model(self._tables, by.text)
            extra["text_score"] = Sql(FITTING.format(n=len(by.text.vector)), [by.text.vector.tolist()])
            order = "text_score desc"
            kept.append(Sql("embedding_model = ?", (by.text.model,)))
        return self._rows(kept, f"gone, {order}", extra, by.limit)

    def latest(self, conditions: Sequence[Sql]) -> list[dict[str, Any]]:
        """Return rows, the last seen first."""
        return self._rows(conditions, LATEST)

    def _rows(
        self, conditions: Sequence[Sql], order: str, extra: Mapping[str, Sql] | None = None, limit: int | None = None
    ) -> list[dict[str, Any]]:
        """Return rows with the columns `SHOWN` and `extra`; raise InputError if the store is damaged."""
        extra = extra or {}
        named = [f"{one.text} as {name}" for name, one in extra.items()]
        chosen = ", ".join([*(AS.get(name, name) for name in SHOWN), *named, *self._more])
        where = " and ".join([*(one.text for one in conditions), NEWEST])
        most = "" if limit is None else f" limit {limit}"
        question = f"select {chosen} from {ALL_OBJECTS} where {where} order by {order}, recording, label{most}"
        values = [value for one in (*extra.values(), *conditions) for value in one.values]
        found = self._tables.rows(question, values)
        for row in found:
            for column in NEVER_NULL:
                if row[column] is None:
                    raise InputError(f"{self._tables.url}: the store is damaged: an object has no {column}")
            row["colors"] = list(colors_of(np.array(row["colors"] or (), np.float32)))
        return found


def find(tables: Tables, filters: Filters, more: Sequence[str] = ()) -> list[dict[str, Any]]:
    """Return objects of the newest runs as rows; the nearest, most similar, best matching or last seen is first.

    Parameters
    ----------
    tables : Tables
    filters : Filters
    more : sequence of str
        Columns of each row in addition to `SHOWN`, such as ``picture``.

    Returns
    -------
    list of dict
        The columns `SHOWN`; with `near` also ``distance_m``, with `like` also ``unlike`` (0: the same), with `text`
        also ``text_score`` (the cosine of the angle between the vectors).

    Raises
    ------
    InputError
        The reference object of `like` does not exist or is ambiguous; no object has a vector of the text's model; or
        the store is damaged.
    """
    return questions.find(StoreObjects(tables, more), filters)


def last_seen(tables: Tables, label_or_name: str, more: Sequence[str] = ()) -> list[dict[str, Any]]:
    """Return the objects of all recordings with a label or name, as rows of `find`; the last seen is first.

    Raises
    ------
    InputError
        No object has the label or name, or the store is damaged.
    """
    return questions.last_seen(StoreObjects(tables, more), label_or_name)


class StoreAnswer(NamedTuple):
    """The answer to a question in English: the conditions in words, rows of `find`, and why there are none."""

    understood: tuple[str, ...]
    rows: list[dict[str, Any]]
    note: str | None


def ask(
    tables: Tables, question: str, *, limit: int = LIMIT, more: Sequence[str] = (), also: Filters | None = None
) -> StoreAnswer:
    """Return the answer to a question in English, with further conditions; an empty question has none.

    Raises
    ------
    InputError
        A part of the question is not understood; or as `find` and `last_seen`.
    """
    source, also = StoreObjects(tables, more), replace(also or Filters(), limit=limit)
    asked = questions.understood_with(lambda _: source, question, also)
    return StoreAnswer(asked.said, *questions.answer(lambda _: source, asked, also))


def without(tables: Tables, question: str, also: Filters) -> tuple[Filters, Mapping[str, int] | None]:
    """Return all conditions of a question, and how many objects there are without each, by field of the filters.

    There are no such numbers, None, for a question of where one object is.
    """
    source = StoreObjects(tables)
    asked = questions.understood_with(lambda _: source, question, also)
    return asked.filters, questions.counts_without(lambda _: source, asked.filters) if asked.last is None else None


def picture_of(tables: Tables, recording: str, label: int, *, last: bool = False) -> bytes | None:
    """Return the best picture of an object, or that of its last sighting, JPEG; None without one.

    Raises
    ------
    InputError
        There is no such object.
    """
    one = the_one(tables, recording, label, "picture", "last_picture")
    picture: bytes | None = one["last_picture"] if last and one["last_picture"] is not None else one["picture"]
    return picture


def _either(one: Sql, other: Sql) -> Sql:
    return Sql(f"({one.text} or {other.text})", (*one.values, *other.values))


def _coordinates(point: tuple[float, float, float]) -> list[str]:
    return [f"({value!r})" for value in map(float, point)]


def _distance(point: Sequence[str], of: str = "") -> str:
    """Return the distance of the box of a row from a point as SQL, metres; 0 inside, as in a place.

    Parameters
    ----------
    point : sequence of str
        Its coordinates, as SQL.
    of : str
        Prefix of the columns of the box.
    """
    w, x, y, z = (f"{of}{name}" for name in ("qw", "qx", "qy", "qz"))
    dx, dy, dz = (f"({value} - {of}center_{axis}_m)" for value, axis in zip(point, "xyz", strict=True))
    # the columns of the rotation are the axes of the box: its product with the difference is that along each axis
    along = (
        f"(1 - 2 * ({y}*{y} + {z}*{z})) * {dx} + 2 * ({x}*{y} + {w}*{z}) * {dy} + 2 * ({x}*{z} - {w}*{y}) * {dz}",
        f"2 * ({x}*{y} - {w}*{z}) * {dx} + (1 - 2 * ({x}*{x} + {z}*{z})) * {dy} + 2 * ({y}*{z} + {w}*{x}) * {dz}",
        f"2 * ({x}*{z} + {w}*{y}) * {dx} + 2 * ({y}*{z} - {w}*{x}) * {dy} + (1 - 2 * ({x}*{x} + {y}*{y})) * {dz}",
    )
    beyond = (f"greatest(abs({a}) - {of}{side} / 2, 0)" for a, side in zip(along, LWH, strict=True))
    return f"sqrt({' + '.join(f'pow({one}, 2)' for one in beyond)})"


def the_one(tables: Tables, recording: str, label: int, *columns: str) -> dict[str, Any]:
    """Return some columns of an object that is named by its recording and label."""
    selected = ", ".join(columns)
    found = tables.rows(
        f"select {selected} from {ALL_OBJECTS} where recording = ? and label = ? and {NEWEST}", [recording, label]
    )
    if len(found) == 1:
        return found[0]
    if found:
        raise InputError(
            f"{recording}#{label}: {len(found)} recordings are called '{recording}'; "
            "`cuboid sql` tells them apart by source"
        )
    runs = tables.rows(f"select 1 from {RUNS} where recording = ? limit 1", [recording])
    what = f"recording '{recording}' has no object {label}" if runs else f"there is no recording '{recording}'"
    raise InputError(f"{recording}#{label}: {what} in {tables.url}")


def _refuse_other_model(tables: Tables, query: TextQuery) -> None:
    """Raise InputError if no object has a vector of the same length as the text's vector."""
    found = tables.rows(
        f"select len(embedding) as n from {OBJECTS} where embedding_model = ? and len(embedding) > 0 limit 1",
        [query.model],
    )
    if not found:
        raise InputError(f"{tables.url}: no object has a vector of this model; 'cuboid batch --text-model' makes them")
    if found[0]["n"] != len(query.vector):
        raise InputError(
            f"{tables.url}: vectors have {found[0]['n']} numbers, that of the text {len(query.vector)}: "
            "the two files belong to different models"
        )
