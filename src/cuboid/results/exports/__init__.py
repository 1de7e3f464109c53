"""Exports of results to other programs' formats. Other packages can add formats (entry points ``cuboid.exports``)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cuboid.ground.core.errors import InputError, OutputError
from cuboid.ground.core.paths import PathLike, as_path, file_name, refuse_same_file_names
from cuboid.ground.formats.folder import OUTPUT_NAMES
from cuboid.ground.formats.reading import real_path
from cuboid.results.exports.registry import EXPORTS, Export
from cuboid.results.files import Results
from cuboid.results.files.pending import new_file, new_folder, refuse_taken

__all__ = ["EXPORTS", "Export", "Results", "export"]


def export(run: Results, name: str, path: PathLike, *, force: bool = False, **options: Any) -> list[str]:
    """Write results in another format.

    Parameters
    ----------
    run : Results
        The results.
    name : str
        Name of the format, one of `EXPORTS`.
    path : path
        The file, or for PLY the folder, to write; it appears when it is whole.
    force : bool
        Whether existing files are replaced.
    **options
        Those of shapes (glb, obj, stl, urdf, usd): close and complete as of `Results.mesh`; and, but for stl,
        collision: "none", "box", "hull" or "parts".

    Returns
    -------
    list of str
        Notes for the user, for example what the format cannot represent.

    Raises
    ------
    InputError
        There is no such form, it has no such option, or a file of the results is missing or malformed.
    OutputError
        The name does not fit the form, exists without `force`, is a file of the results, or cannot be written.
    MissingExtraError
        The form needs a package that is not installed.
    """
    form, path = EXPORTS.get(name), as_path(path)
    _refuse(run, name, form, path)
    for option in options:
        if option not in form.options:
            with_it = ", ".join(key for key, one in EXPORTS.items() if option in one.options)
            raise InputError(f"'{name}' has no option {option}; of the exports these have: {with_it or 'none'}")
    if form.one_camera and run.report.rig_cameras:
        paths = _paths_of_cameras(path, [camera.name for camera in run.report.rig_cameras], force=force)
        notes = [
            f"{camera}: {note}"
            for camera, file in paths.items()
            for note in export(run.of_camera(camera), name, file, force=force, **options)
        ]
        return [f"a file for each camera, such as {next(iter(paths.values()))}", *notes]
    if form.suffix:
        with new_file(path, force=force) as file:
            return form.write(run, file, **options)
    with new_folder(path, force=force, replaces=form.names) as folder:
        return form.write(run, folder, **options)


def fitting_path(name: str, path: PathLike) -> Path:
    """Return the path with the suffix of a format; without a suffix for a format that is a folder of files."""
    form, path = EXPORTS.get(name), as_path(path)
    return path if path.suffix.lower() == form.suffix else path.with_suffix(form.suffix)


def path_of_camera(path: Path, camera: str) -> Path:
    """Return the path of a camera's file: the name of the camera follows that of the file."""
    return path.with_name(f"{path.stem}-{file_name(camera)}{path.suffix}")


def _paths_of_cameras(path: Path, cameras: Sequence[str], *, force: bool) -> dict[str, Path]:
    """Return the path of each camera's file; raise OutputError, before one is written, if it cannot be used."""
    refuse_same_file_names(cameras)
    paths = {camera: path_of_camera(path, camera) for camera in cameras}
    for file in paths.values():
        refuse_taken(file, force=force)
    return paths


def _refuse(run: Results, name: str, form: Export, path: Path) -> None:
    """Refuse a name with another suffix, or the name of a result file."""
    if form.suffix and path.suffix.lower() != form.suffix:
        raise OutputError(f"{path}: '{name}' is a {form.suffix} file; name it {path.with_suffix(form.suffix)}")
    if not form.suffix and path.suffix:
        raise OutputError(f"{path}: '{name}' is a folder of files; name it {path.with_suffix('')}")
    real, results = real_path(path), real_path(run.folder)
    if real == results or (real.parent == results and real.name in OUTPUT_NAMES):
        raise OutputError(f"{path}: belongs to the results themselves; name another output")
