"""Selection of a recording's camera and depth scale: the user's, the folder's or the published ones."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import InputError, OutputError
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.paths import PathLike
from cuboid.ground.formats.camera_file import MAX_UNITS, MIN_UNITS, CameraDocument, MatrixRow
from cuboid.ground.formats.json_validation import read_json
from cuboid.ground.formats.table_validation import read_lines
from cuboid.inputs.readers.common_files import find_common
from cuboid.inputs.readers.depth_camera import DepthCamera, depth_camera_of
from cuboid.inputs.readers.missing_camera import missing_camera
from cuboid.inputs.readers.reader import Calibration, Listing
from cuboid.inputs.readers.registration import Registration
from cuboid.inputs.readers.undistortion import Undistortion

CAMERA_FILE = "camera.json"
MATRIX_FILE = "camera-intrinsics.txt"
_NUMBERS = ("fx", "fy", "cx", "cy", "width", "height")
_DEPTH_UNITS = "depth_units_per_metre"
_DISTORTION = "distortion"

HOW_TO_GIVE = f"give them with --intrinsics FX,FY,CX,CY or in {CAMERA_FILE}"

# Intrinsics from a user: fx, fy, cx, cy of undistorted images, a file in the format of camera.json or
# camera-intrinsics.txt, or a complete calibration.
GivenIntrinsics = Sequence[float] | PathLike | Calibration


def choose(
    listing: Listing, intrinsics: GivenIntrinsics | None, depth_scale: float | None, recording: Path
) -> tuple[Calibration, float]:
    """Return the calibration and the depth units per metre of a recording.

    The user's values come first, then `camera.json` or `camera-intrinsics.txt` beside the images, then the values
    published for the format; if these are missing or assumed, a camera file of another program comes before them.

    Raises
    ------
    InputError
        One of the two is missing (the error's notes then contain the `camera.json` to write), or is invalid.
    """
    calibration, units = listing.calibration, listing.depth_units_per_metre
    found = _find_file(listing.camera_folders)
    if found is not None:
        calibration, units_in_file = _read(found)
        units = units_in_file or units
    elif calibration is None or listing.assumed:
        common = next((one for folder in listing.camera_folders if (one := find_common(folder)) is not None), None)
        if common is not None:
            calibration, units = common[0], common[1] or units
    if isinstance(intrinsics, Calibration):
        calibration = intrinsics
    elif isinstance(intrinsics, str | os.PathLike):
        calibration, units_in_file = _read(Path(intrinsics))
        units = units_in_file or units
    elif intrinsics is not None:
        calibration = _from_user(intrinsics)
    if depth_scale is not None:
        if not MIN_UNITS <= depth_scale <= MAX_UNITS:
            raise InputError(
                f"the depth scale must be {MIN_UNITS:g} to {MAX_UNITS:g} units per metre, got {depth_scale:g}"
            )
        units = float(depth_scale)
    if calibration is None or units is None:
        raise missing_camera(listing, recording, calibration, units, CAMERA_FILE)
    if not MIN_UNITS <= units <= MAX_UNITS:
        raise InputError(
            f"{recording}: its depth scale of {units:.3g} units per metre is none; "
            f"expected {MIN_UNITS:g} to {MAX_UNITS:g}, or give it with --depth-scale"
        )
    return calibration, units


def assumption(listing: Listing, calibration: Calibration, units: float, *, scale_given: bool) -> str | None:
    """Return a one-line warning about a camera or a depth scale in use that the layout only assumes; else None."""
    camera = f"the camera is taken as fx {calibration.fx:g} ({calibration.source})"
    scale = f"{units:g} depth units per metre"
    taken = [camera] * (calibration is listing.calibration)
    taken += [scale] * (units == listing.depth_units_per_metre and not scale_given)
    if not (listing.assumed and taken):
        return None
    return f"{listing.assumed}: {' with '.join(taken)}; if that is wrong, write {CAMERA_FILE} beside the images"


def up_world(listing: Listing) -> tuple[float, float, float] | None:
    """Return up (opposite to gravity) in the world of the poses, from `camera.json` or the format, or None.

    Raises
    ------
    InputError
        If `camera.json` cannot be read.
    """
    found = _find_file(listing.camera_folders)
    measured = read_json(found, CameraDocument).up_world if found is not None and found.suffix == ".json" else None
    return measured or listing.up_world


# Minimum and maximum focal length, in image widths: fields of view of 179.4 degrees and of 3.4 arc minutes.
MIN_FOCAL, MAX_FOCAL = 0.005, 1000.0


def for_size(calibration: Calibration, width: int, height: int, recording: Path) -> Intrinsics:
    """Return the intrinsics for images of this size.

    Raises
    ------
    InputError
        The calibration is for another image size, or is not plausible.
    """
    if calibration.size not in (None, (width, height)):
        raise InputError(
            f"{recording}: the images are {width}x{height}, but the intrinsics ({calibration.source}) "
            f"are for {'x'.join(map(str, calibration.size))}; {HOW_TO_GIVE}"
        )
    if not (0 <= calibration.cx < width and 0 <= calibration.cy < height):
        raise InputError(
            f"{recording}: the principal point ({calibration.cx:g}, {calibration.cy:g}), "
            f"from {calibration.source}, lies outside the {width}x{height} images; "
            "are the intrinsics for another image size?"
        )
    fx, fy, cx, cy = map(float, (calibration.fx, calibration.fy, calibration.cx, calibration.cy))
    if not (MIN_FOCAL * width <= min(fx, fy) and max(fx, fy) <= MAX_FOCAL * width):
        raise InputError(
            f"{recording}: the focal lengths ({fx:.3g}, {fy:.3g}), from {calibration.source}, are no camera's; "
            f"expected {MIN_FOCAL:g} to {MAX_FOCAL:g} times the width of the images, {width} pixels"
        )
    return Intrinsics(fx, fy, cx, cy, width, height)


def undistortion(calibration: Calibration, size: tuple[int, int], recording: Path) -> Undistortion:
    """Return the undistortion of images with this width and height.

    Raises
    ------
    InputError
        The coefficients are not plausible for a lens.
    """
    K = np.array([[calibration.fx, 0, calibration.cx], [0, calibration.fy, calibration.cy], [0, 0, 1]], np.float64)
    try:
        return Undistortion(K, calibration.distortion, size)
    except ValueError as error:
        raise InputError(
            f"{recording}: the distortion coefficients ({calibration.source}) are wrong: {error}"
        ) from None


def registration(calibration: Calibration, intrinsics: Intrinsics, recording: Path) -> Registration | None:
    """Return the registration of depth to images with these intrinsics; None if depth is already aligned.

    Raises
    ------
    InputError
        The depth camera is invalid.
    """
    if calibration.depth_camera is None:
        return None
    try:
        return Registration(calibration.depth_camera, intrinsics)
    except ValueError as error:
        raise InputError(f"{recording}: the depth camera ({calibration.source}) is wrong: {error}") from None


def _find_file(folders: Sequence[Path]) -> Path | None:
    for folder in folders:
        for name in (CAMERA_FILE, MATRIX_FILE):
            if (folder / name).is_file():
                return folder / name
    return None


def _read(path: Path) -> tuple[Calibration, float | None]:
    return _read_json(path) if path.suffix == ".json" else (_read_matrix(path), None)


def write_camera(
    path: Path,
    intrinsics: Intrinsics,
    depth_units_per_metre: float,
    distortion: Sequence[float] = (),
    depth_camera: DepthCamera | None = None,
    up_world: Float64Array | None = None,
) -> None:
    """Write a `camera.json`.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    values = {name: round(float(getattr(intrinsics, name)), 3) for name in _NUMBERS[:4]}
    sizes = {"width": intrinsics.width, "height": intrinsics.height}
    document: dict[str, Any] = {**values, **sizes, _DEPTH_UNITS: float(f"{depth_units_per_metre:.6g}")}
    if any(distortion):
        document[_DISTORTION] = [float(f"{value:.6g}") for value in distortion]
    if depth_camera is not None:
        document |= depth_camera.document()
    if up_world is not None:
        document["up_world"] = [round(value, 6) for value in up_world.tolist()]
    try:
        path.write_text(json.dumps(document) + "\n", encoding="utf-8")
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror}") from error


def _read_json(path: Path) -> tuple[Calibration, float | None]:
    """Read a camera.json: fx, fy, cx, cy, width, height and, optionally, depth_units_per_metre and distortion."""
    camera = read_json(path, CameraDocument)
    size, distortion = (camera.width, camera.height), tuple(camera.distortion)
    depth = depth_camera_of(camera)
    found = Calibration(camera.fx, camera.fy, camera.cx, camera.cy, size, path.name, distortion, depth)
    return found, camera.depth_units_per_metre


def _read_matrix(path: Path) -> Calibration:
    """Read the three rows of a 3x3 camera matrix."""
    rows = [row for _, row in read_lines(path, MatrixRow)]
    if len(rows) != 3:
        raise InputError(f"{path}: expected a 3x3 camera matrix, got {len(rows)} rows")
    fx, fy, cx, cy = rows[0].first, rows[1].second, rows[0].third, rows[1].third
    rest = (rows[0].second, rows[1].first, rows[2].first, rows[2].second)
    if fx <= 0 or fy <= 0 or any(rest) or rows[2].third != 1:
        raise InputError(f"{path}: expected the matrix fx 0 cx, 0 fy cy, 0 0 1 with fx, fy > 0")
    return Calibration(fx, fy, cx, cy, None, path.name)


def _from_user(intrinsics: Sequence[float]) -> Calibration:
    values = [float(value) for value in intrinsics]
    if len(values) != 4 or not all(map(math.isfinite, values)) or min(values[:2]) <= 0:
        raise InputError(f"intrinsics must be four numbers fx, fy, cx, cy with fx, fy > 0, got {values}")
    fx, fy, cx, cy = values
    return Calibration(fx, fy, cx, cy, None, "the user")
