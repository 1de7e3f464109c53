"""The tables of a scene file and the values of each column: they define the file and the check of every row.

``docs/make_reference.py`` describes each of them, on a page of the documentation.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from types import NoneType
from typing import Annotated, Any, Literal, TypeAlias, get_args, get_origin

from msgspec import Meta, Struct

from cuboid.ground.core.records import table_columns_of
from cuboid.ground.core.results import TrackedObject
from cuboid.ground.core.values import (
    Amount,
    Cosine,
    Count,
    EventName,
    Fraction,
    FrameNumber,
    Label,
    Metres,
    Name,
    ObjectStatus,
    Pixel,
    QuaternionPart,
    RelationKind,
    Seconds,
    Side,
    SideName,
    Sides,
    VisitChange,
)
from cuboid.method.heatmap.kernels.cubes import BLOCK_ROWS, ROW

# "CUBD": the application ID in the header of the file.
APPLICATION_ID = 0x43554244
# Version of the tables and of the states in them.
SCENE_VERSION = 2

Whole: TypeAlias = Annotated[int, Meta(ge=-(2**62), le=2**62)]
Key: TypeAlias = Annotated[int, Meta(ge=-(2**63), le=2**63 - 1)]
Long: TypeAlias = Annotated[str, Meta(max_length=10_000)]
# Those of a rig have the number of the camera of each frame, three characters: four cameras of 30 Hz for six days.
SettingsText: TypeAlias = Annotated[str, Meta(max_length=200_000_000)]
Moment: TypeAlias = Annotated[str, Meta(pattern=r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00$")]
CheckSum: TypeAlias = Annotated[int, Meta(ge=0, lt=2**32)]
BlockRows: TypeAlias = Annotated[int, Meta(ge=0, le=BLOCK_ROWS)]
BlockData: TypeAlias = Annotated[bytes, Meta(max_length=BLOCK_ROWS * ROW.itemsize)]
Motion: TypeAlias = Annotated[bytes, Meta(min_length=128, max_length=128)]
# An overlap may be rounded to slightly more than 1.
Overlap: TypeAlias = Annotated[float, Meta(ge=0.0, le=1.0 + 1e-6)]
# What a relation is to: a label, a supporting plane by its persistent number, or a wall.
Target: TypeAlias = Annotated[str, Meta(pattern=r"^(\d{1,18}|plane#\d{1,18}|wall)\Z")]
KindWithoutDepth = Literal["box", "flat"]


# Classes from a detector with their probabilities, the most likely first: JSON in a column.
Classes: TypeAlias = list[tuple[Name, Fraction]]


class Accuracy(Struct, frozen=True):
    """How sure the box of an object is, as the fields of `TrackedObject` with these names: JSON in a column."""

    size_sigma_m: Sides
    center_sigma_m: tuple[Side, ...]
    sides_seen: tuple[SideName, ...]


@dataclass(frozen=True, slots=True)
class Table:
    """A table of a scene file.

    Attributes
    ----------
    columns : dict of str to type
        The values of each column, in order.
    key : str
        The primary key's columns, as in SQL; empty for none.
    rules : tuple of str
        Further constraints, in SQL.
    rows_by_key : bool
        Whether the file stores the rows in the order of the key.
    """

    columns: dict[str, Any]
    key: str = ""
    rules: tuple[str, ...] = ()
    rows_by_key: bool = False

    def sql(self, name: str) -> str:
        """Return the SQL statement that creates the table."""
        lines = [*(_column(*column) for column in self.columns.items()), *self.rules]
        lines += [f"PRIMARY KEY ({self.key})"] if self.key else []
        kind = "STRICT, WITHOUT ROWID" if self.rows_by_key else "STRICT"
        return f"CREATE TABLE {name} ({', '.join(lines)}) {kind};"


def _column(name: str, kind: Any) -> str:
    """Return the definition of a column in SQL."""
    types, allowed = {*_plain_types(kind)}, get_args(kind) if get_origin(kind) is Literal else ()
    sql = next(
        sql for plain, sql in ((int, "INTEGER"), (float, "REAL"), (str, "TEXT"), (bytes, "BLOB")) if plain in types
    )
    check = f" CHECK ({name} IN ({', '.join(map(repr, allowed))}))" if allowed else ""
    default = f" DEFAULT {WITH_DEFAULT[name]}" if name in WITH_DEFAULT else ""
    return f"{name} {sql}{'' if NoneType in types else ' NOT NULL'}{default}{check}"


def _plain_types(kind: Any) -> Iterator[Any]:
    """Iterate over the types of a column's values."""
    if isinstance(kind, type):
        yield kind
    elif get_origin(kind) is Literal:
        yield str
    elif get_origin(kind) is Annotated:
        yield from _plain_types(get_args(kind)[0])
    else:
        for part in get_args(kind):
            yield from _plain_types(part)


# Columns that a new row may lack, with their values in SQL.
WITH_DEFAULT = {"complete": "0", "next_frame": "0", "picture_share": "0", "classes": "'[]'"}
# Key of the row of `scene` with the probability that present objects have at least.
LEAST_SHOWN = "min_probability"
QUATERNION = ("qw", "qx", "qy", "qz")
BOX = ("cx", "cy", "cz", "length", "width", "height", *QUATERNION)
_BOX: dict[str, Any] = dict(zip(BOX, (*[Metres] * 3, *[Side] * 3, *[QuaternionPart] * 4), strict=True))
_MOVE: dict[str, Any] = dict.fromkeys(("from_x", "from_y", "from_z", "to_x", "to_y", "to_z"), Metres | None)
# Fields of an object that have columns unchanged: labels, names and planes are stored in other forms.
DESCRIBED = tuple(
    one
    for one in table_columns_of(TrackedObject)
    if not one.repeats and one.name not in ("label", "name", "plane", "merged_labels")
)
_OF_RECORDING = "FOREIGN KEY (recording) REFERENCES recordings (id) ON DELETE CASCADE"

TABLES = {
    "scene": Table({"key": Name, "value": Name}, "key", rows_by_key=True),
    "recordings": Table(
        {
            "id": Label,
            "path": Long,
            "format": Name,
            "poses": Name,
            "begun": Moment,
            "ended": Moment | None,
            "complete": Annotated[int, Meta(ge=0, le=1)],
            **dict.fromkeys(("first_frame", "frames", "next_frame"), FrameNumber),
            "camera": Long,
            "settings": SettingsText,
            "T_world_recording": Motion,
        },
        "id",
    ),
    "frames": Table(
        {
            "recording": Label,
            "frame": FrameNumber,
            "time_s": Seconds,
            **dict.fromkeys(("tx", "ty", "tz"), Metres),
            **dict.fromkeys(("qx", "qy", "qz", "qw"), QuaternionPart),
        },
        "recording, frame",
        (_OF_RECORDING,),
        rows_by_key=True,
    ),
    "planes": Table(
        {"identity": Whole, **dict.fromkeys(("nx", "ny", "nz"), Cosine), "offset": Metres, "outline": str}, "identity"
    ),
    "objects": Table(
        {
            "label": Label,
            "name": Name | None,
            "state": ObjectStatus,
            "merged_into": Label | None,
            "plane": Whole | None,
            **_BOX,
            **{name: one.kind | None if one.optional else one.kind for one in DESCRIBED for name in one.names},
            **dict.fromkeys(("red_spread", "green_spread", "blue_spread"), Amount),
            "picture": bytes | None,
            "picture_share": Amount,
            "kind": KindWithoutDepth | None,
            "classes": str,
            "accuracy": str | None,
        },
        "label",
        ("CHECK (label > 0)", "FOREIGN KEY (merged_into) REFERENCES objects (label)"),
    ),
    "boxes": Table({"id": Label, "label": Label, **_BOX}, "id"),
    "sightings": Table(
        {
            "recording": Label,
            "frame": FrameNumber,
            "label": Label,
            "box": Label,
            "iou": Overlap | None,
            "visible": Fraction,
            **dict.fromkeys(("x0", "y0", "x1", "y1"), Pixel),
        },
        "label, recording, frame",
        (
            "FOREIGN KEY (box) REFERENCES boxes (id)",
            "FOREIGN KEY (recording, frame) REFERENCES frames (recording, frame) ON DELETE CASCADE",
        ),
        rows_by_key=True,
    ),
    "blocks": Table(
        {
            "number": Annotated[int, Meta(ge=1, le=2**31 - 1)],
            "cube": Key,
            "visit": Annotated[int, Meta(ge=0, le=2**16 - 1)],
            **dict.fromkeys(("rows", "living"), BlockRows),
            "check_sum": CheckSum,
            "data": BlockData,
        },
        "number",
    ),
    "parts": Table({"key": Name, "check_sum": CheckSum, "fields": bytes}, "key", rows_by_key=True),
    "arrays": Table(
        {**dict.fromkeys(("part", "path", "form"), Name), "check_sum": CheckSum, "data": bytes}, "part, path"
    ),
    "pending": Table({"id": Label, "recording": Label, "file": Name, "text": str}, "id", (_OF_RECORDING,)),
    "known": Table(
        {"label": Label, **_BOX, "look": bytes, "points": bytes, "picture": bytes | None, "number": Count}, "label"
    ),
    "ground": Table(
        {
            **dict.fromkeys(("plane", "first_row", "first_column"), Whole),
            **dict.fromkeys(("rows", "columns"), Count),
            "seen": bytes,
        },
        "plane",
    ),
    "changes": Table(
        {
            "recording": Label,
            "label": Label,
            "change": VisitChange,
            **_MOVE,
            "metres": Side | None,
            "sure": Fraction,
            **dict.fromkeys(("before", "after"), bytes | None),
        },
        "recording, label",
        (_OF_RECORDING,),
    ),
    "events": Table(
        {
            "recording": Label,
            "frame": FrameNumber,
            "label": Label,
            "event": EventName,
            **_MOVE,
            "score": Fraction,
        },
        "recording, frame, label",
        ("FOREIGN KEY (recording, frame) REFERENCES frames (recording, frame) ON DELETE CASCADE",),
    ),
    "relations": Table(
        {
            "label": Label,
            "kind": RelationKind,
            "target": Target,
            **dict.fromkeys(("first_recording", "last_recording"), Label),
            "score": Fraction,
        },
        "label, kind, target, first_recording",
    ),
    "furniture": Table({"label": Label, "name": Name}, "label"),
    "occupied": Table({"check_sum": CheckSum, "cells": bytes}),
    "embeddings": Table({"label": Label, "model": Name, "picture": CheckSum | None, "vector": bytes}, "label"),
}
