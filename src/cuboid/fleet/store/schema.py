"""The tables of a store: each column with its type, unit and meaning; a reference page is made from them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

import pyarrow as pa

from cuboid.ground.core.records import Column as RecordColumn
from cuboid.ground.core.records import columns_of
from cuboid.ground.core.results import Sighting, TrackedObject

# The table of runs marks a recording as done: its file is written last.
RUNS, RECORDINGS, OBJECTS, SIGHTINGS = "runs", "recordings", "objects", "sightings"

TIME = pa.timestamp("us", tz="UTC")
TEXT, COUNT, REAL, SMALL = pa.string(), pa.int32(), pa.float64(), pa.float32()

LATER = (
    "after its last frame: `there` (it was seen in the last frame of the run), `gone`, `not looked at`, or `not seen` "
    "(its place was in view: it is hidden, or not recognised)"
)

# The view of all rows of the table of objects; the view `objects` has those that were there at the end of their run.
ALL_OBJECTS = "all_objects"
# Outcomes of a recording.
DONE, FAILED, SET_ASIDE = "done", "failed", "set aside"


@dataclass(frozen=True, slots=True)
class Column:
    """A column: its name (which ends in the unit), its type, and its meaning."""

    name: str
    type: pa.DataType
    meaning: str


@dataclass(frozen=True, slots=True)
class TableKind:
    """A table: the meaning of a row, its columns, the columns by which rows are sorted in a file, and rows per group.

    A reader reads or skips a whole group, by the minimum and maximum of its columns.
    """

    name: str
    row: str
    columns: tuple[Column, ...]
    order: tuple[str, ...]
    group_rows: int = 1 << 16

    @property
    def schema(self) -> pa.Schema:
        """The Arrow schema; the metadata of a column is its meaning."""
        return pa.schema([pa.field(c.name, c.type, metadata={"what": c.meaning}) for c in self.columns])

    def table(self, rows: Sequence[Mapping[str, Any]]) -> pa.Table:
        """Return rows as a table; missing columns of a row are null."""
        return self.sorted(pa.Table.from_pylist(list(rows), schema=self.schema))

    def sorted(self, table: pa.Table) -> pa.Table:
        """Return the table in the order of its files."""
        return table.sort_by([(name, "ascending") for name in self.order])


def _several(names: str, type_: pa.DataType, meaning: str, unit: str = "") -> list[Column]:
    """Return columns that have their meaning together, which the first one tells."""
    return [Column(f"{name}{unit}", type_, text) for name, text in zip_longest(names.split(), (meaning,), fillvalue="")]


_WHOSE = (
    Column("run", TEXT, "the run, a row of `runs`"),
    Column("recording", TEXT, "name of the recording"),
)
_BOX = (
    *_several("center_x center_y center_z", REAL, "centre of its box in the world of the recording", "_m"),
    *_several("length width", SMALL, "length, width and height of its box along the axes of the box", "_m"),
    Column("height_m", SMALL, "along the normal of its support"),
    *_several("qw qx qy qz", SMALL, "rotation from the axes of the box to the world, a unit quaternion"),
)
BOX_COLUMNS = tuple(column.name for column in _BOX)
_SIDES_SIGMA = "standard deviations of `length_m`, `width_m` and `height_m`; null if unknown"
_CENTER_SIGMA = "standard deviations of the centre; null if unknown"
_SKIPPED = pa.list_(pa.struct([("frame", COUNT), ("reason", TEXT)]))
_CLASSES = pa.list_(pa.struct([("name", TEXT), ("score", SMALL)]))
_RELATIONS = pa.list_(pa.struct([("kind", TEXT), ("label", COUNT), ("surface", TEXT), ("score", SMALL)]))
_STAGES = pa.list_(pa.struct([("stage", TEXT), ("median_ms", REAL), ("p95_ms", REAL)]))


_TYPES = {float: SMALL, int: COUNT, str: TEXT, tuple: pa.list_(COUNT)}


def _described(record: type) -> Iterator[Column]:
    """Iterate over the columns of a record's fields, the label first, without the box."""
    for one in columns_of(record):
        if one.stored:
            for name, meaning in zip_longest(_stored_names(one), (one.meaning,), fillvalue=""):
                yield Column(name, _TYPES[one.type], meaning)


def _stored_names(column: RecordColumn) -> tuple[str, ...]:
    """Return the column names of a field; the parts of an array are pixel coordinates."""
    return tuple(f"{name}_px" for name in column.parts) or (column.name,)


def values_of(record: Any) -> dict[str, Any]:
    """Return the values of a record's fields by column."""
    stored = [one for one in columns_of(type(record)) if one.stored]
    return {name: value for one in stored for name, value in zip(_stored_names(one), one.values(record), strict=True)}


_LABEL, *_OBJECT = _described(TrackedObject)
_, *_SIGHTING = _described(Sighting)

TABLES = {
    kind.name: kind
    for kind in (
        TableKind(
            RUNS,
            "the run of a recording with its settings and a version",
            (
                Column("run", TEXT, "identity: 20 hexadecimal digits, from files, settings and version"),
                Column("recording", TEXT, "name of the recording"),
                Column("source", TEXT, "path or URL of the recording"),
                Column("state", TEXT, f"`{DONE}`; `{FAILED}`; `{SET_ASIDE}`: it has killed too many workers"),
                Column("reason", TEXT, "reason of a failure, one line; null for a run that is done"),
                Column("version", TEXT, "version of the program"),
                Column("settings", TEXT, "settings of the run, as JSON"),
                Column("finished", TIME, "time at which the run ended"),
                Column("results", TEXT, "folder of the result files in the store; null if there are none"),
                Column("poses", TEXT, "`given` or `estimated`"),
                Column("frames_read", COUNT, "frames that were read"),
                Column("frames_used", COUNT, "frames that were tracked"),
                Column("frames_lost", COUNT, "frames without an estimated pose: the camera was lost"),
                Column("skipped", _SKIPPED, "frames that were not used, with reasons"),
                Column("warnings", pa.list_(TEXT), "likely faults of the recording"),
                Column("proposals", COUNT, "3D proposals of single frames"),
                Column("proposals_labelled", COUNT, "3D proposals that belong to an object with a label"),
                Column("sightings", COUNT, "rows in `sightings`"),
                Column("labels", COUNT, "labels given during the run"),
                Column("objects", COUNT, "objects at the end: rows in `objects`"),
                Column("overlapping", COUNT, "objects that overlap another by a third or more of the smaller box"),
                Column("floating", COUNT, "objects that no plane supports and no other object touches from below"),
                Column("brief", COUNT, "objects seen in fewer than 5 frames"),
                Column("stages", _STAGES, "time of a whole frame and of each stage"),
                Column("seconds", REAL, "duration of the run on its worker"),
                Column("peak_memory_mb", REAL, "peak memory of the worker's process up to then, 2**20 bytes"),
            ),
            ("recording", "run"),
        ),
        TableKind(
            RECORDINGS,
            "the recording of a run",
            (
                *_WHOSE,
                Column("source", TEXT, "path or URL of the recording"),
                Column("format", TEXT, "name of its layout"),
                Column("recorded", TIME, "date of the first frame, if its times are dates; else of the newest file"),
                Column("seconds", REAL, "time from the first to the last frame"),
                Column("frames", COUNT, "number of frames, unusable ones included"),
                Column("bytes", pa.int64(), "size of its files"),
                *_several("width height", COUNT, "width and height of the color images", "_px"),
                *_several("fx fy", REAL, "focal length", "_px"),
                *_several("cx cy", REAL, "optical centre", "_px"),
                Column("has_poses", pa.bool_(), "whether the recording has camera poses"),
                *_several("up_x up_y up_z", REAL, "up in the world of the recording, a unit vector; null if unknown"),
            ),
            ("recording", "run"),
        ),
        TableKind(
            OBJECTS,
            "an object of the map at the end of a run; in the view `all_objects`, and in the files, also one that was "
            "gone by then",
            (
                *_WHOSE,
                _LABEL,
                *_BOX,
                *_several("longest middle shortest", SMALL, "longest side of its box", "_m"),
                *_OBJECT,
                Column("gone", pa.bool_(), "whether it was gone at the end"),
                Column("names", _CLASSES, "the next most likely classes, with their probabilities"),
                Column(
                    "relations",
                    _RELATIONS,
                    "relations to objects and surfaces (`plane:k`, and `floor` or `table` where it is one); `against` "
                    "walls only with `--relations`",
                ),
                Column("first_seen", TIME, "time of its first frame; null if the times of the recording are no dates"),
                Column("last_seen", TIME, "time of its last frame; null if the times of the recording are no dates"),
                *_several(
                    "camera_x camera_y camera_z", REAL, "position of the camera in its last frame, in the world", "_m"
                ),
                Column("camera_distance_m", SMALL, "distance of that camera from the centre of its box"),
                Column("later", TEXT, LATER),
                Column("later_frame", COUNT, "for `not seen` and `gone` the first such frame"),
                *_several("length width height", SMALL, _SIDES_SIGMA, "_sigma_m"),
                *_several("center_x center_y center_z", SMALL, _CENTER_SIGMA, "_sigma_m"),
                Column(
                    "sides_seen",
                    pa.list_(TEXT),
                    "sides of the box that a camera saw as faces; empty: none, null: unknown",
                ),
                *_several("red green blue", pa.uint8(), "mean color of its points, 0 to 255"),
                Column("color", TEXT, "color word of most of its points"),
                Column("colors", pa.list_(SMALL), "fraction of its points for each color word"),
                Column(
                    "shape",
                    pa.list_(SMALL),
                    "histogram of distances between its points, 16 bins up to the diagonal of the box",
                ),
                Column("picture_frame", COUNT, "frame of the picture"),
                Column("picture", pa.binary(), "best picture of the object, a small JPEG; null if there is none"),
                Column("last_picture", pa.binary(), "picture in its last frame; null if `picture` is it"),
                Column("embedding", pa.list_(SMALL), "vector of an image-text model for its pictures, of length 1"),
                Column("embedding_model", TEXT, "digits that identify the model; null if none was used"),
            ),
            ("longest_m", "run", "label"),
            group_rows=1 << 13,  # sorted by size: a query for a size reads few groups
        ),
        TableKind(
            SIGHTINGS,
            "an object that a frame shows",
            (
                *_WHOSE,
                Column("frame", COUNT, "number of the frame in the recording, from 0"),
                Column("timestamp_s", REAL, "time of the frame"),
                _LABEL,
                *_BOX,
                *_SIGHTING,
            ),
            ("run", "frame", "label"),
        ),
    )
}

# Columns of `runs` that depend on the clock or the machine; all others depend on recording, settings and version.
MEASURED = ("finished", "stages", "seconds", "peak_memory_mb")
