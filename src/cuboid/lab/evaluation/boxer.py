"""The table of 3D boxes of Boxer and WildDet3D as a result, and as a truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cuboid.ground.core.errors import InputError
from cuboid.ground.formats.rows_files import BoxerEntry
from cuboid.ground.formats.table_validation import column_names, read_table
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.se3 import rotation_from_quat_wxyz

# The name that Boxer gives to an object of no known class.
ANYTHING = "anything"
# Columns of the table of 2D boxes that Boxer's detector writes beside the table of 3D boxes.
RECT_COLUMNS = {"x1", "y1", "x2", "y2"}


@dataclass(frozen=True, slots=True)
class BoxerObject:
    """An object of the table.

    Attributes
    ----------
    label : int
        Its instance; if the smallest instance is below 1, all are shifted so that it is 1.
    name : str
        Empty for an object of no known class.
    box : Box
        In the world; the one of its last time.
    probability : float
    """

    label: int
    name: str
    box: Box
    probability: float


def is_boxer(path: Path) -> bool:
    """Return whether a file is such a table: its first column is `time_ns`, and it has boxes in the world.

    Raises
    ------
    InputError
        It is Boxer's table of 2D boxes.
    """
    if path.suffix.lower() != ".csv":
        return False
    names = column_names(path)
    if names[0] == "time_ns" and set(names) >= RECT_COLUMNS:
        raise InputError(
            f"{path}: is Boxer's table of 2D boxes in images; expected the table of its 3D boxes, with the columns "
            "time_ns, tx_world_object, ..."
        )
    return names[0] == "time_ns" and "tx_world_object" in names


def read_boxer(path: Path) -> list[BoxerObject]:
    """Return the objects of a table, by label: of each instance the box of its last time.

    Raises
    ------
    InputError
        The file cannot be read or a row is malformed; or one time has two boxes of an instance, as in detections that
        were not fused or tracked.
    """
    last: dict[int, BoxerEntry] = {}
    known: set[tuple[int, int]] = set()
    for line, row in read_table(path, BoxerEntry, any_order=True):
        before = last.get(row.instance)
        if (row.instance, row.time_ns) in known:
            raise InputError(
                f"{path}:{line}: instance {row.instance} stands twice at time {row.time_ns}: these are detections of "
                "single frames; expected the objects that Boxer's --fuse or --track writes"
            )
        known.add((row.instance, row.time_ns))
        if before is None or before.time_ns < row.time_ns:
            last[row.instance] = row
    shift = 1 - min(last, default=1)
    return [_object(row, instance + max(shift, 0)) for instance, row in sorted(last.items())]


def _object(row: BoxerEntry, label: int) -> BoxerObject:
    center = np.array([row.tx_world_object, row.ty_world_object, row.tz_world_object])
    quat_wxyz = (row.qw_world_object, row.qx_world_object, row.qy_world_object, row.qz_world_object)
    size = np.array([row.scale_x, row.scale_y, row.scale_z])
    name = "" if row.name in (None, ANYTHING) else row.name
    return BoxerObject(label, name, Box(center, size, rotation_from_quat_wxyz(quat_wxyz)), row.prob)
