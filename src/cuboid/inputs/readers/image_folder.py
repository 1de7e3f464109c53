"""The images of a folder whose names follow one pattern; stray files are left out."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

from cuboid.ground.core.errors import InputError
from cuboid.ground.formats.reading import names_in
from cuboid.inputs.readers.reader import FrameEntry

IMAGE_ENDINGS = (".png", ".jpg", ".jpeg")
NUMBER = re.compile(r"\d+(?:\.\d+)?")
# Number of left-out images that a message names.
IMAGES_NAMED = 4
# Number of kinds of files that a message names.
KINDS_NAMED = 4


def is_image(name: str) -> bool:
    """Tell whether a file name has the suffix of an image."""
    return os.path.splitext(name)[1].lower() in IMAGE_ENDINGS


def pattern_of(name: str) -> str:
    """Return the name of an image without suffix, with each number replaced by "#"."""
    return NUMBER.sub("#", os.path.splitext(name)[0])


def fitting(names: Sequence[str]) -> list[str]:
    """Return the names with the most frequent pattern, in order.

    The pattern must contain a number, and cover more than half of the names (or half, if no other pattern has a
    number). Without such a pattern all names are returned, except those of hidden files.
    """
    shown = [name for name in names if not name.startswith(".")]
    patterns = Counter(map(pattern_of, shown))
    numbered = [(count, pattern) for pattern, count in patterns.items() if "#" in pattern]
    if numbered:
        count, pattern = max(numbered)
        if 2 * count > len(shown) or (2 * count == len(shown) and len(numbered) == 1):
            return [name for name in shown if pattern_of(name) == pattern]
    return shown


def images_in(folder: Path) -> list[Path]:
    """Return the images in a folder whose names have the same pattern, sorted by name.

    Raises
    ------
    InputError
        The folder cannot be listed.
    """
    return [folder / name for name in fitting(sorted(name for name in names_in(folder) if is_image(name)))]


def images_by_number(folder: Path) -> dict[int, Path]:
    """Return the images in a folder whose names are numbers; raises as `images_in` does."""
    return {int(file.stem): file for file in images_in(folder) if file.stem.isdigit()}


def counted_endings(names: Iterable[str]) -> str:
    """Return counts of file suffixes, the most frequent first: "400 .jpg, 1 .txt"; without hidden files."""
    endings = Counter(os.path.splitext(name)[1].lower() for name in names if not name.startswith("."))
    return ", ".join(f"{count} {ending}" for ending, count in endings.most_common(KINDS_NAMED) if ending)


def left_out(frames: Iterable[FrameEntry]) -> list[Path]:
    """Return the images in the frames' folders whose names have another pattern than the frames' images."""
    patterns: dict[Path, set[str]] = {}
    for entry in frames:
        for image in (entry.color, entry.depth):
            if isinstance(image, Path) and is_image(image.name):
                patterns.setdefault(image.parent, set()).add(pattern_of(image.name))
    return [
        folder / name
        for folder, used in patterns.items()
        for name in _names_if_there(folder)
        if is_image(name) and pattern_of(name) not in used
    ]


def _names_if_there(folder: Path) -> list[str]:
    """Return the names in a folder, sorted; none if the folder, named by a list of images, is missing."""
    try:
        return sorted(names_in(folder))
    except (InputError, ValueError):
        return []


def left_out_warning(recording: Path, files: Sequence[Path]) -> str | None:
    """Return a one-line warning that counts and names the left-out images; None if there are none."""
    if not files:
        return None
    names = ", ".join(
        str(file.relative_to(recording) if file.is_relative_to(recording) else file) for file in files[:IMAGES_NAMED]
    )
    more = f" and {len(files) - IMAGES_NAMED} more" if len(files) > IMAGES_NAMED else ""
    one = len(files) == 1
    return (
        f"{len(files)} image{'' if one else 's'} left out, whose name{' does' if one else 's do'} not fit those of the "
        f"others: {names}{more}"
    )
