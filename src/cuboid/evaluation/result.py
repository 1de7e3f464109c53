"""What is judged: the result folder of a run, or a plain CSV with the boxes of any other tracker."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from cuboid.errors import InputError
from cuboid.frame import Float64Array
from cuboid.geometry.overlap import pack
from cuboid.geometry.se3 import rotation_from_quat_wxyz
from cuboid.outputs import read_objects, read_run
from cuboid.outputs.folder import MAP, OBJECTS, PROPOSALS, RUN, TRACKS, TRAJECTORY

IntArray = npt.NDArray[np.int64]

PLACE = ("cx", "cy", "cz", "length", "width", "height", "qw", "qx", "qy", "qz")
NEEDED = ("frame", "label", *PLACE)
RECT = ("x0", "y0", "x1", "y1")


@dataclass(frozen=True, slots=True)
class BoxRows:
    """Boxes of frames, in frame order.

    Attributes
    ----------
    frame, label : (N,) int64
    boxes : (N, 15) float64
        As `geometry.overlap.pack` lays them out.
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
        Confidence; only its order counts.
    """

    label: IntArray
    boxes: Float64Array
    score: Float64Array


@dataclass(frozen=True, slots=True)
class Result:
    """What a tracker left behind.

    Attributes
    ----------
    path : Path
    tracks : BoxRows
        A row for each object seen in a frame.
    objects : MapBoxes
    proposals : BoxRows or None
        Each frame's own boxes, label 0 where they have none; None where there is no such file.
    frames : (N,) int64 or None
        Frames that the tracker was given and used; None where the result does not say.
    skipped : int
        Frames that it was given and could not use.
    poses : str
        "given", "estimated", or "" where the result does not say.
    map_points, trajectory : Path or None
        Files beside the tracks.
    T_truth_result : (4, 4) float64
        The motion by which the boxes were carried to the world of the truth; the files are as they were.
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
    T_truth_result: Float64Array = field(default_factory=lambda: np.eye(4))

    def moved(self, T_truth_result: Float64Array) -> Result:
        """Return the same with every box carried to the truth's world by a rigid motion (4, 4)."""
        tracks, objects, proposals = self.tracks, self.objects, self.proposals
        return replace(
            self,
            tracks=replace(tracks, boxes=_moved(tracks.boxes, T_truth_result)),
            objects=replace(objects, boxes=_moved(objects.boxes, T_truth_result)),
            proposals=proposals and replace(proposals, boxes=_moved(proposals.boxes, T_truth_result)),
            T_truth_result=T_truth_result @ self.T_truth_result,
        )


def read_result(path: Path) -> Result:
    """Read a result folder (``docs/commands.md``), or a CSV with at least the columns of `NEEDED`.

    The map of a plain CSV is each label's last box, and the more frames a label has, the higher it is ranked.

    Raises
    ------
    InputError
        A file is missing or malformed; the message names file and line.
    """
    if not path.is_dir():
        tracks = read_boxes(path, unique=True)
        return Result(path, tracks, _last_boxes(tracks))
    report = read_run(path / RUN)
    every = int(report.config.get("every", 1))
    skipped = [frame for frame, _ in report.skipped]
    read = np.arange(0, report.frames_read * every, every)
    known = read_objects(path / OBJECTS).objects
    return Result(
        path=path,
        tracks=read_boxes(path / TRACKS, unique=True),
        objects=MapBoxes(
            np.array([item.label for item in known], np.int64),
            pack([item.box for item in known]),
            np.array([item.score for item in known], np.float64),
        ),
        proposals=read_boxes(path / PROPOSALS) if (path / PROPOSALS).exists() else None,
        frames=read[~np.isin(read, skipped)],
        skipped=len(skipped),
        poses=report.poses,
        map_points=path / MAP if (path / MAP).exists() else None,
        trajectory=path / TRAJECTORY if (path / TRAJECTORY).exists() else None,
    )


def read_boxes(path: Path, *, unique: bool = False) -> BoxRows:
    """Read a CSV whose header names at least the columns of `NEEDED`, in any order; others are left alone.

    Parameters
    ----------
    path : Path
    unique : bool
        Whether a label may stand only once in a frame, and must be above 0.

    Raises
    ------
    InputError
        The file cannot be read, lacks a column, or a row is malformed; the message names file and line.
    """
    table = _read_table(path, PLACE, _box)
    found = BoxRows(table[:, 0].astype(np.int64), table[:, 1].astype(np.int64), table[:, 2:].reshape(-1, 15))
    if unique:
        _refuse_twice(path, found)
    return found


def read_rects(path: Path, *, unique: bool = False) -> RectRows:
    """Read the rectangles of a CSV with at least frame, label and `RECT`; parameters and errors as `read_boxes`."""
    table = _read_table(path, RECT, _rect)
    found = RectRows(table[:, 0].astype(np.int64), table[:, 1].astype(np.int64), table[:, 2:].reshape(-1, 4))
    if unique:
        _refuse_twice(path, found)
    return found


def _read_table(path: Path, names: tuple[str, ...], parse: Callable[[list[float]], list[float]]) -> Float64Array:
    """Return frame, label and what `parse` makes of the named columns of a CSV, in frame order."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            lines = csv.reader(file)
            columns = _columns(path, next(lines, []), ("frame", "label", *names))
            rows = [_row(path, lines.line_num, cells, columns, parse) for cells in lines if cells]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from error
    table = np.array(rows, np.float64).reshape(len(rows), -1 if rows else 2)
    return table[np.argsort(table[:, 0], kind="stable")]


def _columns(path: Path, header: list[str], needed: tuple[str, ...]) -> list[int]:
    names = [name.strip() for name in header]
    missing = [name for name in needed if name not in names]
    if missing:
        raise InputError(f"{path}:1: expected a header with {','.join(needed)}; missing: {', '.join(missing)}")
    return [names.index(name) for name in needed]


def _row(
    path: Path, line: int, cells: list[str], columns: list[int], parse: Callable[[list[float]], list[float]]
) -> list[float]:
    try:
        frame, label, *rest = (float(cells[k]) for k in columns)
        if not (frame >= 0 and label >= 0 and frame == int(frame) and label == int(label)):
            raise ValueError(f"frame and label must be whole numbers of at least 0, got {frame:g}, {label:g}")
        return [frame, label, *parse(rest)]
    except IndexError:
        raise InputError(f"{path}:{line}: expected {max(columns) + 1} values, got {len(cells)}") from None
    except (ValueError, OverflowError) as error:
        raise InputError(f"{path}:{line}: {error}") from error


def _box(place: list[float]) -> list[float]:
    if not (np.isfinite(place).all() and min(place[3:6]) >= 0):
        raise ValueError(f"a box needs finite numbers and a size of at least 0, got {place}")
    return [*place[:6], *rotation_from_quat_wxyz(place[6:]).ravel()]


def _rect(rect: list[float]) -> list[float]:
    if not np.isfinite(rect).all():
        raise ValueError(f"a rectangle needs finite numbers, got {rect}")
    return rect


def _refuse_twice(path: Path, rows: BoxRows | RectRows) -> None:
    if len(rows.label) and rows.label.min() < 1:
        raise InputError(f"{path}: frame {rows.frame[rows.label.argmin()]}: a label must be at least 1")
    pairs, count = np.unique(np.stack([rows.frame, rows.label], axis=1), axis=0, return_counts=True)
    if (count > 1).any():
        frame, label = pairs[count > 1][0]
        raise InputError(f"{path}: label {label} stands more than once in frame {frame}")


def _last_boxes(rows: BoxRows) -> MapBoxes:
    labels, from_end, count = np.unique(rows.label[::-1], return_index=True, return_counts=True)
    return MapBoxes(labels, rows.boxes[::-1][from_end], count.astype(np.float64))


def _moved(boxes: Float64Array, T: Float64Array) -> Float64Array:
    result = boxes.copy()
    result[:, :3] = boxes[:, :3] @ T[:3, :3].T + T[:3, 3]
    result[:, 6:] = (T[:3, :3] @ boxes[:, 6:].reshape(-1, 3, 3)).reshape(-1, 9)
    return result
