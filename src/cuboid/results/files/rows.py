"""The files with one line per sighting, proposal, event or pose: `tracks.csv`, `proposals.csv`, `events.csv`, ..."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.records import box_numbers, columns_of
from cuboid.ground.core.results import FrameResult, ObjectEvent, Proposal3D, Sighting, tag_of
from cuboid.ground.formats.rows_files import AgentEntry, EventEntry, PoseEntry, ProposalEntry, ProposalLabel, TrackEntry
from cuboid.ground.formats.table_validation import header_of, read_lines, read_table
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.se3 import compose, quat_wxyz_from_rotation, rotation_from_quat_wxyz
from cuboid.results.files.text import DIRECTION, LENGTH, number, numbers

R = TypeVar("R", "TrackRow", "ProposalRow")

RIG_TRACKS_HEADER = header_of(TrackEntry)
TRACKS_HEADER = RIG_TRACKS_HEADER.removesuffix(",camera")
PROPOSALS_HEADER = header_of(ProposalEntry)
EVENTS_HEADER = header_of(EventEntry)
AGENTS_HEADER = header_of(AgentEntry)
# The ten numbers of a box: centre and size, then the quaternion.
BOX_CELLS = ",".join([f"{{:z.{LENGTH}f}}"] * 6 + [f"{{:z.{DIRECTION}f}}"] * 4)


class _FrameRow:
    """A row of a frame: its line begins with the frame and its time."""

    __slots__ = ()
    frame: int
    timestamp_s: float

    def line(self) -> str:
        """Return the line without its end; the box follows the label, and a row of a rig ends with the camera."""
        cells = [cell for column in columns_of(type(self)) for cell in column.cells(self)]
        if isinstance(self, TrackRow | ProposalRow | AgentRow):
            cells.insert(1, BOX_CELLS.format(*box_numbers(self.box)))
        if isinstance(self, TrackRow) and self.camera:
            cells.append(self.camera)
        return ",".join((str(self.frame), number(self.timestamp_s, LENGTH), *cells))


@dataclass(frozen=True, slots=True, repr=False)
class TrackRow(Sighting, _FrameRow):
    """A sighting with its frame: a line of `tracks.csv`.

    The other attributes are those of `Sighting`; the rectangle is in pixels of the recording's color image.

    Attributes
    ----------
    frame : int
        Number of the frame in the recording.
    timestamp_s : float
        Seconds.
    camera : str
        Name of the frame's camera in the rig; empty if all frames are of one camera.
    """

    frame: int
    timestamp_s: float
    camera: str = field(default="", kw_only=True)

    def __repr__(self) -> str:
        return f"TrackRow(frame {self.frame}, {tag_of(self.label)}: {self.box.text()}; {self.visible:.0%} visible)"


@dataclass(frozen=True, slots=True, repr=False)
class ProposalRow(Proposal3D, _FrameRow):
    """A 3D proposal with its frame: a line of `proposals.csv`.

    The other attributes are those of `Proposal3D`; the rectangle is in pixels of the recording's color image.

    Attributes
    ----------
    frame : int
        Number of the frame in the recording.
    timestamp_s : float
        Seconds.
    """

    frame: int
    timestamp_s: float

    def __repr__(self) -> str:
        label = tag_of(self.label) if self.label else "no label"
        return f"ProposalRow(frame {self.frame}, {label}: {self.box.text()}; score {self.score:.2f})"


@dataclass(frozen=True, slots=True, repr=False)
class EventRow(ObjectEvent, _FrameRow):
    """An event with the frame that reported it: a line of `events.csv`.

    The other attributes are those of `ObjectEvent`.

    Attributes
    ----------
    frame : int
        Number of the frame in the recording.
    timestamp_s : float
        Seconds.
    """

    frame: int
    timestamp_s: float

    def __repr__(self) -> str:
        return f"EventRow(frame {self.frame}, {tag_of(self.label)} {self.event})"

    @classmethod
    def of(cls, event: ObjectEvent, result: FrameResult) -> EventRow:
        """Return the row of an event that a frame's result reports."""
        return cls(event.event, event.label, event.from_m, event.to_m, event.score, result.index, result.timestamp_s)

    @property
    def metres(self) -> float | None:
        """Distance of the object from its earlier place; None if it was, or is, not in the scene."""
        return None if self.from_m is None or self.to_m is None else float(np.linalg.norm(self.to_m - self.from_m))

    def to_dict(self) -> dict[str, Any]:
        """Return the event ready for JSON."""
        places = {"from": self.from_m, "to": self.to_m}
        return {
            "frame": self.frame,
            "timestamp": self.timestamp_s,
            "event": self.event,
            "label": self.label,
            **{name: None if place is None else place.tolist() for name, place in places.items()},
            "score": self.score,
        }


@dataclass(frozen=True, slots=True)
class AgentRow(_FrameRow):
    """The box of something that moves and is no object (a person, a hand): a line of `agents.csv`.

    Attributes
    ----------
    frame : int
        Number of the frame in the recording.
    timestamp_s : float
        Seconds.
    box : Box
        In the world, along the axes of the map.
    """

    frame: int
    timestamp_s: float
    box: Box

    def __repr__(self) -> str:
        return f"AgentRow(frame {self.frame}: {self.box.text()})"


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

    def __repr__(self) -> str:
        place = ", ".join(f"{value:z.3f}" for value in self.T_world_camera[:3, 3])
        return f"PoseRow({self.timestamp_s:.3f} s: camera at {place} m)"

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
    return [_row(TrackRow, row, camera=row.camera or "") for _, row in read_table(path, TrackEntry)]


def read_proposals(path: Path) -> list[ProposalRow]:
    """Read `proposals.csv`; parameters and errors are those of `read_tracks`."""
    return [_row(ProposalRow, row) for _, row in read_table(path, ProposalEntry)]


def read_events(path: Path) -> list[EventRow]:
    """Read `events.csv`; parameters and errors are those of `read_tracks`."""
    return [
        EventRow(frame=row.frame, timestamp_s=row.timestamp, **_values(EventRow, row))
        for _, row in read_table(path, EventEntry)
    ]


def read_agents(path: Path) -> list[AgentRow]:
    """Read `agents.csv`; parameters and errors are those of `read_tracks`."""
    return [AgentRow(row.frame, row.timestamp, _box_of(row)) for _, row in read_table(path, AgentEntry)]


def read_proposal_labels(path: Path) -> list[int]:
    """Read the labels alone of `proposals.csv`; parameters and errors are those of `read_tracks`."""
    return [row.label for _, row in read_table(path, ProposalLabel, any_order=True)]


def read_trajectory(path: Path) -> list[PoseRow]:
    """Read `trajectory.txt`; parameters and errors are those of `read_tracks`."""
    return [
        PoseRow(row.timestamp, compose((row.qw, row.qx, row.qy, row.qz), (row.tx, row.ty, row.tz)))
        for _, row in read_lines(path, PoseEntry)
    ]


def _box_of(line: TrackEntry | ProposalEntry | AgentEntry) -> Box:
    return Box(
        np.array((line.cx, line.cy, line.cz)),
        np.array((line.length, line.width, line.height)),
        rotation_from_quat_wxyz((line.qw, line.qx, line.qy, line.qz)),
    )


def _row(kind: type[R], line: TrackEntry | ProposalEntry, **more: Any) -> R:
    return kind(box=_box_of(line), frame=line.frame, timestamp_s=line.timestamp, **_values(kind, line), **more)


def _values(kind: type, line: Any) -> dict[str, Any]:
    """Return the described fields of a record from those of a line."""
    return {
        column.name: column.read(
            [getattr(line, name) for name in column.names] if column.parts else getattr(line, column.name)
        )
        for column in columns_of(kind)
    }
