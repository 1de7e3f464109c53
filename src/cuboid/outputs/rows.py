"""The files with a line a sighting, a proposal, a pose: `tracks.csv`, `proposals.csv`, `trajectory.txt`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from cuboid.errors import InputError
from cuboid.frame import Float64Array
from cuboid.geometry.box import Box
from cuboid.geometry.se3 import compose, quat_wxyz_from_rotation, rotation_from_quat_wxyz
from cuboid.outputs.text import DIRECTION, LENGTH, PIXEL, number, numbers

TRACKS_HEADER = "frame,timestamp,label,cx,cy,cz,length,width,height,qw,qx,qy,qz,iou,visible,x0,y0,x1,y1"
PROPOSALS_HEADER = "frame,timestamp,label,cx,cy,cz,length,width,height,qw,qx,qy,qz,score,x0,y0,x1,y1"

Row = TypeVar("Row")


@dataclass(frozen=True, slots=True)
class TrackRow:
    """A line of `tracks.csv`: a confirmed object seen in a frame.

    Attributes
    ----------
    frame : int
    timestamp_s : float
    label : int
    box : Box
        In the world, as the map had it after that frame.
    iou : float or None
        None where the file leaves it empty.
    visible : float
        0..1.
    rect_xyxy : (4,) float64
        Pixels of the recording's color image.
    """

    frame: int
    timestamp_s: float
    label: int
    box: Box
    iou: float | None
    visible: float
    rect_xyxy: Float64Array

    def line(self) -> str:
        """Return the line without its end."""
        iou = "" if self.iou is None else number(self.iou, LENGTH)
        return (
            f"{_start(self.frame, self.timestamp_s, self.label, self.box)},{iou},"
            f"{number(self.visible, LENGTH)},{numbers(self.rect_xyxy, PIXEL)}"
        )


@dataclass(frozen=True, slots=True)
class ProposalRow:
    """A line of `proposals.csv`: a 3D proposal of a frame as that frame alone gave it.

    Attributes
    ----------
    frame : int
    timestamp_s : float
    label : int
        0 while what it belongs to is not confirmed.
    box : Box
        In the world.
    score : float
        0..1.
    rect_xyxy : (4,) float64
        Pixels of the recording's color image.
    """

    frame: int
    timestamp_s: float
    label: int
    box: Box
    score: float
    rect_xyxy: Float64Array

    def line(self) -> str:
        """Return the line without its end."""
        return (
            f"{_start(self.frame, self.timestamp_s, self.label, self.box)},"
            f"{number(self.score, LENGTH)},{numbers(self.rect_xyxy, PIXEL)}"
        )


@dataclass(frozen=True, slots=True)
class PoseRow:
    """A line of `trajectory.txt`, in the order that the TUM benchmark uses.

    Attributes
    ----------
    timestamp_s : float
    T_world_camera : (4, 4) float64
    """

    timestamp_s: float
    T_world_camera: Float64Array

    def line(self) -> str:
        """Return the line without its end."""
        w, x, y, z = quat_wxyz_from_rotation(self.T_world_camera[:3, :3])
        place = numbers(self.T_world_camera[:3, 3], LENGTH, " ")
        return f"{number(self.timestamp_s, LENGTH)} {place} {numbers((x, y, z, w), DIRECTION, ' ')}"


def read_tracks(path: Path) -> list[TrackRow]:
    """Read `tracks.csv`.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    list of TrackRow
        In the order of the file.

    Raises
    ------
    InputError
        The file is missing or a line of it is malformed; the message names file and line.
    """

    def parse(cells: list[str]) -> TrackRow:
        frame, timestamp_s, label, box = _parse_start(cells)
        iou = None if cells[13] == "" else _finite(cells[13])
        return TrackRow(frame, timestamp_s, label, box, iou, _finite(cells[14]), _vector(cells[15:19]))

    return list(_read(path, parse, ",", TRACKS_HEADER))


def read_proposals(path: Path) -> list[ProposalRow]:
    """Read `proposals.csv`; parameters and errors are those of `read_tracks`."""

    def parse(cells: list[str]) -> ProposalRow:
        frame, timestamp_s, label, box = _parse_start(cells)
        return ProposalRow(frame, timestamp_s, label, box, _finite(cells[13]), _vector(cells[14:18]))

    return list(_read(path, parse, ",", PROPOSALS_HEADER))


def read_trajectory(path: Path) -> list[PoseRow]:
    """Read `trajectory.txt`; parameters and errors are those of `read_tracks`."""

    def parse(cells: list[str]) -> PoseRow:
        values = _vector(cells)
        return PoseRow(float(values[0]), compose(values[[7, 4, 5, 6]], values[1:4]))

    return list(_read(path, parse, " ", None, columns=8))


def _start(frame: int, timestamp_s: float, label: int, box: Box) -> str:
    place = numbers((*box.center, *box.size), LENGTH)
    turn = numbers(quat_wxyz_from_rotation(box.rotation), DIRECTION)
    return f"{frame},{number(timestamp_s, LENGTH)},{label},{place},{turn}"


def _parse_start(cells: list[str]) -> tuple[int, float, int, Box]:
    values = _vector(cells[3:13])
    box = Box(values[:3], values[3:6], rotation_from_quat_wxyz(values[6:10]))
    return int(cells[0]), _finite(cells[1]), int(cells[2]), box


def _finite(cell: str) -> float:
    value = float(cell)
    if not math.isfinite(value):
        raise ValueError(f"{cell} is not a finite number")
    return value


def _vector(cells: list[str]) -> Float64Array:
    return np.array([_finite(cell) for cell in cells])


def _read(
    path: Path, parse: Callable[[list[str]], Row], separator: str, header: str | None, columns: int = 0
) -> Iterator[Row]:
    """Parse the lines of a file, with file and line in every complaint."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if header is not None:
        if not lines or lines[0] != header:
            raise InputError(f"{path}:1: expected the header '{header}'")
        columns = header.count(",") + 1
    for i, line in enumerate(lines):
        if not line or (header is not None and i == 0):
            continue
        cells = line.split(separator)
        if len(cells) != columns:
            raise InputError(f"{path}:{i + 1}: expected {columns} values, got {len(cells)}")
        try:
            yield parse(cells)
        except ValueError as error:
            raise InputError(f"{path}:{i + 1}: {error}") from error
