"""The plain folder, for users' own recordings; ``docs/recordings.md`` defines it.

Expected tree::

    my-recording/            <- the recording
      camera.json            {"fx":, "fy":, "cx":, "cy":, "width":, "height":, "depth_units_per_metre":}
      color/000000.png       8-bit color (.jpg as well); or rgb/, images/, ...
      depth/000000.png       16-bit, aligned to color, 0 is no reading; or depths/, ...
      poses.txt              lines "number tx ty tz qx qy qz qw", camera to world; may be absent
      timestamps.txt         lines "number seconds"; may be absent

Color, depth, pose and time are matched by the number in the name, which may be the time itself (12.033.png). Images
whose numbers never agree are paired by time or by order, see `pairing`.
"""

from __future__ import annotations

from decimal import Decimal, InvalidOperation
from functools import partial
from pathlib import Path

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import FrameError, InputError, shown
from cuboid.ground.formats.reading import names_in
from cuboid.ground.formats.table_validation import data_lines
from cuboid.inputs.readers.calibration import CAMERA_FILE
from cuboid.inputs.readers.image_folder import IMAGE_ENDINGS, counted_endings
from cuboid.inputs.readers.pairing import Images, find_images, pair_images, seconds_of
from cuboid.inputs.readers.posetext import parse_numbers, parse_time, pose_from_quaternion
from cuboid.inputs.readers.reader import READERS, FrameEntry, Listing, Reader

COLOR_FOLDERS = ("color", "colour", "colors", "rgb", "rgbs", "image", "images", "img", "imgs")
DEPTH_FOLDERS = ("depth", "depths", "depth_image", "depth_images", "depth_map", "depth_maps")
POSE_FIELDS = "number tx ty tz qx qy qz qw"

# A line of poses.txt: its number in the file, and the seven numbers behind the frame's number.
PoseLine = tuple[int, list[float]]


def recognises(path: Path) -> bool:
    """Tell whether the folder holds one of `COLOR_FOLDERS` and one of `DEPTH_FOLDERS`."""
    return _folder(path, COLOR_FOLDERS) is not None and _folder(path, DEPTH_FOLDERS) is not None


def gives_way(path: Path) -> bool:
    """Tell whether a more specific reader takes precedence: unless the folder has color/ and camera.json."""
    return not ((path / CAMERA_FILE).is_file() and (path / COLOR_FOLDERS[0]).is_dir())


def read(path: Path) -> Listing:
    """List the frames; raise InputError if images cannot be paired, or a line has another format."""
    color, depth = _folder(path, COLOR_FOLDERS), _folder(path, DEPTH_FOLDERS)
    assert color is not None, "recognises"
    assert depth is not None, "recognises"
    colors, depths = find_images(color), find_images(depth)
    _require_images(path, colors, depths)
    pairs, note = pair_images(colors, depths)
    numbers = [pair.number for pair in pairs]
    notes = [] if note is None else [note]
    poses = _numbered_lines(path / "poses.txt", POSE_FIELDS, numbers, notes) if (path / "poses.txt").is_file() else None
    times_s = _times_s(path / "timestamps.txt", numbers, notes)
    frames = [
        FrameEntry(
            color=pair.color,
            depth=pair.depth,
            timestamp_s=times_s.get(pair.number),
            pose=None if poses is None else partial(_pose, poses, pair.number, len(numbers)),
        )
        for pair in pairs
    ]
    return Listing(frames, camera_folders=(path,), warnings=tuple(notes))


def _folder(path: Path, names: tuple[str, ...]) -> Path | None:
    """Return the first existing folder of these names, in lower case, capitalised or in upper case."""
    written = (path / form for name in names for form in (name, name.capitalize(), name.upper()))
    return next((folder for folder in written if folder.is_dir()), None)


def _require_images(path: Path, *folders: Images) -> None:
    """Raise InputError unless there are images in both folders."""
    empty = [images.folder for images in folders if not images.files]
    if not empty:
        return
    names = " and ".join(f"{folder.name}/" for folder in empty)
    seen = ", ".join(dict.fromkeys(text for folder in empty if (text := counted_endings(names_in(folder)))))
    raise InputError(
        f"{path}: {names} hold{'s' * (len(empty) == 1)} no images ({', '.join(IMAGE_ENDINGS)})"
        f"{f', but {seen}' if seen else ''}"
    )


def _numbered_lines(path: Path, fields: str, numbers: list[Decimal], notes: list[str]) -> dict[Decimal, PoseLine]:
    """Read lines that begin with a frame's number, the other fields being numbers.

    If all lines lack the number, and there are as many lines as frames, the lines are in the order of the frames; this
    is added to `notes`.
    """
    rows: dict[Decimal, PoseLine] = {}
    count = len(fields.split())
    lines = list(data_lines(path))
    if len(lines) == len(numbers) and all(len(line.split()) == count - 1 for _, line in lines):
        notes.append(f"{path.name}: its lines have no frame numbers, and are taken in the order of the frames")
        lines = [(line_number, f"{number} {line}") for number, (line_number, line) in zip(numbers, lines, strict=True)]
    for line_number, line in lines:
        try:
            values = parse_numbers(line, count, fields)
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


def _times_s(path: Path, numbers: list[Decimal], notes: list[str]) -> dict[Decimal, float]:
    """Return the frames' times in seconds, from timestamps.txt, else from numbers that are times."""
    if not path.is_file():
        if not any(map(seconds_of, numbers)):
            return {}
        return {n: _time_s(str(seconds_of(n) or n), f"{path.parent}: frame number") for n in numbers}
    rows = _numbered_lines(path, "number seconds", numbers, notes)
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


READERS.register("plain")(
    Reader("camera.json, color/ or rgb/ or images/, depth/ or depths/", recognises, read, gives_way=gives_way)
)
