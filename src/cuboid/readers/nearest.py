"""The message where a path holds no recording: the files that were seen, and the layouts that are near."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from cuboid.core.errors import InputError
from cuboid.formats.reading import names_in
from cuboid.readers.image_folder import counted_endings
from cuboid.readers.reader import Reader

# At most this many folders, and layouts, are described.
FOLDERS, LAYOUTS = 4, 3
# The layout for recordings of one's own.
PLAIN = "plain"


def nothing_found(given: Path, readers: Iterable[tuple[str, Reader]]) -> InputError:
    """Return the error for a path without a recording; its notes name what was seen, and the nearest layouts."""
    known = list(readers)
    if given.is_file():
        return InputError(f"{given} is a file{_expected(known)}")
    names = sorted(names_in(given))
    if not names:
        return InputError(f"{given} is empty{_expected(known)}")
    folders = [name for name in names if not name.startswith(".") and (given / name).is_dir()]
    error = InputError(f"{given} holds no recording{_expected(known)}")
    error.add_note(f"seen: {_seen(given, names, folders)}")
    inside = {name: _names(given / name) for name in folders}
    for name, lacking in _near(names, inside, known):
        error.add_note(f"near: {name}, but it lacks {', '.join(lacking)}")
    return error


def _expected(readers: list[tuple[str, Reader]]) -> str:
    if len(readers) > LAYOUTS:
        example = next((f", such as plain ({reader.expects})" for name, reader in readers if name == PLAIN), "")
        return f"; a recording in one of {len(readers)} forms is expected{example}; docs/recordings.md has all"
    described = "; ".join(f"{name} ({reader.expects})" for name, reader in readers)
    return f"; a recording of one of these forms is expected: {described}"


def _names(folder: Path) -> list[str]:
    try:
        return list(names_in(folder))
    except InputError:  # a folder that may not be read
        return []


def _seen(given: Path, names: list[str], folders: list[str]) -> str:
    """Return how many files of each ending there are, here and in each folder."""
    parts = []
    files = counted_endings(name for name in names if name not in folders)
    if files:
        parts.append(files)
    for folder in folders[:FOLDERS]:
        inner = _names(given / folder)
        parts.append(f"{counted_endings(inner) or ('folders' if inner else 'nothing')} in {folder}/")
    if len(folders) > FOLDERS:
        parts.append(f"and {len(folders) - FOLDERS} more folders")
    return ", ".join(parts) or "hidden files"


def _near(
    names: list[str], inside: dict[str, list[str]], readers: list[tuple[str, Reader]]
) -> list[tuple[str, list[str]]]:
    """Return the layouts of which some parts are there, those that lack the fewest first, and what each lacks."""
    found = []
    for name, reader in readers:
        parts = [part for part in reader.expects.split(", ") if "/" in part or "." in part]
        lacking = [part for part in parts if not any(_there(one, names, inside) for one in part.split(" or "))]
        if len(lacking) < len(parts):
            found.append((len(lacking), name != PLAIN, name, lacking))
    return [(name, lacking) for _, _, name, lacking in sorted(found)[:LAYOUTS]]


def _there(part: str, names: list[str], inside: dict[str, list[str]]) -> bool:
    """Tell whether a part of a layout is there: a folder `name/`, or a file in whose name N is a digit."""
    folder, slash, file = part.strip().rpartition("/")
    if slash and not file:
        return folder in inside
    pattern = re.compile(_pattern(file or part.strip()))
    return any(pattern.fullmatch(name) for name in (inside.get(folder, []) if slash else names))


def _pattern(name: str) -> str:
    """Return the regular expression of a file's name: NNN is a number, .png|jpg either ending."""
    stem, dot, ending = name.rpartition(".")
    numbers = re.sub(r"N+|TIME", r"\\d+", re.escape(stem))
    return f"{numbers}{re.escape(dot)}(?:{'|'.join(map(re.escape, ending.split('|')))})"
