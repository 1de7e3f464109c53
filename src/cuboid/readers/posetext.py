"""Camera poses as text: numbers, quaternions, and trajectories with times."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from cuboid.errors import FrameError, InputError
from cuboid.frame import Float64Array
from cuboid.geometry import se3

# A quaternion's length may differ from 1 by this: files with 4 digits differ by 1e-4. Beyond it the four
# numbers are probably no quaternion, or in another order with a translation among them.
QUATERNION_LENGTH_TOLERANCE = 0.01

# How far a matrix may be from a rotation; files with 3 digits stay below. What passes is made a rotation.
RIGID_TOLERANCE = 0.01

# Between two poses this far apart in time (seconds) the pose is interpolated: a hand-held camera's
# acceleration of 2 m/s^2 makes that wrong by a t^2 / 8 = 2.5 mm, the noise of depth at 1.3 m.
LARGEST_GAP_S = 0.1
# Elsewhere the nearest pose counts if it is this close (seconds): at 0.25 m/s, TUM fr1/xyz's mean, 5 mm.
NEAREST_WITHIN_S = 0.02


def read_lines(path: Path) -> list[str]:
    """Return the lines of a text file.

    Raises
    ------
    InputError
        If it cannot be read or is not text.
    """
    try:
        return path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path} is not a text file") from None


def data_lines(path: Path) -> Iterator[tuple[int, str]]:
    """Iterate over (line number from 1, line) of a text file, without empty lines and comments (#)."""
    for number, line in enumerate(read_lines(path), start=1):
        stripped = line.strip()
        if stripped and not stripped.startswith("#"):
            yield number, stripped


def parse_numbers(text: str, count: int, expected: str) -> list[float]:
    """Return the `count` numbers of a line; `expected` says in messages what they are.

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
        shown = " ".join(words)
        raise ValueError(f"expected {expected}, got '{shown if len(shown) <= 60 else shown[:57] + '...'}'")
    return values


def pose_from_quaternion(quat_wxyz: Sequence[float], translation: Sequence[float], where: str) -> Float64Array:
    """Return T_world_camera (4, 4) of a quaternion and a translation in metres.

    Raises
    ------
    FrameError
        If a number is NaN or infinite, or the quaternion's length is not about 1.
    """
    if not np.isfinite((*quat_wxyz, *translation)).all():
        raise FrameError(f"{where}: the pose has NaN or infinite numbers")
    length = float(np.linalg.norm(quat_wxyz))
    if abs(length - 1.0) > QUATERNION_LENGTH_TOLERANCE:
        raise FrameError(f"{where}: the pose's quaternion has length {length:.3g}, expected 1")
    return se3.compose(quat_wxyz, translation)


def pose_from_matrix(values: npt.ArrayLike, where: str) -> Float64Array:
    """Return T_world_camera (4, 4) of a matrix (4, 4) as read, its rotation freed of rounding.

    Raises
    ------
    FrameError
        If a number is NaN or infinite, or the matrix is not rigid.
    """
    T = np.asarray(values, np.float64)
    if not np.isfinite(T).all():
        raise FrameError(f"{where}: the pose has NaN or infinite numbers")
    if not se3.is_rigid(T, RIGID_TOLERANCE):
        raise FrameError(f"{where}: the pose is not rigid (a rotation, a translation and a last row 0 0 0 1)")
    return se3.compose(se3.quat_wxyz_from_rotation(T[:3, :3]), T[:3, 3])


class Trajectory:
    """Poses at times, from a file of lines ``timestamp tx ty tz qx qy qz qw`` (the TUM form).

    Lines whose pose is no pose (NaN, no unit quaternion) are gaps.

    Parameters
    ----------
    path : Path

    Raises
    ------
    InputError
        If a line has another form, or no line holds a pose.
    """

    def __init__(self, path: Path) -> None:
        self._name = path.name
        poses: list[tuple[float, Float64Array]] = []
        for number, line in data_lines(path):
            try:
                t, tx, ty, tz, qx, qy, qz, qw = parse_numbers(line, 8, "timestamp tx ty tz qx qy qz qw")
            except ValueError as error:
                raise InputError(f"{path} line {number}: {error}") from None
            length = np.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
            whole = np.isfinite((t, tx, ty, tz, length)).all()
            if whole and abs(length - 1.0) <= QUATERNION_LENGTH_TOLERANCE:
                poses.append((t, np.array((qw, qx, qy, qz, tx, ty, tz))))
        if not poses:
            raise InputError(f"{path} holds no pose; without the file the recording counts as one without poses")
        poses.sort(key=lambda pose: pose[0])
        self._times_s: npt.NDArray[np.float64] = np.array([pose[0] for pose in poses])
        self._rows = [pose[1] for pose in poses]

    @property
    def times_s(self) -> Float64Array:
        """Times (N,) of the poses, rising."""
        return self._times_s

    @property
    def T_world_camera(self) -> Float64Array:
        """The poses (N, 4, 4) at these times."""
        return np.array([self._pose(k) for k in range(len(self._rows))])

    def at(self, time_s: float) -> Float64Array:
        """Return T_world_camera (4, 4) at a time.

        Interpolated between neighbours at most `LARGEST_GAP_S` apart,
        else the nearest within `NEAREST_WITHIN_S`.

        Raises
        ------
        FrameError
            If no pose is near enough in time.
        """
        after = int(np.searchsorted(self._times_s, time_s))
        last = len(self._rows) - 1
        if 0 < after <= last and self._times_s[after] - self._times_s[after - 1] <= LARGEST_GAP_S:
            t0, t1 = self._times_s[after - 1], self._times_s[after]
            return se3.interpolate(self._pose(after - 1), self._pose(after), float((time_s - t0) / (t1 - t0)))
        near = min((max(after - 1, 0), min(after, last)), key=lambda k: abs(self._times_s[k] - time_s))
        away_s = abs(float(self._times_s[near]) - time_s)
        if away_s > NEAREST_WITHIN_S:
            raise FrameError(
                f"no camera pose at {time_s:.3f} s: the nearest in {self._name} is {away_s:.3f} s away "
                f"(at most {NEAREST_WITHIN_S:g} s, or between two at most {LARGEST_GAP_S:g} s apart)"
            )
        return self._pose(near)

    def _pose(self, k: int) -> Float64Array:
        row = self._rows[k]
        return se3.compose(row[:4], row[4:])
