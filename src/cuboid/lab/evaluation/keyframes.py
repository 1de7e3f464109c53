"""Keyframes: rectangles with object identities that a person drew in some frames of a recording.

``docs/evaluation.md`` describes the format, "cuboid-keyframes" version 1.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import InputError, printable
from cuboid.ground.core.paths import PathLike, as_path
from cuboid.ground.formats.json_validation import checked, format_in, read_json
from cuboid.ground.formats.keyframes_file import FORMAT, KeyframeEntry, KeyframesDocument
from cuboid.inputs.readers.recording import Recording
from cuboid.lab.evaluation.boxer import is_boxer

# The frame number in a file name: the first number, which may be a timestamp.
NUMBER = re.compile(r"\d+(?:\.\d+)?")
COUNTING = "'frame' counts the recording's frames from 0, whatever their files are called"


@dataclass(frozen=True, slots=True)
class DrawnObject:
    """An object that a person drew.

    Attributes
    ----------
    id : int
        Positive, unique.
    name : str
        Name for users.
    group : bool
        Whether it is several objects that may also be seen as one.
    """

    id: int
    name: str
    group: bool = False


@dataclass(frozen=True, slots=True)
class DrawnRect:
    """The rectangle of an object in a frame.

    Attributes
    ----------
    id : int
        Id of the object.
    rect_xyxy : (4,) float64
        Tight rectangle around the visible part, pixels of the recording's full size, ends exclusive.
    visible : float
        Visible fraction of the object, 0..1.
    group : bool
        Whether it is several objects that may also be seen as one.
    """

    id: int
    rect_xyxy: Float64Array
    visible: float
    group: bool


@dataclass(frozen=True, slots=True)
class Keyframe:
    """An annotated frame.

    Attributes
    ----------
    frame : int
        Index of the frame in its recording, from 0, as in results.
    drawn : tuple of DrawnRect
    ignored : (N, 4) float64
        Rectangles in which detections count neither way.
    number : Decimal or None
        The number in the name of the frame's file, if the keyframes give it.
    """

    frame: int
    drawn: tuple[DrawnRect, ...]
    ignored: Float64Array
    number: Decimal | None = None

    @property
    def rects_xyxy(self) -> Float64Array:
        """The drawn rectangles, (N, 4)."""
        return np.array([item.rect_xyxy for item in self.drawn]).reshape(-1, 4)


@dataclass(frozen=True, slots=True)
class Keyframes:
    """The contents of a file of keyframes.

    Attributes
    ----------
    path : Path
    name : str
    objects : tuple of DrawnObject
        Objects by id.
    frames : tuple of Keyframe
        Keyframes in the recording's order.
    """

    path: Path
    name: str
    objects: tuple[DrawnObject, ...]
    frames: tuple[Keyframe, ...]


def is_keyframes(path: Path) -> bool:
    """Return whether a file declares the keyframes format; raise InputError if it is neither JSON nor Boxer's table."""
    return path.is_file() and not is_boxer(path) and format_in(path) == FORMAT


def read_keyframes(path: PathLike) -> Keyframes:
    """Read a file of keyframes.

    Raises
    ------
    InputError
        The file is missing, is of another format, or a field is missing or malformed; the message names file and
        field.
    """
    path = as_path(path)
    return _keyframes(path, read_json(path, KeyframesDocument))


def keyframes_from_json(path: Path, document: dict[str, Any]) -> Keyframes:
    """Return the keyframes in a document; `path` is for messages. Raises InputError as `read_keyframes`."""
    try:
        content = msgspec.json.encode(document)
    except (TypeError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: is no JSON: {error}") from None
    return _keyframes(path, checked(path, content, KeyframesDocument))


def _keyframes(path: Path, document: KeyframesDocument) -> Keyframes:
    objects = {item.id: DrawnObject(item.id, item.name or str(item.id), item.group) for item in document.objects}
    frames = tuple(sorted((_keyframe(item, objects) for item in document.frames), key=lambda item: item.frame))
    for object_id in (drawn.id for item in frames for drawn in item.drawn):
        objects.setdefault(object_id, DrawnObject(object_id, str(object_id)))
    name = document.name or printable(path.stem)
    return Keyframes(path, name, tuple(sorted(objects.values(), key=lambda item: item.id)), frames)


def file_number(recording: Recording, frame: int) -> Decimal | None:
    """Return the number in the name of a frame's color image; None if there is no file or no number."""
    name = recording.color_name(frame)
    found = NUMBER.search(Path(name).stem) if name else None
    return Decimal(found[0]) if found else None


def check_frames(keyframes: Keyframes, recording: Recording) -> None:
    """Refuse keyframes whose frames are not in the recording, or whose file numbers do not match it.

    Raises
    ------
    InputError
    """
    for item in keyframes.frames:
        if item.frame >= len(recording):
            has = f"{recording.path} has {len(recording)} frames"
            raise InputError(f"{keyframes.path}: has frame {item.frame}, but {has}; {COUNTING}")
        number = file_number(recording, item.frame)
        if None not in (number, item.number) and number != item.number:
            raise InputError(
                f"{keyframes.path}: frame {item.frame} is said to have the number {item.number}, but frame "
                f"{item.frame} of {recording.path} is {recording.color_name(item.frame)}; {COUNTING}"
            )


def _keyframe(item: KeyframeEntry, objects: dict[int, DrawnObject]) -> Keyframe:
    drawn = tuple(
        DrawnRect(
            box.id,
            np.array(box.rect, np.float64),
            box.visible,
            box.group or (box.id in objects and objects[box.id].group),
        )
        for box in item.boxes
    )
    number = None if item.number is None else Decimal(str(item.number))
    return Keyframe(item.frame, drawn, np.array(item.ignore or (), np.float64).reshape(-1, 4), number)
