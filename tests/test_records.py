"""One description of a record: a field of it is in each file and table, and is read as it was written."""

from __future__ import annotations

import csv
from dataclasses import dataclass, field, fields

import numpy as np
import pytest

from cuboid.fleet.store.schema import OBJECTS, TABLES
from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.records import column, columns_of, names_in, plain_fields, table_columns_of
from cuboid.ground.core.results import Proposal3D, Sighting, TrackedObject
from cuboid.ground.core.values import Count, Fraction, Level
from cuboid.ground.formats.objects_file import ObjectEntry
from cuboid.ground.formats.rows_files import ProposalEntry, TrackEntry
from cuboid.results.exports import csv_table
from cuboid.results.files.object_table import COLUMNS
from cuboid.runs.scene import schema


@dataclass(frozen=True)
class Thing:
    """A record with a field of each kind."""

    count: Count = field(metadata=column("how many"))
    where: Count | None = field(metadata=column("index; null without one"))
    color: Float64Array = field(metadata=column("mean", kind=Level, digits=1, parts=("red", "green")))
    parts: tuple[int, ...] = field(default_factory=tuple, metadata=column("numbers"))
    score: Fraction | None = field(default=None, metadata=column("how sure", digits=3))


def test_a_record_is_written_as_its_fields_say() -> None:
    thing = Thing(3, None, np.array([1.25, 250.0]), (4, 5))
    assert plain_fields(thing) == {"count": 3, "where": None, "color": [1.2, 250.0], "parts": [4, 5]}
    assert plain_fields(Thing(0, 1, np.zeros(2), (), 0.12349))["score"] == 0.123
    columns = columns_of(Thing)
    assert names_in(columns) == ("count", "where", "red", "green", "parts", "score")
    assert [cell for one in columns for cell in one.cells(thing)] == ["3", "", "1.2", "250.0", "4 5", ""]
    assert [one.type for one in columns] == [int, int, float, tuple, float]
    assert [one.optional for one in columns] == [False, False, False, False, True]


def test_each_field_of_an_object_is_in_every_file_and_table() -> None:
    own = {one.name for one in columns_of(TrackedObject) if not one.repeats}
    assert own == {one.name for one in fields(TrackedObject)} - {"box"}
    declared = {one.name for one in columns_of(TrackedObject)} | {"center", "size", "rotation"}
    assert declared == {*ObjectEntry.__struct_fields__}
    described = table_columns_of(TrackedObject)
    assert {*names_in(described)} < {*COLUMNS}
    assert {*names_in(described)} < {*next(csv.reader([csv_table.HEADER]))}
    assert {one.name for one in described if one.stored} < {one.name for one in TABLES[OBJECTS].columns}
    own_columns = names_in(one for one in described if not one.repeats)
    assert {*own_columns} - {"merged_labels"} < {*schema.TABLES["objects"].columns}


@pytest.mark.parametrize(("record", "line"), [(Sighting, TrackEntry), (Proposal3D, ProposalEntry)])
def test_each_field_of_a_sighting_or_proposal_is_in_its_line(record: type, line: type) -> None:
    names = line.__struct_fields__  # type: ignore[attr-defined]
    assert names[:3] == ("frame", "timestamp", "label")
    of_rigs = ("camera",)
    assert tuple(name for name in names[13:] if name not in of_rigs) == names_in(columns_of(record))[1:]
