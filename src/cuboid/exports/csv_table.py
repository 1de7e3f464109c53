"""CSV: a row an object of the map; with two more columns where a detector saw classes."""

from __future__ import annotations

from pathlib import Path

from cuboid.core.results import TrackedObject
from cuboid.exports.registry import EXPORTS, Export
from cuboid.geometry.se3 import quat_wxyz_from_rotation
from cuboid.outputs import Results
from cuboid.outputs.text import DIRECTION, LENGTH, number, numbers

HEADER = (
    "label,length_cm,width_cm,height_cm,x_m,y_m,z_m,qw,qx,qy,qz,score,heat,"
    "first_frame,last_frame,frames_seen,points,red,green,blue,plane,merged_labels,name"
)
CLASS_HEADER = "name_score,names"
# Digits after the point of sizes in centimetres (a hundredth of a millimetre) and of mean colors.
CENTIMETRE = 3
COLOR = 1


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
    cells = (
        str(item.label),
        numbers(100.0 * item.box.size, CENTIMETRE),
        numbers(item.box.center, LENGTH),
        numbers(quat_wxyz_from_rotation(item.box.rotation), DIRECTION),
        number(item.score, LENGTH),
        number(item.heat, LENGTH),
        f"{item.first_frame},{item.last_frame},{item.frames_seen},{item.points}",
        numbers(item.mean_color, COLOR),
        "" if item.plane is None else str(item.plane),
        " ".join(map(str, item.merged_labels)),
        quoted(item.name or ""),
    )
    return ",".join(cells)


def _classes(item: TrackedObject) -> str:
    score = "" if item.name_score is None else number(item.name_score, LENGTH)
    next_names = "; ".join(f"{name} {number(value, LENGTH)}" for name, value in item.names)
    return f"{score},{quoted(next_names)}"


EXPORTS.register("csv")(Export(".csv", write))
