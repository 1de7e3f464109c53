"""Pairing of color and depth images of two folders, by the numbers in their names, by time, or by order."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

from cuboid.ground.core.errors import InputError
from cuboid.inputs.readers.image_folder import NUMBER, images_in, pattern_of
from cuboid.inputs.readers.tum import ASSOCIATE_WITHIN_S, associate

LAST_NUMBER = re.compile(r"\D*(\d+(?:\.\d+)?)")
# Number of digits of a time since 1970 in milliseconds, microseconds and nanoseconds, and units per second.
EPOCH_UNITS = {13: Decimal(10**3), 16: Decimal(10**6), 19: Decimal(10**9)}


@dataclass(frozen=True, slots=True)
class Images:
    """The images of a folder.

    Attributes
    ----------
    folder : Path
    files : list of Path
        In natural order: 2.png before 10.png.
    numbers : list of Decimal or None
        Number of each file, all different; None if the names have no such number.
    """

    folder: Path
    files: list[Path]
    numbers: list[Decimal] | None

    def by_number(self) -> dict[Decimal, Path]:
        """Return the files by number; empty if they have none."""
        return dict(zip(self.numbers or (), self.files, strict=False))


@dataclass(frozen=True, slots=True)
class Pair:
    """The images of one frame; the number is the color image's, if there is one."""

    number: Decimal
    color: Path | None
    depth: Path | None


def find_images(folder: Path) -> Images:
    """Return the images of a folder; raise InputError if two have the same number."""
    files = sorted(images_in(folder), key=_natural)
    numbers = _numbers([file.stem for file in files])
    if numbers is not None and len(set(numbers)) < len(numbers):
        first, second = next((k, n) for n in range(len(numbers)) for k in range(n) if numbers[k] == numbers[n])
        raise InputError(f"{folder}: {files[first].name} and {files[second].name} have the same number")
    return Images(folder, files, numbers)


def pair_images(colors: Images, depths: Images) -> tuple[list[Pair], str | None]:
    """Pair color and depth images.

    Images are paired by number, if a number occurs in both folders; images without a partner are kept alone. Otherwise
    they are paired by time, if the numbers are times, or by order, if both folders have the same number of images.

    Returns
    -------
    list of Pair
        Sorted by number.
    str or None
        A warning for the user if they were paired by order.

    Raises
    ------
    InputError
        The images cannot be paired.
    """
    color, depth = colors.by_number(), depths.by_number()
    common, fewer = len(color.keys() & depth.keys()), min(len(colors.files), len(depths.files))
    timed = bool(color and depth) and _are_times(color) and _are_times(depth)
    if common and (not timed or 2 * common > fewer):
        return [Pair(n, color.get(n), depth.get(n)) for n in sorted(color.keys() | depth.keys())], None
    if timed:
        return _by_time(color, depth), None
    if len(colors.files) != len(depths.files):
        raise InputError(_no_partners(colors, depths))
    numbers = colors.numbers or [Decimal(k) for k in range(len(colors.files))]
    pairs = [Pair(*one) for one in zip(numbers, colors.files, depths.files, strict=True)]
    note = None
    if [file.stem for file in colors.files] != [file.stem for file in depths.files]:
        first = f"{_name(colors.files[0])} with {_name(depths.files[0])}"
        note = f"color and depth are paired by order, no number in their names agrees: {first}, ..."
    return sorted(pairs, key=lambda pair: pair.number), note


def seconds_of(number: Decimal) -> Decimal | None:
    """Return the time, seconds, from a number in a file name; None if the number is only a counter."""
    if "." in str(number):
        return number
    unit = EPOCH_UNITS.get(len(str(int(number))))
    return None if unit is None else number / unit


def _are_times(numbers: dict[Decimal, Path]) -> bool:
    return sum(seconds_of(number) is not None for number in numbers) * 2 > len(numbers)


def _seconds(numbers: Sequence[Decimal]) -> list[float]:
    return [float(number if (time_s := seconds_of(number)) is None else time_s) for number in numbers]


def _by_time(color: dict[Decimal, Path], depth: dict[Decimal, Path]) -> list[Pair]:
    """Pair each color image with the depth image nearest in time, one to one; other depth images are dropped."""
    colors, depths = sorted(color), sorted(depth)
    pairs = associate(_seconds(colors), _seconds(depths), ASSOCIATE_WITHIN_S)
    if not pairs:
        raise InputError(
            f"{color[colors[0]].parent}: no color image has a depth image within {1000 * ASSOCIATE_WITHIN_S:g} ms; "
            f"the first are {_name(color[colors[0]])} and {_name(depth[depths[0]])}"
        )
    return [Pair(n, color[n], depth[depths[pairs[k]]] if k in pairs else None) for k, n in enumerate(colors)]


def _no_partners(colors: Images, depths: Images) -> str:
    """Return a message about files without a partner."""
    return (
        f"{colors.folder.parent}: {colors.folder.name}/ ({len(colors.files)}: {_names(colors)}) and "
        f"{depths.folder.name}/ ({len(depths.files)}: {_names(depths)}) cannot be paired: no number in the names "
        "agrees, and the counts differ; give partners the same number"
    )


def _names(images: Images) -> str:
    names = [file.name for file in images.files]
    return f"{names[0]} to {names[-1]}" if len(names) > 1 else names[0]


def _name(file: Path) -> str:
    return f"{file.parent.name}/{file.name}"


def _natural(file: Path) -> list[tuple[str, Decimal]]:
    """Return the key by which 2.png comes before 10.png, and a_1.png before b_0.png."""
    words, numbers = NUMBER.split(file.stem), [Decimal(number) for number in NUMBER.findall(file.stem)]
    return list(zip(words, [*numbers, Decimal(0)], strict=True))


def _numbers(stems: Sequence[str]) -> list[Decimal] | None:
    """Return the number of each image: the first number position in the names whose values are all different."""
    if len({pattern_of(f"{stem}.png") for stem in stems}) != 1:
        matches = [LAST_NUMBER.fullmatch(stem) for stem in stems]
        return [Decimal(match[1]) for match in matches if match] if stems and all(matches) else None
    columns = list(zip(*([Decimal(number) for number in NUMBER.findall(stem)] for stem in stems), strict=True))
    if len(columns) == 1:
        return list(columns[0])
    varying = [list(column) for column in columns if len(set(column)) == len(column)]
    return (varying[-1] if len(stems) == 1 else varying[0]) if varying else None
