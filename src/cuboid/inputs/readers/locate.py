"""Search for the single recording at a user's path; otherwise a message that describes the contents."""

from __future__ import annotations

import dataclasses
import os
import re
from collections.abc import Iterable
from pathlib import Path

from cuboid.ground.core.errors import InputError, shown
from cuboid.ground.core.paths import PathLike
from cuboid.ground.formats.reading import names_in
from cuboid.ground.formats.stored import ARCHIVE_ENDINGS, StoredPath, located
from cuboid.inputs.readers import calibration as calibrations
from cuboid.inputs.readers.image_folder import counted_endings, left_out, left_out_warning
from cuboid.inputs.readers.reader import READERS, Listing, Reader
from cuboid.inputs.readers.recording import Recording

# Maximum number of folders, and of layouts, in a message.
FOLDERS, LAYOUTS = 4, 3
# The format for users' own recordings.
PLAIN = "plain"
# Names of files and folders that usually hold camera poses: of TUM, COLMAP, nerfstudio, odometry programs.
POSES_LIKE = re.compile(r"pose|traj|odom|ground[_-]?truth|extrinsic|colmap|^sparse$|^transforms\.json$", re.IGNORECASE)


def nothing_found(given: Path, readers: Iterable[tuple[str, Reader]]) -> InputError:
    """Return the error for a path without a recording; notes list its contents and the nearest layouts."""
    all_readers = list(readers)
    if given.is_file():
        return InputError(f"{given} is a file{_expected(all_readers)}")
    names = sorted(names_in(given))
    if not names:
        return InputError(f"{given} is empty{_expected(all_readers)}")
    folders = [name for name in names if not name.startswith(".") and (given / name).is_dir()]
    error = InputError(f"{given} holds no recording{_expected(all_readers)}")
    error.add_note(f"seen: {_seen(given, names, folders)}")
    inside = {name: _names(given / name) for name in folders}
    for name, lacking in _near(names, inside, all_readers):
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
    except InputError:  # an unreadable folder
        return []


def _seen(given: Path, names: list[str], folders: list[str]) -> str:
    """Return counts of file suffixes, here and in each folder."""
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
    """Return partly present layouts with their missing parts, those with the fewest missing parts first."""
    found = []
    for name, reader in readers:
        parts = [part for part in reader.expects.split(", ") if "/" in part or "." in part]
        lacking = [part for part in parts if not any(_there(one, names, inside) for one in part.split(" or "))]
        if len(lacking) < len(parts):
            found.append((len(lacking), name != PLAIN, name, lacking))
    return [(name, lacking) for _, _, name, lacking in sorted(found)[:LAYOUTS]]


def _there(part: str, names: list[str], inside: dict[str, list[str]]) -> bool:
    """Tell whether a part of a layout exists: a folder `name/`, or a file name in which N is a digit."""
    folder, slash, file = part.strip().rpartition("/")
    if slash and not file:
        return folder in inside
    pattern = re.compile(_pattern(file or part.strip()))
    return any(pattern.fullmatch(name) for name in (inside.get(folder, []) if slash else names))


def _pattern(name: str) -> str:
    """Return the regular expression of a file name: NNN is a number, .png|jpg either suffix."""
    stem, dot, ending = name.rpartition(".")
    numbers = re.sub(r"N+|TIME", r"\\d+", re.escape(stem))
    return f"{numbers}{re.escape(dot)}(?:{'|'.join(map(re.escape, ending.split('|')))})"


# A user may name a dataset's folder: recordings lie up to two folders deeper (rgbd-scenes-v2/imgs/scene_01).
FOLDER_LEVELS = 2
# Maximum number of recordings that a message lists if there are several.
RECORDINGS_LISTED = 8


def open_recording(
    path: PathLike,
    *,
    format: str | None = None,  # noqa: A002 - the flag's own name
    intrinsics: calibrations.GivenIntrinsics | None = None,
    depth_scale: float | None = None,
) -> Recording:
    """Open an RGB-D recording; its format is recognised from its content.

    Parameters
    ----------
    path : path
        The recording's folder or file, or a folder up to two levels above it if it contains no other recording. A .zip
        or .tar archive counts as a folder, and so does a URL (https://, s3://, gs://; extra "remote").
    format : str, optional
        Name of the reader: "plain", "tum", "7-scenes", "uw-rgbd-scenes-v2", ..., or one of another package; options of
        the format follow a colon, as in "ros-bag:color=/camera/color/image_raw".
    intrinsics : sequence of 4 floats or path, optional
        fx, fy, cx, cy in pixels, instead of those in the recording; or a file in the format of ``camera.json``, whose
        depth scale is used too, or of ``camera-intrinsics.txt``.
    depth_scale : float, optional
        Units per metre of the depth images, instead of the format's own.

    Returns
    -------
    Recording
        The recording; only its first few images are decoded, to find their size.

    Raises
    ------
    InputError
        There is no recording, or more than one, or it cannot be used; the message is one line with the reason.

    Examples
    --------
    >>> recording = open_recording("rgbd-scenes-v2/imgs/scene_01")  # doctest: +SKIP
    >>> for frame in recording.iterate():  # doctest: +SKIP
    ...     ...
    """
    wanted, _, text = (format or "").partition(":")
    readers = list(READERS.items()) if format is None else [(wanted, READERS.get(wanted))]
    try:
        given = located(path)
        if not given.exists():
            raise InputError(f"{given if isinstance(given, StoredPath) else path} does not exist")
        name, reader, found = _find(given, readers)
        listing = reader.read(found) if not text else _read_with(name, reader, found, text)
    except OSError as error:  # links in a circle, a name that is too long, a folder that may not be read
        where = error.filename if isinstance(error.filename, str) else path
        raise InputError(f"{where} cannot be read: {error.strerror}") from None
    except ValueError:  # a NUL, or half a character, in the name
        raise InputError(f"{shown(str(path))}: no recording can have this name") from None
    calibration, depth_units_per_metre = calibrations.choose(listing, intrinsics, depth_scale, found)
    more = (
        left_out_warning(found, left_out(listing.frames)),
        _unread_poses(found, name, listing),
        calibrations.assumption(listing, calibration, depth_units_per_metre, scale_given=depth_scale is not None),
    )
    warnings = (*listing.warnings, *(warning for warning in more if warning is not None))
    listing = dataclasses.replace(listing, up_world=calibrations.up_world(listing), warnings=warnings)
    return Recording(found, f"{name}:{text}" if text else name, listing, calibration, depth_units_per_metre)


def _unread_poses(path: Path, name: str, listing: Listing) -> str | None:
    """Return a warning if no frame has a pose, but files beside the images look as if they held poses."""
    if path.is_file() or any(entry.pose is not None for entry in listing.frames):
        return None
    unread = [file for file in sorted(_names(path)) if POSES_LIKE.search(file) and not file.startswith(".")]
    if not unread:
        return None
    more = f" and {len(unread) - FOLDERS} more" if len(unread) > FOLDERS else ""
    return (
        f"the recording counts as one without poses: the layout '{name}' does not read {', '.join(unread[:FOLDERS])}"
        f"{more}; docs/recordings.md says where it expects poses"
    )


def _read_with(name: str, reader: Reader, path: Path, text: str) -> Listing:
    """List the frames of a recording with the options behind the name of its format."""
    if reader.read_with is None:
        raise InputError(f"the format '{name}' has no options, got '{text}'")
    options: dict[str, str] = {}
    for word in text.split(","):
        key, equals, value = word.partition("=")
        if not (key and equals and value):
            raise InputError(f"the format '{name}' expects options NAME=VALUE,..., got '{text}'")
        options[key] = value
    return reader.read_with(path, options)


def _find(given: Path, readers: list[tuple[str, Reader]]) -> tuple[str, Reader, Path]:
    """Return the single recording at or below a path; folders inside a recording do not count."""
    found: list[tuple[str, Reader, Path]] = []
    level = [given]
    for depth in range(FOLDER_LEVELS + 1):
        inner = []
        for path in level:
            here = [(name, reader, path) for name, reader in readers if reader.recognises(path)]
            if len(here) > 1:
                here = [one for one in here if not one[1].gives_way(path)] or here
            found += here
            if not here and depth < FOLDER_LEVELS:
                inner += _inside(path, {ending for _, reader in readers for ending in reader.files})
        level = inner
    if not found:
        raise _nothing_found(given, readers)
    return _only_one(found, given)


def _only_one(found: list[tuple[str, Reader, Path]], given: Path) -> tuple[str, Reader, Path]:
    paths = list(dict.fromkeys(path for _, _, path in found))
    if len(paths) > 1:
        names = ", ".join(str(path.relative_to(given)) for path in paths[:RECORDINGS_LISTED])
        more = f" and {len(paths) - RECORDINGS_LISTED} more" if len(paths) > RECORDINGS_LISTED else ""
        raise InputError(f"{given} holds {len(paths)} recordings, name one of them: {names}{more}")
    if len(found) > 1:
        formats = " and ".join(f"'{name}'" for name, _, _ in found)
        raise InputError(f"{paths[0]} looks like {formats}; say which with --format")
    return found[0]


def _inside(path: Path, endings: set[str]) -> list[Path]:
    """Return subfolders and files with these suffixes, sorted, without hidden and unreadable ones."""
    if not path.is_dir():
        return []
    try:
        names = sorted(name for name in names_in(path) if not name.startswith("."))
    except InputError:
        return []
    # is_dir is False for a link that leads nowhere, or round in a circle
    wanted = (name for name in names if os.path.splitext(name)[1] in endings or (path / name).is_dir())
    found = (path / name for name in wanted if _open_to_us(path / name))
    return [located(one) if one.name.endswith(ARCHIVE_ENDINGS) else one for one in found]


def _open_to_us(path: Path) -> bool:
    return isinstance(path, StoredPath) or os.access(path, os.R_OK | os.X_OK if path.is_dir() else os.R_OK)


def _nothing_found(given: Path, readers: list[tuple[str, Reader]]) -> InputError:
    above = [path for path in (given.parent, given.parent.parent) for _, reader in readers if reader.recognises(path)]
    if above:
        return InputError(f"{given} is a part of a recording; name {above[0]}")
    return nothing_found(given, readers)
