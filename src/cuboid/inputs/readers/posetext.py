"""Camera poses as text: numbers, quaternions, and trajectories with times."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import FrameError, InputError, shown
from cuboid.ground.core.pose_stream import MAX_INTERPOLATED_S, PoseStream
from cuboid.ground.core.values import LATEST_S, refuse_no_quaternion
from cuboid.ground.formats.table_validation import data_lines
from cuboid.ground.geometry import se3

T = TypeVar("T")


def parse_numbers(text: str, count: int, expected: str) -> list[float]:
    """Return the `count` numbers of a line; `expected` describes them in messages.

    Raises
    ------
    ValueError
        If there are more or fewer, or one is no number (nan and inf are numbers).
    """
    words = text.split()
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != count:
        raise ValueError(f"expected {expected}, got {shown(' '.join(words))}")
    return values


def parsed_lines(
    path: Path, parse: Callable[[str], T], lines: Iterable[tuple[int, str]] | None = None
) -> Iterator[tuple[int, T]]:
    """Iterate over the numbers and the parsed contents of the lines of a file; default: all lines with data.

    Raises
    ------
    InputError
        `parse` raised ValueError.
    """
    for number, line in data_lines(path) if lines is None else lines:
        try:
            value = parse(line)
        except ValueError as error:
            raise InputError(f"{path} line {number}: {error}") from None
        yield number, value


def numbered_rows(path: Path, count: int | None, expected: str) -> list[tuple[int, list[float]]]:
    """Return line number and `count` numbers of each line of a file; any count if None.

    Raises
    ------
    InputError
        A line has another format; `expected` describes it in the message.
    """
    return list(parsed_lines(path, lambda line: parse_numbers(line, count or len(line.split()), expected)))


def pinhole_of(rows: Sequence[Sequence[float]], where: object) -> tuple[float, float, float, float]:
    """Return fx, fy, cx, cy of the rows of a camera matrix; raise InputError if it is none."""
    if not rows or len(rows) != len(rows[0]) or not np.isfinite(rows).all() or min(rows[0][0], rows[1][1]) <= 0:
        raise InputError(f"{where}: expected the matrix fx 0 cx, 0 fy cy, 0 0 1 with fx, fy > 0")
    return rows[0][0], rows[1][1], rows[0][2], rows[1][2]


def parse_time(word: str) -> float:
    """Return a time in seconds.

    Raises
    ------
    ValueError
        It is no number, or not a plausible time.
    """
    try:
        time_s = float(word)
    except ValueError:
        time_s = math.nan
    if not abs(time_s) <= LATEST_S:
        raise ValueError(f"expected seconds, got {shown(word)}")
    return time_s


def pose_from_quaternion(quat_wxyz: Sequence[float], translation: Sequence[float], where: str) -> Float64Array:
    """Return T_world_camera (4, 4) of a quaternion and a translation in metres.

    Raises
    ------
    FrameError
        If a number is NaN, infinite or too large, or the quaternion's length is not about 1.
    """
    try:
        se3.refuse_nowhere((*quat_wxyz, *translation))
        refuse_no_quaternion(*quat_wxyz)
    except ValueError as error:
        raise FrameError(f"{where}: {error}") from None
    return se3.compose(quat_wxyz, translation)


def pose_from_matrix(values: npt.ArrayLike, where: str) -> Float64Array:
    """Return T_world_camera (4, 4) of a matrix (4, 4) as read, with an exactly orthogonal rotation.

    Raises
    ------
    FrameError
        If a number is NaN or infinite, or the matrix is not rigid.
    """
    try:
        return se3.rigid(values)
    except ValueError as error:
        raise FrameError(f"{where}: {error}") from None


# A line of a file with a pose for each frame: its number in the file, and x, y, z, qx, qy, qz, qw.
PoseLine = tuple[int, list[float]]


def pose_of_frame(lines: Mapping[int, PoseLine], frame: int, name: str) -> Float64Array:
    """Return T_world_camera (4, 4) of a frame from the lines of a file; raise FrameError if it has none."""
    if frame not in lines:
        raise FrameError(f"{name} has no line for frame {frame} ({len(lines)} lines)")
    number, (x, y, z, qx, qy, qz, qw) = lines[frame]
    return pose_from_quaternion((qw, qx, qy, qz), (x, y, z), f"{name} line {number}")


# The time of a line in seconds, and its pose as qw, qx, qy, qz, tx, ty, tz.
TimedPose = tuple[float, tuple[float, ...]]


def tum_line(line: str) -> TimedPose:
    """Read ``timestamp tx ty tz qx qy qz qw``, T_world_camera; raise ValueError for other lines."""
    time_s, tx, ty, tz, qx, qy, qz, qw = parse_numbers(line, 8, "timestamp tx ty tz qx qy qz qw")
    return time_s, (qw, qx, qy, qz, tx, ty, tz)


class Trajectory(PoseStream):
    """Timed poses from a file with one line per pose.

    Lines with an invalid pose (NaN, no unit quaternion) are gaps; every line has a time.

    Parameters
    ----------
    path : Path
    read_line : callable
        Reads a line; default: the TUM format. It raises ValueError if the line has another format.
    largest_gap_s : float
        Maximum gap between two poses for interpolation.

    Raises
    ------
    InputError
        If a line has another form, or no line holds a pose.
    """

    def __init__(
        self, path: Path, read_line: Callable[[str], TimedPose] = tum_line, largest_gap_s: float = MAX_INTERPOLATED_S
    ) -> None:
        def read(line: str) -> TimedPose:
            parse_time(line.split()[0])
            return read_line(line)

        poses: list[tuple[float, Float64Array]] = []
        for _, (time_s, row) in parsed_lines(path, read):
            with suppress(FrameError):
                pose_from_quaternion(row[:4], row[4:], "")
                poses.append((time_s, np.array(row)))
        if not poses:
            raise InputError(f"{path} holds no pose; without the file the recording counts as one without poses")
        poses.sort(key=lambda pose: pose[0])
        super().__init__(path.name, np.array([pose[0] for pose in poses]), (), largest_gap_s)
        self._rows = [pose[1] for pose in poses]

    @property
    def times_s(self) -> Float64Array:
        """Times (N,) of the poses, increasing."""
        return self._times_s

    @property
    def T_world_camera(self) -> Float64Array:
        """The poses (N, 4, 4) at these times."""
        return np.array([self._pose(k) for k in range(len(self._rows))])

    def _pose(self, k: int) -> Float64Array:
        row = self._rows[k]
        return se3.compose(row[:4], row[4:])
