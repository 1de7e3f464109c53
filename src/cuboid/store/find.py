"""Find objects in a store by what people know of them: how large, where, when, which color, like which one."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Any

from cuboid.core.errors import InputError
from cuboid.store.likeness import COLOR_WORDS
from cuboid.store.query import SUPERSEDED, Tables
from cuboid.store.schema import OBJECTS, RUNS
from cuboid.text_search import TextQuery

SIDES, CENTER = ("longest_m", "middle_m", "shortest_m"), ("center_x_m", "center_y_m", "center_z_m")
# Columns that every answer has; and all that are shown.
NEVER_NULL = ("recording", "label", *SIDES, *CENTER, "frames_seen")
SHOWN = (*NEVER_NULL[:-1], "name", "color", "score", "frames_seen", "first_frame", "last_frame", "last_seen", "run")

NEWEST = f"run not in (select run from {SUPERSEDED})"

# An object is of a color where this many of its points are: of two colors, both find it.
COLORED = 0.3

# An object is found by a class that is not its name where the class is likely by this.
LIKELY = 0.2

# Sizes that differ by e in every side, colors that have nothing in common, or shapes that have nothing in common, make
# two objects equally unlike.
_SIZE = " + ".join(f"abs(ln(greatest({side}, 1e-3) / greatest(?, 1e-3)))" for side in SIDES)
UNLIKE = f"({_SIZE}) / 3 + list_distance(colors, ?::FLOAT[]) / sqrt(2) + list_distance(shape, ?::FLOAT[]) / sqrt(2)"
# Cosine of the angle between an object's vector and another one, both of length 1; lists that lie beside nulls are
# refused by DuckDB, arrays are not.
FITTING = "array_inner_product(try_cast(embedding as FLOAT[{n}]), ?::FLOAT[{n}])"


@dataclass(frozen=True, slots=True, kw_only=True)
class Filters:
    """A query for objects; None matches everything.

    Attributes
    ----------
    size_m : (float, float) or None
        Least and greatest length of the longest side.
    near : (float, float, float) or None
        A place in the world, metres.
    within_m : float
        Greatest distance of the centre from `near`.
    recording : str or None
        Glob of names of recordings.
    since, until : datetime or None
        When it was last seen.
    color : str or None
        One of `COLOR_WORDS`.
    name : str or None
        Name of its class, or one of the next likely ones with a probability of `LIKELY` and more; in any case.
    min_score : float or None
    like : (str, int) or None
        Recording and label of an object: those most like it come first.
    text : TextQuery or None
        Objects are ranked by how well their pictures fit it; those without a vector of its model are left out.
    limit : int
        This many at most.
    """

    size_m: tuple[float, float] | None = None
    near: tuple[float, float, float] | None = None
    within_m: float = 0.5
    recording: str | None = None
    since: datetime | None = None
    until: datetime | None = None
    color: str | None = None
    name: str | None = None
    min_score: float | None = None
    like: tuple[str, int] | None = None
    text: TextQuery | None = None
    limit: int = 50

    def __post_init__(self) -> None:
        if self.color is not None and self.color not in COLOR_WORDS:
            raise InputError(f"no color is called '{self.color}'; there are {', '.join(COLOR_WORDS)}")


def find(tables: Tables, filters: Filters, *, pictures: bool = False) -> list[dict[str, Any]]:
    """Return objects of the newest runs as rows: the nearest, most alike or best fitting, or the last seen come first.

    Parameters
    ----------
    tables : Tables
    filters : Filters
    pictures : bool
        Whether each row has its picture.

    Returns
    -------
    list of dict
        The columns `SHOWN`; with `near` also ``distance_m``, with `like` also ``unlike`` (0: the same), with `text`
        also ``text_score`` (the cosine of the angle between the vectors).

    Raises
    ------
    InputError
        The object that others are to be like is not there, or there are several; no object has a vector of the
        text's model; or the store is damaged.
    """
    where, values = _conditions(filters)
    extra, order = [], ["last_seen desc"]
    if filters.near is not None:
        extra, order = [f"{_distance(filters.near)} as distance_m"], ["distance_m"]
    front: list[Any] = []
    if filters.like is not None:
        one = _the_one(tables, *filters.like)
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


def _conditions(filters: Filters) -> tuple[list[str], list[Any]]:
    """Return conditions in SQL and the values in them."""
    where: list[str] = []
    values: list[Any] = []

    def add(condition: str, *of: Any) -> None:
        where.append(condition)
        values.extend(of)

    if filters.size_m is not None:
        add("longest_m between ? and ?", *filters.size_m)
    if filters.near is not None:
        for axis, value in zip("xyz", filters.near, strict=True):  # skips groups of rows by their extremes
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
    return where, values


def _distance(near: tuple[float, float, float]) -> str:
    x, y, z = map(float, near)
    return f"sqrt((center_x_m - ({x!r}))**2 + (center_y_m - ({y!r}))**2 + (center_z_m - ({z!r}))**2)"


def _the_one(tables: Tables, recording: str, label: int) -> dict[str, Any]:
    """Return the object that others are to be like."""
    columns = ", ".join(("run", "label", *SIDES, "colors", "shape"))
    found = tables.rows(
        f"select {columns} from {OBJECTS} where recording = ? and label = ? and {NEWEST}", [recording, label]
    )
    if len(found) == 1:
        return found[0]
    if found:
        raise InputError(
            f"--like: {len(found)} recordings are called '{recording}'; `cuboid sql` tells them apart by source"
        )
    known = tables.rows(f"select 1 from {RUNS} where recording = ? limit 1", [recording])
    what = f"recording '{recording}' has no object {label}" if known else f"there is no recording '{recording}'"
    raise InputError(f"--like: {what} in {tables.url}")


def _refuse_other_model(tables: Tables, query: TextQuery) -> None:
    """Raise InputError where no object has a vector of the length that the text's model gives."""
    found = tables.rows(
        f"select len(embedding) as n from {OBJECTS} where embedding_model = ? and len(embedding) > 0 limit 1",
        [query.model],
    )
    if not found:
        raise InputError(f"{tables.url}: no object has a vector of this model; 'cuboid batch --text-model' makes them")
    if found[0]["n"] != len(query.vector):
        raise InputError(
            f"{tables.url}: vectors have {found[0]['n']} numbers, that of the text {len(query.vector)}: "
            "the model's two files are not of one model"
        )


def plain(row: dict[str, Any]) -> dict[str, Any]:
    """Return a row ready for JSON, without its picture."""
    kept = {name: value for name, value in row.items() if name != "picture"}
    return {
        name: value.isoformat()
        if isinstance(value, datetime)
        else round(value, 6)
        if isinstance(value, float)
        else value
        for name, value in kept.items()
    }
