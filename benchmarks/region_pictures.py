"""Pictures with truth: made ones with masks, to which the score of regions is fitted, and annotated frames."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from cuboid import open_recording
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.lab.evaluation.keyframes import Keyframe, is_keyframes, read_keyframes
from cuboid.runs.tracking.rolling import Roll, farther_up
from place_list import Place

# Ids in masks: no object; neither way.
STRUCTURE, IGNORED = 0, 65535


@dataclass(frozen=True, slots=True)
class MaskedPicture:
    """A picture with a mask of each object.

    Attributes
    ----------
    frame : Frame
    intrinsics : Intrinsics
    ids : (h, w) uint16
        Object of each pixel, STRUCTURE or IGNORED.
    """

    frame: Frame
    intrinsics: Intrinsics
    ids: npt.NDArray[np.uint16]


def made_pictures(folder: Path) -> Iterator[MaskedPicture]:
    """Iterate over the pictures that `pictures/picture_scenes.py` made, turned as a tracker turns them."""
    for scene in sorted(folder.glob("scene-*")):
        if not (scene / "camera.json").is_file():
            continue
        camera = json.loads((scene / "camera.json").read_text(encoding="utf-8"))
        intrinsics = Intrinsics(*(camera[name] for name in ("fx", "fy", "cx", "cy", "width", "height")))
        for path in sorted(scene.glob("mask-*.png")):
            number = path.stem.removeprefix("mask-")
            color = _read(scene / f"color-{number}.jpg", cv2.IMREAD_COLOR)[..., ::-1]
            depth_m = _read(scene / f"depth-{number}.png", cv2.IMREAD_UNCHANGED).astype(np.float32) / 1000.0
            frame = Frame(0, 0.0, np.ascontiguousarray(color), depth_m, None)
            roll = Roll(intrinsics, farther_up(depth_m) or 0)
            ids = np.rot90(_read(path, cv2.IMREAD_UNCHANGED), -roll.turns)
            yield MaskedPicture(roll.frame(frame), roll.camera, np.ascontiguousarray(ids))


def _read(path: Path, flags: int) -> npt.NDArray[np.generic]:
    picture = cv2.imread(str(path), flags)
    if picture is None:
        raise OSError(f"{path}: cannot be read as an image")
    return picture


def annotated_frames(place: Place) -> Iterator[tuple[Frame, Roll, Keyframe]]:
    """Iterate over the frames of a place with drawn rectangles: the frame, turned, with the rectangles as drawn."""
    for part in place.parts:
        drawn: dict[int, list[Keyframe]] = {}
        for path in filter(is_keyframes, part.truths):
            for keyframe in read_keyframes(path).frames:
                drawn.setdefault(keyframe.frame, []).append(keyframe)
        if not drawn:
            continue
        recording = open_recording(part.recording)
        for frame in recording:
            if isinstance(frame, Frame) and frame.index in drawn:
                roll = Roll(recording.intrinsics, farther_up(frame.depth_m) or 0)
                for keyframe in drawn[frame.index]:
                    yield roll.frame(frame), roll, keyframe
