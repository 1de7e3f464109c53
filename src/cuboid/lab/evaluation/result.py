"""Results to evaluate: the result folder of a run, or a plain CSV with the boxes of any other tracker."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.paths import PathLike, as_path
from cuboid.ground.formats.folder import EVENTS, MAP, PROPOSALS, TRACKS, TRAJECTORY
from cuboid.ground.formats.rows_files import BoxEntry, OwnBoxEntry, OwnRectEntry, RectEntry
from cuboid.ground.formats.table_validation import read_table
from cuboid.ground.geometry.overlap import pack
from cuboid.ground.geometry.se3 import rotation_from_quat_wxyz
from cuboid.lab.evaluation.boxer import is_boxer, read_boxer
from cuboid.lab.evaluation.probabilities import of_labels, read_probabilities
from cuboid.results.files import Results
from cuboid.results.files.rows import EventRow, read_events

IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class BoxRows:
    """Boxes of frames, in frame order.

    Attributes
    ----------
    frame, label : (N,) int64
    boxes : (N, 15) float64
        Boxes in the layout of `geometry.overlap.pack`.
    """

    frame: IntArray
    label: IntArray
    boxes: Float64Array


@dataclass(frozen=True, slots=True)
class RectRows:
    """Rectangles of frames, in frame order.

    Attributes
    ----------
    frame, label : (N,) int64
    rects_xyxy : (N, 4) float64
        Pixels of the recording's color image.
    """

    frame: IntArray
    label: IntArray
    rects_xyxy: Float64Array


@dataclass(frozen=True, slots=True)
class MapBoxes:
    """The map of objects at the end, by label.

    Attributes
    ----------
    label : (N,) int64
    boxes : (N, 15) float64
    score : (N,) float64
        Confidence; only the order matters.
    """

    label: IntArray
    boxes: Float64Array
    score: Float64Array


@dataclass(frozen=True, slots=True)
class Result:
    """The results of a tracker.

    Attributes
    ----------
    path : Path
    tracks : BoxRows
        A row for each object seen in a frame.
    objects : MapBoxes
    proposals : BoxRows or None
        Boxes of single frames, with label 0 if they have none; None if there is no such file.
    frames : (N,) int64 or None
        Frames that the tracker got and used; None if the result does not list them.
    skipped : int
        Number of frames that the tracker got but could not use.
    poses : str
        "given", "estimated", or "" if unknown.
    map_points, trajectory : Path or None
        Files beside the tracks.
    events : tuple of EventRow
        Events of objects; empty if there is no such file.
    T_truth_result : (4, 4) float64
        Transform that was applied to the boxes, to the world of the truth; the files are unchanged.
    probability : mapping of int to float
        Probability of each label at its last sighting; empty if the result gives none.
    """

    path: Path
    tracks: BoxRows
    objects: MapBoxes
    proposals: BoxRows | None = None
    frames: IntArray | None = None
    skipped: int = 0
    poses: str = ""
    map_points: Path | None = None
    trajectory: Path | None = None
    events: tuple[EventRow, ...] = ()
    T_truth_result: Float64Array = field(default_factory=lambda: np.eye(4))
    probability: Mapping[int, float] = field(default_factory=dict)

    def moved(self, T_truth_result: Float64Array) -> Result:
        """Return a copy with every box transformed to the truth's world by a rigid motion (4, 4)."""
        tracks, objects, proposals = self.tracks, self.objects, self.proposals
        return replace(
            self,
            tracks=replace(tracks, boxes=_moved(tracks.boxes, T_truth_result)),
            objects=replace(objects, boxes=_moved(objects.boxes, T_truth_result)),
            proposals=proposals and replace(proposals, boxes=_moved(proposals.boxes, T_truth_result)),
            events=tuple(event.moved(T_truth_result) for event in self.events),
            T_truth_result=T_truth_result @ self.T_truth_result,
        )


def read_result(path: PathLike) -> Result:
    """Read a result folder (``docs/results.md``), a CSV with at least the columns of `BoxEntry`, or Boxer's table.

    The map of a plain CSV contains each label's last box, with the number of the label's frames as score. Boxer's table
    has a map alone.

    Raises
    ------
    InputError
        A file is missing or malformed; the message names file and line.
    """
    path = as_path(path)
    if not path.is_dir() and is_boxer(path):
        found = read_boxer(path)
        labels, scores = np.array([one.label for one in found], np.int64), [one.probability for one in found]
        none = np.zeros(0, np.int64)
        seen = BoxRows(none, none, np.zeros((0, 15)))
        return Result(path, seen, MapBoxes(labels, pack([one.box for one in found]), np.array(scores, np.float64)))
    if not path.is_dir():
        tracks = read_boxes(path)
        return Result(path, tracks, _last_boxes(tracks))
    finished = Results(path)
    report = finished.report
    objects = finished.found.objects
    tracks = read_boxes(path / TRACKS)
    return Result(
        path=path,
        tracks=tracks,
        objects=MapBoxes(
            np.array([item.label for item in objects], np.int64),
            pack([item.box for item in objects]),
            np.array([item.score for item in objects], np.float64),
        ),
        proposals=read_boxes(path / PROPOSALS, OwnBoxEntry) if (path / PROPOSALS).exists() else None,
        frames=report.used(),
        skipped=len(report.skipped),
        poses=report.poses,
        map_points=path / MAP if (path / MAP).exists() else None,
        trajectory=path / TRAJECTORY if (path / TRAJECTORY).exists() else None,
        events=tuple(read_events(path / EVENTS)) if (path / EVENTS).exists() else (),
        probability=of_labels(tracks.label, read_probabilities(path, tracks.frame, tracks.label)),
    )


def read_boxes(path: Path, kind: type[BoxEntry] | type[OwnBoxEntry] = BoxEntry) -> BoxRows:
    """Read a CSV with at least the columns of a kind of row, in any order; other columns are ignored.

    Parameters
    ----------
    path : Path
    kind : type
        `BoxEntry`, with each label at most once per frame, or `OwnBoxEntry`.

    Raises
    ------
    InputError
        The file cannot be read, lacks a column, or a row is malformed; the message names file and line.
    """
    rows = [_numbers(row) for _, row in read_table(path, kind, any_order=True)]
    return BoxRows(*_columns(path, np.array(rows).reshape(-1, 2 + 15), unique=kind is BoxEntry))


def read_rects(path: Path, kind: type[RectEntry] | type[OwnRectEntry] = RectEntry) -> RectRows:
    """Read the rectangles of a CSV; with `RectEntry`, labels are unique per frame. Raises as `read_boxes`."""
    rows = [(row.frame, row.label, row.x0, row.y0, row.x1, row.y1) for _, row in read_table(path, kind, any_order=True)]
    return RectRows(*_columns(path, np.array(rows, np.float64).reshape(-1, 6), unique=kind is RectEntry))


def _numbers(row: BoxEntry | OwnBoxEntry) -> list[float]:
    turn = rotation_from_quat_wxyz((row.qw, row.qx, row.qy, row.qz))
    return [row.frame, row.label, row.cx, row.cy, row.cz, row.length, row.width, row.height, *turn.ravel()]


def _columns(path: Path, table: Float64Array, *, unique: bool) -> tuple[IntArray, IntArray, Float64Array]:
    """Return frame, label and rest of the rows of a table (N, C), in frame order; refuse a label twice in a frame."""
    table = table[np.argsort(table[:, 0], kind="stable")]
    sightings = table[:, :2].astype(np.int64)
    pairs, count = np.unique(sightings, axis=0, return_counts=True)
    if unique and (count > 1).any():
        frame, label = pairs[count > 1][0]
        raise InputError(f"{path}: label {label} stands more than once in frame {frame}")
    return sightings[:, 0], sightings[:, 1], table[:, 2:]


def _last_boxes(rows: BoxRows) -> MapBoxes:
    labels, from_end, count = np.unique(rows.label[::-1], return_index=True, return_counts=True)
    return MapBoxes(labels, rows.boxes[::-1][from_end], count.astype(np.float64))


def _moved(boxes: Float64Array, T: Float64Array) -> Float64Array:
    result = boxes.copy()
    result[:, :3] = boxes[:, :3] @ T[:3, :3].T + T[:3, 3]
    result[:, 6:] = (T[:3, :3] @ boxes[:, 6:].reshape(-1, 3, 3)).reshape(-1, 9)
    return result
