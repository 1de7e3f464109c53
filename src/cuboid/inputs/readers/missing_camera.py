"""The message about a recording whose intrinsics or depth scale are missing, with the `camera.json` to write."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cuboid.ground.core.errors import FrameError, InputError
from cuboid.inputs.readers.images import SATURATED, decode_color, decode_depth
from cuboid.inputs.readers.reader import Calibration, FrameEntry, Listing

# Number of images that are decoded for the guesses, evenly spaced.
IMAGES = 5
# Field of view along the longer side of the image, degrees: color cameras of depth sensors have 55 to 70.
USUAL_FIELD_OF_VIEW = 60.0
# Depth units per metre in use, and what writes them.
SCALES = {1000.0: "millimetres", 5000.0: "TUM", 10000.0: "0.1 mm"}
# With millimetres, 95 % of the readings of these sensors are below FARTHEST_MM; otherwise the scale is larger: the next
# one with a median up to USUAL_MEDIAN_M, metres.
FARTHEST_MM = 9000.0
USUAL_MEDIAN_M = 5.0


class UnknownIntrinsicsError(InputError):
    """The intrinsics of a recording are unknown.

    Attributes
    ----------
    sizes : ((int, int), (int, int)) or None
        Width and height of color and of depth, pixels, if both are known.
    """

    sizes: tuple[tuple[int, int], tuple[int, int]] | None = None


@dataclass(frozen=True, slots=True)
class Guess:
    """Guesses of a camera from its images.

    Attributes
    ----------
    size : (int, int) or None
        Width and height of color, pixels; None if no color image can be decoded.
    depth_size : (int, int) or None
        Width and height of depth, pixels.
    focal : float or None
        Focal length for the usual field of view, pixels.
    median : float or None
        Median of the depth readings, in their units.
    units : float
        Depth units per metre.
    fault : str
        Reason why no depth image can be decoded, or empty.
    """

    size: tuple[int, int] | None
    depth_size: tuple[int, int] | None
    focal: float | None
    median: float | None
    units: float
    fault: str


def missing_camera(
    listing: Listing, recording: Path, calibration: Calibration | None, units: float | None, camera_file: str
) -> InputError:
    """Return the error that lists the missing values; its notes contain the `camera.json` to write, with guesses.

    Parameters
    ----------
    listing : Listing
    recording : Path
    calibration : Calibration or None
        The color camera, if it is known.
    units : float or None
        Depth units per metre, if known.
    camera_file : str
        Name of the file to write.
    """
    missing = ["intrinsics"] * (calibration is None) + ["depth scale"] * (units is None)
    options = {"intrinsics": "--intrinsics FX,FY,CX,CY", "depth scale": "--depth-scale UNITS_PER_METRE"}
    verb, pronoun = ("are", "them") if calibration is None else ("is", "it")
    line = (
        f"{recording}: the {' and the '.join(missing)} {verb} not known; "
        f"give {pronoun} with {' and '.join(options[what] for what in missing)} or in {camera_file}"
    )
    error = UnknownIntrinsicsError(line) if calibration is None else InputError(line)
    has_scale = listing.depth_units_per_metre is not None
    folder = listing.camera_folders[0] if listing.camera_folders else recording
    guess = guess_camera(listing.frames)
    if isinstance(error, UnknownIntrinsicsError) and guess.size is not None and guess.depth_size is not None:
        error.sizes = guess.size, guess.depth_size
    for note in _notes(guess, calibration, units, folder / camera_file, recording, has_scale):
        error.add_note(note)
    return error


def guess_camera(frames: Sequence[FrameEntry]) -> Guess:
    """Return guesses of the camera from some of the images."""
    sizes: list[tuple[int, int]] = []
    depth_size, fault = None, ""
    readings: list[npt.NDArray[np.float64]] = []
    for k in sorted({round(k) for k in np.linspace(0, len(frames) - 1, min(IMAGES, len(frames)))}):
        entry = frames[k]
        try:
            if entry.color is not None:
                height, width = decode_color(entry.color, "").shape[:2]
                sizes.append((width, height))
        except FrameError:
            pass
        try:
            if entry.depth is not None:
                depth = decode_depth(entry.depth, entry.depth.name if isinstance(entry.depth, Path) else "")
                depth_size = (depth.shape[1], depth.shape[0])
                readings.append(depth[(depth > 0) & (depth < SATURATED)].astype(np.float64))
        except FrameError as error:
            fault = fault or str(error)
    size = sizes[0] if sizes else None
    focal = None if size is None else max(size) / 2 / math.tan(math.radians(USUAL_FIELD_OF_VIEW / 2))
    values = np.concatenate(readings) if readings else np.zeros(0)
    if values.size == 0:
        return Guess(size, depth_size, focal, None, next(iter(SCALES)), fault)
    median, far = (float(value) for value in np.percentile(values, (50, 95)))
    return Guess(size, depth_size, focal, median, _scale(median, far), fault)


def _scale(median: float, far: float) -> float:
    """Return the depth units per metre that readings of this median and 95th percentile suggest."""
    millimetres, *finer = SCALES
    if far <= FARTHEST_MM:
        return millimetres
    return next((units for units in finer if median <= USUAL_MEDIAN_M * units), finer[-1])


def _notes(
    guess: Guess, calibration: Calibration | None, units: float | None, file: Path, recording: Path, has_scale: bool
) -> list[str]:
    """Return the lines below the message, at most 80 characters wide except for long file names."""
    document, lines = _document(guess, calibration, units), []
    if file.is_file():
        lines.append(f'add "depth_units_per_metre": {guess.units:g} to {file}, once the guess is checked')
    elif document is not None:
        first, last = (json.dumps(dict(list(document.items())[part])) for part in (slice(0, 4), slice(4, None)))
        lines = [f"write {file}, once the guesses are checked:", f"  {first[:-1]},", f"   {last[1:]}"]
        if guess.size is not None:
            lines.append("known: width, height")
        if calibration is None and guess.focal is not None:
            lines.append(
                f"guessed: fx, fy (a usual field of view, {USUAL_FIELD_OF_VIEW:g} degrees), cx, cy (the image centre)"
            )
    if units is None:
        lines += _scale_notes(guess)
    if guess.size and guess.depth_size and guess.size != guess.depth_size and (calibration is None):
        sizes = " and ".join(f"{w} x {h}" for w, h in (guess.depth_size, guess.size))
        lines.append(f"depth and color are {sizes}: camera.json needs depth_camera, T_color_depth too")
    if calibration is None and document is not None:
        scale = "" if has_scale else f" --depth-scale {document['depth_units_per_metre']}"
        lines += [
            "better intrinsics, from the recording itself:",
            f"  cuboid calibrate {recording}{scale} --output {file}",
        ]
    return lines


def _document(guess: Guess, calibration: Calibration | None, units: float | None) -> dict[str, Any] | None:
    """Return the `camera.json` to write; None if no color image can be decoded."""
    if guess.size is None or guess.focal is None:
        return None
    width, height = guess.size
    focal = round(guess.focal, 1)
    values = (focal, focal, (width - 1) / 2, (height - 1) / 2)
    if calibration is not None:
        values = (calibration.fx, calibration.fy, calibration.cx, calibration.cy)
    names = ("fx", "fy", "cx", "cy", "width", "height", "depth_units_per_metre")
    scale = guess.units if units is None else units
    return dict(zip(names, (*values, width, height, int(scale) if scale == int(scale) else scale), strict=True))


def _scale_notes(guess: Guess) -> list[str]:
    if guess.median is None:
        reason = guess.fault or "the depth images have no readings"
        return [f"guessed: depth_units_per_metre {guess.units:g} (the most common): {reason}"]
    others = ", ".join(f"{guess.median / units:.2g} m at {units:g} ({name})" for units, name in SCALES.items())
    return [
        f"guessed: depth_units_per_metre {guess.units:g}; the median reading, {guess.median:.0f}, is",
        f"  {others}",
    ]
