"""Calibration of a fixed rig from the recordings of its cameras: poses, the content of `rig.json`, and a picture."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cuboid.ground.arrays import Float64Array, UInt8Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.frame import Frame
from cuboid.ground.core.palette import color_of
from cuboid.ground.formats.rig_file import FIXED, FORMAT, MAX_NAME, NAME_PATTERN, VERSION
from cuboid.ground.geometry.se3 import inverse, transform
from cuboid.inputs.calibration.board import Board
from cuboid.inputs.calibration.board_fit import BoardFit, fit_board, seen_boards
from cuboid.inputs.calibration.rig_fit import RigFit, fit_rig
from cuboid.inputs.calibration.still_view import StillView, still_view
from cuboid.inputs.readers import Recording
from cuboid.inputs.readers.usable import usable_frames

# Frames of each camera, evenly spread: their median has a third of the noise of one.
FRAMES_PER_CAMERA = 12
# Frames of each camera in which a board is searched at most, evenly spread: of a minute, three a second.
BOARD_FRAMES = 200
BACKGROUND = (18, 20, 24)
# Digits after the point of matrices in rig.json: a hundredth of a micrometre.
MATRIX_DIGITS = 8


def calibrate_rig(recordings: Sequence[Recording], names: Sequence[str]) -> tuple[RigFit, list[StillView]]:
    """Find the poses of fixed cameras from what they see; return them with the still views.

    Raises
    ------
    InputError
        There are fewer than two recordings, a recording has no usable frame, or a camera sees nothing that another one
        sees as well.
    """
    _refuse_one(recordings)
    views = still_views(recordings, names)
    return fit_rig(views, names), views


def calibrate_with_board(recordings: Sequence[Recording], names: Sequence[str], board: Board) -> BoardFit:
    """Find the poses of the cameras of a rig from a board that several of them see at the same time.

    Raises
    ------
    InputError
        There are fewer than two recordings, or a camera does not see the board at the same time as another one.
    """
    _refuse_one(recordings)
    seen = [seen_boards(_spread(recording, BOARD_FRAMES), board) for recording in recordings]
    return fit_board(seen, [recording.intrinsics for recording in recordings], names, board)


def still_views(recordings: Sequence[Recording], names: Sequence[str]) -> list[StillView]:
    """Return the still view of each camera; raises InputError if one has none."""
    return [still_view_of(recording, name) for recording, name in zip(recordings, names, strict=True)]


def still_view_of(recording: Recording, name: str) -> StillView:
    """Return the still view of a camera; raises InputError, which names the camera, if it has none."""
    try:
        return still_view((frame.depth_m for frame in _spread(recording, FRAMES_PER_CAMERA)), recording.intrinsics)
    except InputError as error:
        raise InputError(f"{recording.path}: camera {name}: {error}") from None


def _refuse_one(recordings: Sequence[Recording]) -> None:
    if len(recordings) < 2:
        raise InputError("a rig has two cameras or more; name one recording for each")


def _spread(recording: Recording, count: int) -> Iterator[Frame]:
    """Iterate over some usable frames, evenly spread."""
    images_only = recording.without_poses()
    chosen = np.unique(np.linspace(0, len(images_only) - 1, count).astype(int))
    return usable_frames(images_only.read, chosen.tolist())


def names_of(recordings: Sequence[Recording]) -> list[str]:
    """Return names of cameras: those of the folders if they differ, else "camera-1", "camera-2", ..."""
    names = [recording.path.stem for recording in recordings]
    valid = all(len(name) <= MAX_NAME and re.fullmatch(NAME_PATTERN, name) for name in names)
    usable = valid and len(set(names)) == len(names)
    return names if usable else [f"camera-{k + 1}" for k in range(len(names))]


def rig_document(
    T_rig_camera: Float64Array, recordings: Sequence[Recording], names: Sequence[str], output: Path
) -> dict[str, Any]:
    """Return the content of `rig.json`, of N poses (N, 4, 4); recordings are relative to the folder of `output`."""
    cameras = [
        {
            "name": name,
            "recording": Path(os.path.relpath(recording.path, output.parent)).as_posix(),
            "T_rig_camera": np.round(T, MATRIX_DIGITS).tolist(),
        }
        for name, recording, T in zip(names, recordings, T_rig_camera, strict=True)
    ]
    return {"format": FORMAT, "version": VERSION, "kind": FIXED, "cameras": cameras}


def overlay(views: Sequence[StillView], T_rig_camera: Float64Array) -> UInt8Array:
    """Return a picture (H, W, 3) of the clouds of cameras in the view of the first one, a color for each camera.

    Where the colors mix on a surface, the clouds lie on each other; two edges in two colors side by side are an error.
    """
    camera = views[0].camera
    picture = np.full((camera.height, camera.width, 3), BACKGROUND, np.uint8)
    pixels, depths, colors = [], [], []
    T_first_rig = inverse(T_rig_camera[0])
    for k, (view, T) in enumerate(zip(views, T_rig_camera, strict=True)):
        points = transform(T_first_rig @ T, view.points)
        points = points[points[:, 2] > 0]
        pixels.append(np.rint(camera.pixels(points)).astype(np.int64))
        depths.append(points[:, 2])
        colors.append(np.tile(np.array(color_of(k + 1), np.uint8), (len(points), 1)))
    uv, z, rgb = np.concatenate(pixels), np.concatenate(depths), np.concatenate(colors)
    far_first = np.argsort(-z, kind="stable")
    for dv in (0, 1):
        for du in (0, 1):
            u, v = (uv[far_first] + (du, dv)).T
            inside = (u >= 0) & (v >= 0) & (u < camera.width) & (v < camera.height)
            picture[v[inside], u[inside]] = rgb[far_first][inside]
    return picture
