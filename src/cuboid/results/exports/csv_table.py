"""CSV: a row an object of the map; with two more columns where a detector saw classes."""

from __future__ import annotations

from pathlib import Path

from cuboid.ground.core.records import names_in, table_columns_of
from cuboid.ground.core.results import TrackedObject
from cuboid.ground.geometry.se3 import quat_wxyz_from_rotation
from cuboid.results.files import Results
from cuboid.results.files.text import CENTIMETRE, DIRECTION, LENGTH, number, numbers

_LABEL, *_OTHERS = table_columns_of(TrackedObject)
_BOX = ("length_cm", "width_cm", "height_cm", "x_m", "y_m", "z_m", "qw", "qx", "qy", "qz")
HEADER = ",".join(("label", *_BOX, *names_in(_OTHERS)))
CLASS_HEADER = "name_score,names"


def write(run: Results, path: Path) -> list[str]:
    """Write the file."""
    objects = run.found.objects
    lines = [HEADER, *(_line(item) for item in objects)]
    if any(item.name_score is not None or item.names for item in objects):
        more = [CLASS_HEADER, *(_classes(item) for item in objects)]
        lines = [f"{line},{rest}" for line, rest in zip(lines, more, strict=True)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")
    return []


def quoted(text: str) -> str:
    """Return a text as a cell: in quotes where it has what ends a cell."""
    doubled = text.replace('"', '""')
    return f'"{doubled}"' if any(mark in text for mark in ',"') else text


def _line(item: TrackedObject) -> str:
    box = (
        numbers(100.0 * item.box.size, CENTIMETRE),
        numbers(item.box.center, LENGTH),
        numbers(quat_wxyz_from_rotation(item.box.rotation), DIRECTION),
    )
    return ",".join((str(item.label), *box, *(quoted(cell) for one in _OTHERS for cell in one.cells(item))))


def _classes(item: TrackedObject) -> str:
    score = "" if item.name_score is None else number(item.name_score, LENGTH)
    next_names = "; ".join(f"{name} {number(value, LENGTH)}" for name, value in item.names)
    return f"{score},{quoted(next_names)}"
