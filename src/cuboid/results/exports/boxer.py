"""The table of 3D boxes that Boxer and WildDet3D write: 15 columns, a row for each object of the map.

The columns are those of `ObbCsvWriter2` in `utils/file_io.py` of https://github.com/facebookresearch/boxer: time,
centre, quaternion (w first) from the axes of the box to the world, sizes along these axes, name, number of the object,
number of its class, and probability. A map has one time, 0, as the output of Boxer's tracker.
"""

from __future__ import annotations

from pathlib import Path

from cuboid.ground.core.results import TrackedObject
from cuboid.ground.formats.rows_files import BoxerEntry
from cuboid.ground.formats.table_validation import header_of
from cuboid.ground.geometry.se3 import quat_wxyz_from_rotation
from cuboid.results.files import Results
from cuboid.results.files.text import DIRECTION, LENGTH, number, numbers

# Name and number in Boxer's list of an object of no known class; names of other lists have no number there.
ANYTHING, ANYTHING_ID = "anything", 32


def write(run: Results, path: Path) -> list[str]:
    """Write the file."""
    lines = [header_of(BoxerEntry), *(_line(item) for item in run.found.objects)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")
    return []


def _line(item: TrackedObject) -> str:
    turn = numbers(quat_wxyz_from_rotation(item.box.rotation), DIRECTION)
    box = ",".join((numbers(item.box.center, LENGTH), turn, numbers(item.box.size, LENGTH)))
    name = (item.name or ANYTHING).replace(",", " ").replace('"', " ")  # Boxer's reader knows no quotes
    return f"0,{box},{name},{item.label},{ANYTHING_ID},{number(item.probability, LENGTH)}"
