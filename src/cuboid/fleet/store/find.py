"""Search for objects in a store by size, place, time, color, text, or similarity to another object."""

from __future__ import annotations

from typing import Any

from cuboid.fleet.store.query import SUPERSEDED, Tables
from cuboid.fleet.store.schema import OBJECTS, RUNS
from cuboid.ground.core.errors import InputError
from cuboid.method.text_search import TextQuery
from cuboid.services.queries.filters import LIKELY, Filters, is_surface, label_of
from cuboid.services.queries.likeness import COLOR_WORDS

SIDES, CENTER = ("longest_m", "middle_m", "shortest_m"), ("center_x_m", "center_y_m", "center_z_m")
# Columns that are never null; all columns that are shown.
NEVER_NULL = ("recording", "label", *SIDES, *CENTER, "frames_seen")
SHOWN = (*NEVER_NULL[:-1], "name", "color", "score", "frames_seen", "first_frame", "last_frame", "last_seen", "run")

NEWEST = f"run not in (select run from {SUPERSEDED})"

# Minimum fraction of an object's points that have a color for the object to match it; an object can match two colors.
COLORED = 0.3

# Dissimilarity: sizes that differ by a factor of e in every side, disjoint colors and disjoint shapes weigh the same.
_SIZE = " + ".join(f"abs(ln(greatest({side}, 1e-3) / greatest(?, 1e-3)))" for side in SIDES)
UNLIKE = f"({_SIZE}) / 3 + list_distance(colors, ?::FLOAT[]) / sqrt(2) + list_distance(shape, ?::FLOAT[]) / sqrt(2)"
# Cosine of the angle between an object's vector and another one, both of length 1. They are cast to arrays, because
# DuckDB refuses lists in a column with nulls.
FITTING = "array_inner_product(try_cast(embedding as FLOAT[{n}]), ?::FLOAT[{n}])"


def find(tables: Tables, filters: Filters, *, pictures: bool = False) -> list[dict[str, Any]]:
    """Return objects of the newest runs as rows; the nearest, most similar, best matching or last seen is first.

    Parameters
    ----------
    tables : Tables
    filters : Filters
    pictures : bool
        Whether each row includes the object's picture.

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
    where, values = _conditions(filters)
    extra, order = [], ["last_seen desc"]
    if filters.near is not None:
        extra, order = [f"{_distance(filters.near)} as distance_m"], ["distance_m"]
    front: list[Any] = []
    if filters.like is not None:
        one = _the_one(tables, *filters.like, "run", "label", *SIDES, "colors", "shape")
        front = [one[name] for name in (*SIDES, "colors", "shape")]
        extra, order = [*extra, f"{UNLIKE} as unlike"], ["unlike"]
        where.append("not (run = ? and label = ?)")
        values += [one["run"], one["label"]]
    if filters.text is not None:
        _refuse_other_model(tables, filters.text)
        front.append(filters.text.vector.tolist())
        extra, order = [*extra, f"{FITTING.format(n=len(filters.text.vector))} as text_score"], ["text_score desc"]
        where.append("embedding_model = ?")
        values.append(filters.text.model)
    chosen = ", ".join([*SHOWN, *extra, *(["picture"] if pictures else [])])
    question = (
        f"select {chosen} from {OBJECTS} where {' and '.join([*where, NEWEST])} "
        f"order by {', '.join([*order, 'recording', 'label'])} limit {filters.limit}"
    )
    found = tables.rows(question, front + values)
    for row in found:
        for column in NEVER_NULL:
            if row[column] is None:
                raise InputError(f"{tables.url}: the store is damaged: an object has no {column}")
    return found


def picture_of(tables: Tables, recording: str, label: int) -> bytes | None:
    """Return the picture of an object, JPEG; None without one. Raises InputError for no such object."""
    one = _the_one(tables, recording, label, "picture")
    picture: bytes | None = one["picture"]
    return picture


def _conditions(filters: Filters) -> tuple[list[str], list[Any]]:
    """Return conditions in SQL and the values of their placeholders."""
    where: list[str] = []
    values: list[Any] = []

    def add(condition: str, *of: Any) -> None:
        where.append(condition)
        values.extend(of)

    if filters.size_m is not None:
        add("longest_m between ? and ?", *filters.size_m)
    if filters.near is not None:
        for axis, value in zip("xyz", filters.near, strict=True):  # lets DuckDB skip row groups by minimum and maximum
            add(f"center_{axis}_m between ? and ?", value - filters.within_m, value + filters.within_m)
        add(f"{_distance(filters.near)} <= ?", filters.within_m)
    if filters.recording is not None:
        add("recording glob ?", filters.recording)
    if filters.since is not None:
        add("last_seen >= ?", filters.since)
    if filters.until is not None:
        add("last_seen < ?", filters.until)
    if filters.color is not None:
        add("colors[?] >= ?", COLOR_WORDS.index(filters.color) + 1, COLORED)
    if filters.name is not None:
        also = "exists (select 1 from unnest(names) as next(one) where lower(one.name) = lower(?) and one.score >= ?)"
        add(f"(lower(name) = lower(?) or {also})", filters.name, filters.name, LIKELY)
    if filters.min_score is not None:
        add("score >= ?", filters.min_score)
    for kind, to in filters.related():
        add(*_relation(kind, to))
    if filters.near_object is not None:
        add(*_near_object(filters.near_object, filters.within_m))
    return where, values


def _relation(kind: str, to: str) -> tuple[Any, ...]:
    """Return the condition that an object has a relation, and the values of its placeholders."""
    label = label_of(to)
    if label is not None or is_surface(to):
        end = "surface" if label is None else "label"
        condition = f"exists (select 1 from unnest(relations) as rel(one) where one.kind = ? and one.{end} = ?)"
        return condition, kind, to.strip() if label is None else label
    each = f"(select run, unnest(relations) as one, label from {OBJECTS})"
    others = f"{each} as a join {OBJECTS} as b on b.run = a.run and b.label = a.one.label"
    named = "a.one.kind = ? and lower(b.name) = lower(?)"
    return f"(run, label) in (select a.run, a.label from {others} where {named})", kind, to.strip()


def _near_object(to: str, within_m: float) -> tuple[Any, ...]:
    """Return the condition that an object is near another one of its recording, and its values."""
    label = label_of(to)
    which = "lower(b.name) = lower(?)" if label is None else "b.label = ?"
    away = " + ".join(f"(a.center_{axis}_m - b.center_{axis}_m)**2" for axis in "xyz")
    others = f"{OBJECTS} as a join {OBJECTS} as b on b.run = a.run and b.label <> a.label"
    condition = f"(run, label) in (select a.run, a.label from {others} where {which} and sqrt({away}) <= ?)"
    return condition, to.strip() if label is None else label, within_m


def _distance(near: tuple[float, float, float]) -> str:
    x, y, z = map(float, near)
    return f"sqrt((center_x_m - ({x!r}))**2 + (center_y_m - ({y!r}))**2 + (center_z_m - ({z!r}))**2)"


def _the_one(tables: Tables, recording: str, label: int, *columns: str) -> dict[str, Any]:
    """Return some columns of an object that is named by its recording and label."""
    selected = ", ".join(columns)
    found = tables.rows(
        f"select {selected} from {OBJECTS} where recording = ? and label = ? and {NEWEST}", [recording, label]
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
