"""The plain folder, for recordings of one's own; ``docs/recordings.md`` defines it.

Expected tree::

    my-recording/            <- the recording
      camera.json            {"fx":, "fy":, "cx":, "cy":, "width":, "height":, "depth_units_per_metre":}
      color/000000.png       8-bit color (.jpg as well)
      depth/000000.png       16-bit, aligned to color, 0 is no reading
      poses.txt              lines "number tx ty tz qx qy qz qw", camera to world; may be absent
      timestamps.txt         lines "number seconds"; may be absent

The number in a name puts color, depth, pose and time together; it may be the time itself (12.033.png).
"""

from __future__ import annotations

import re
from decimal import Decimal, InvalidOperation
from functools import partial
from pathlib import Path

from cuboid.errors import FrameError, InputError, shown
from cuboid.formats.reading import names_in
from cuboid.formats.table_validation import data_lines
from cuboid.frame import Float64Array
from cuboid.readers.posetext import parse_numbers, parse_time, pose_from_quaternion
from cuboid.readers.reader import READERS, FrameEntry, Listing, Reader

EXTENSIONS = (".png", ".jpg", ".jpeg")
NUMBERED = re.compile(r"\D*(\d+(?:\.\d+)?)")
POSE_FIELDS = "number tx ty tz qx qy qz qw"

# A line of poses.txt: its number in the file, and the seven numbers behind the frame's number.
PoseLine = tuple[int, list[float]]


def recognises(path: Path) -> bool:
    """Tell whether the folder holds the folders color and depth."""
    return (path / "color").is_dir() and (path / "depth").is_dir()


def read(path: Path) -> Listing:
    """List the frames; InputError where a name or a line has another form."""
    colors, depths = _images(path / "color"), _images(path / "depth")
    numbers = sorted(colors.keys() | depths.keys())
    if not numbers:
        raise InputError(f"{path}: color/ and depth/ hold no images ({', '.join(EXTENSIONS)})")
    poses = _poses(path / "poses.txt", numbers) if (path / "poses.txt").is_file() else None
    times_s = _times_s(path / "timestamps.txt", numbers)
    frames = [
        FrameEntry(
            color=colors.get(number),
            depth=depths.get(number),
            timestamp_s=times_s.get(number),
            pose=None if poses is None else partial(_pose, poses, number, len(numbers)),
        )
        for number in numbers
    ]
    return Listing(frames, camera_folders=(path,))


def _images(folder: Path) -> dict[Decimal, Path]:
    """Return the images of a folder by the number in their names."""
    images: dict[Decimal, Path] = {}
    for name in sorted(names_in(folder)):
        file = folder / name
        if file.suffix.lower() not in EXTENSIONS:
            continue
        match = NUMBERED.fullmatch(file.stem)
        if not match:
            raise InputError(f"{file}: the name must end with the frame's number, like 000012{file.suffix}")
        number = Decimal(match[1])
        if number in images:
            raise InputError(f"{folder}: {images[number].name} and {name} have the same number")
        images[number] = file
    return images


def _numbered_lines(path: Path, fields: str, numbers: list[Decimal]) -> dict[Decimal, PoseLine]:
    """Read lines that begin with a frame's number, the other fields being numbers."""
    rows: dict[Decimal, PoseLine] = {}
    for line_number, line in data_lines(path):
        try:
            values = parse_numbers(line, len(fields.split()), fields)
            number = Decimal(line.split()[0])
        except ValueError as error:
            raise InputError(f"{path} line {line_number}: {error}") from None
        except InvalidOperation:
            raise InputError(f"{path} line {line_number}: expected {fields}, got {shown(line)}") from None
        if number in rows:
            raise InputError(f"{path} line {line_number}: a second line for frame number {number}")
        rows[number] = (line_number, values[1:])
    if rows.keys().isdisjoint(numbers):
        begins = f"its lines begin with {next(iter(rows))}, ..." if rows else "it has no lines"
        raise InputError(
            f"{path}: no line begins with the number of a frame; {begins}, the frames' numbers are {numbers[0]}, ..."
        )
    return rows


def _poses(path: Path, numbers: list[Decimal]) -> dict[Decimal, PoseLine]:
    return _numbered_lines(path, POSE_FIELDS, numbers)


def _times_s(path: Path, numbers: list[Decimal]) -> dict[Decimal, float]:
    """Return the frames' times in seconds: of timestamps.txt, else numbers that have a decimal point."""
    if not path.is_file():
        decimals = any(number != number.to_integral_value() for number in numbers)
        return {number: _time_s(str(number), f"{path.parent}: frame number") for number in numbers} if decimals else {}
    rows = _numbered_lines(path, "number seconds", numbers)
    for number in numbers:
        if number not in rows:
            raise InputError(f"{path}: no line for frame number {number}")
    return {number: _time_s(str(rows[number][1][0]), f"{path} line {rows[number][0]}") for number in numbers}


def _time_s(word: str, where: str) -> float:
    try:
        return parse_time(word)
    except ValueError as error:
        raise InputError(f"{where}: {error}") from None


def _pose(poses: dict[Decimal, PoseLine], number: Decimal, frames: int) -> Float64Array:
    if number not in poses:
        raise FrameError(f"poses.txt has no line for frame number {number} ({len(poses)} lines, {frames} frames)")
    line_number, (tx, ty, tz, qx, qy, qz, qw) = poses[number]
    return pose_from_quaternion((qw, qx, qy, qz), (tx, ty, tz), f"poses.txt line {line_number}")


READERS.register("plain")(Reader("camera.json, color/, depth/", recognises, read, gives_way=True))
