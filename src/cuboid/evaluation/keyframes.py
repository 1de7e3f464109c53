"""Keyframes: rectangles with identities that a person drew into some frames of a recording.

``docs/evaluation.md`` describes the format, "cuboid-keyframes" version 1.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Any

import numpy as np

from cuboid.errors import InputError
from cuboid.frame import Float64Array
from cuboid.outputs.objects import read_json
from cuboid.readers.recording import Recording

FORMAT, VERSION = "cuboid-keyframes", 1
# A frame's number in the name of its file: the first there is, which may be a time.
NUMBER = re.compile(r"\d+(?:\.\d+)?")
COUNTING = "'frame' counts the recording's frames from 0, whatever their files are called"


@dataclass(frozen=True, slots=True)
class DrawnObject:
    """A thing that a person told apart.

    Attributes
    ----------
    id : int
        Positive, its own.
    name : str
        For people.
    group : bool
        Whether it is several things that may as well be one.
    """

    id: int
    name: str
    group: bool = False


@dataclass(frozen=True, slots=True)
class DrawnRect:
    """Where a thing is in a frame.

    Attributes
    ----------
    id : int
        Of its object.
    rect_xyxy : (4,) float64
        Tight around what is seen of it, pixels of the recording's full size, ends exclusive.
    visible : float
        Share of it that is seen, 0..1.
    group : bool
        Whether it is several things that may as well be one.
    """

    id: int
    rect_xyxy: Float64Array
    visible: float
    group: bool


@dataclass(frozen=True, slots=True)
class Keyframe:
    """A frame that was drawn on.

    Attributes
    ----------
    frame : int
        Place of the frame in its recording, from 0, as results count.
    drawn : tuple of DrawnRect
    ignored : (N, 4) float64
        Rectangles in which finding something counts neither way.
    number : Decimal or None
        The number in the name of the frame's file, where the keyframes give it.
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
    """What a file of keyframes says.

    Attributes
    ----------
    path : Path
    name : str
    objects : tuple of DrawnObject
        By id.
    frames : tuple of Keyframe
        In the recording's order.
    """

    path: Path
    name: str
    objects: tuple[DrawnObject, ...]
    frames: tuple[Keyframe, ...]


def is_keyframes(path: Path) -> bool:
    """Tell whether a file says that it holds keyframes; InputError where it is no JSON object."""
    return path.is_file() and read_json(path).get("format") == FORMAT


def read_keyframes(path: Path) -> Keyframes:
    """Read a file of keyframes.

    Raises
    ------
    InputError
        The file is missing, is of another format, or a field is missing or malformed; the message names file and
        frame.
    """
    return keyframes_from_json(path, read_json(path))


def keyframes_from_json(path: Path, document: dict[str, Any]) -> Keyframes:
    """Return the keyframes that a document holds; `path` is for messages. Raises InputError as `read_keyframes`."""
    if document.get("format") != FORMAT or document.get("version") != VERSION:
        raise InputError(
            f"{path}: expected format '{FORMAT}' version {VERSION}, "
            f"got '{document.get('format')}' version {document.get('version')}"
        )
    where = str(path)
    try:
        objects = {item.id: item for item in map(_object, document["objects"])}
        if len(objects) < len(document["objects"]):
            raise ValueError("two objects have the same id")
        frames: list[Keyframe] = []
        for item in document["frames"]:
            where = f"{path}: frame {item['frame']}"
            frames.append(_keyframe(item, objects))
        where = str(path)
    except KeyError as error:
        raise InputError(f"{where}: field {error} is missing") from error
    except (TypeError, ValueError, AttributeError, InvalidOperation) as error:
        raise InputError(f"{where}: a field is malformed: {error}") from error
    if len({item.frame for item in frames}) < len(frames):
        raise InputError(f"{path}: a frame stands there twice")
    for known in (drawn.id for item in frames for drawn in item.drawn):
        objects.setdefault(known, DrawnObject(known, str(known)))
    return Keyframes(
        path,
        str(document.get("name", path.stem)),
        tuple(sorted(objects.values(), key=lambda item: item.id)),
        tuple(sorted(frames, key=lambda item: item.frame)),
    )


def file_number(recording: Recording, frame: int) -> Decimal | None:
    """Return the number in the name of a frame's color image; None where it has no file or the name no number."""
    name = recording.color_name(frame)
    found = NUMBER.search(Path(name).stem) if name else None
    return Decimal(found[0]) if found else None


def check_frames(keyframes: Keyframes, recording: Recording) -> None:
    """Refuse keyframes whose frames the recording does not have, or has other files for than they say.

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


def _object(item: dict[str, Any]) -> DrawnObject:
    number = _whole(item["id"], "id", least=1)
    return DrawnObject(number, str(item.get("name", number)), bool(item.get("group", False)))


def _keyframe(item: dict[str, Any], objects: dict[int, DrawnObject]) -> Keyframe:
    drawn = tuple(_drawn(box, objects) for box in item["boxes"])
    if len({one.id for one in drawn}) < len(drawn):
        raise ValueError("an id stands there twice")
    ignored = np.array([_rect(rect) for rect in item.get("ignore") or ()]).reshape(-1, 4)
    number = Decimal(str(item["number"])) if item.get("number") is not None else None
    return Keyframe(_whole(item["frame"], "frame", least=0), drawn, ignored, number)


def _drawn(item: dict[str, Any], objects: dict[int, DrawnObject]) -> DrawnRect:
    number = _whole(item["id"], "id", least=1)
    visible = float(item.get("visible", 1.0))
    if not 0 <= visible <= 1:
        raise ValueError(f"visible of id {number}: expected 0 to 1, got {visible:g}")
    group = bool(item.get("group", False)) or (number in objects and objects[number].group)
    return DrawnRect(number, _rect(item["rect"]), visible, group)


def _rect(value: Any) -> Float64Array:
    rect = np.array(value, np.float64)
    if rect.shape != (4,) or not np.isfinite(rect).all() or not (rect[2:] > rect[:2]).all():
        raise ValueError(f"expected a rectangle [x0, y0, x1, y1] with x0 < x1 and y0 < y1, got {value}")
    return rect


def _whole(value: Any, name: str, least: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise ValueError(f"{name}: expected a whole number of at least {least}, got {value!r}")
    return value
