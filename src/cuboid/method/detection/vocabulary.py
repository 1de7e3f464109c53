"""Class names of a model: from its metadata, a file beside it, or COCO if the number of classes matches."""

from __future__ import annotations

import ast
import json
from collections.abc import Mapping
from pathlib import Path

from cuboid.ground.core.errors import InputError, shown

# Keys of a model's metadata under which exporters store the names.
METADATA_KEYS = ("names", "labels", "classes", "id2label")
# Files of names beside a model MODEL.onnx, in this order.
BESIDE = ("{stem}.txt", "{stem}.names", "{stem}.json", "labels.txt", "classes.txt")
# Maximum size of a file of names, bytes.
MAX_NAMES_BYTES = 1 << 20

COCO = (
    "person", "bicycle", "car", "motorcycle", "airplane", "bus", "train", "truck", "boat", "traffic light",
    "fire hydrant", "stop sign", "parking meter", "bench", "bird", "cat", "dog", "horse", "sheep", "cow", "elephant",
    "bear", "zebra", "giraffe", "backpack", "umbrella", "handbag", "tie", "suitcase", "frisbee", "skis", "snowboard",
    "sports ball", "kite", "baseball bat", "baseball glove", "skateboard", "surfboard", "tennis racket", "bottle",
    "wine glass", "cup", "fork", "knife", "spoon", "bowl", "banana", "apple", "sandwich", "orange", "broccoli",
    "carrot", "hot dog", "pizza", "donut", "cake", "chair", "couch", "potted plant", "bed", "dining table", "toilet",
    "tv", "laptop", "mouse", "remote", "keyboard", "cell phone", "microwave", "oven", "toaster", "sink",
    "refrigerator", "book", "clock", "vase", "scissors", "teddy bear", "hair drier", "toothbrush",
)  # fmt: skip
# COCO numbers its 80 classes from 1 to 90; these numbers are unused.
COCO_UNUSED = frozenset({12, 26, 29, 30, 45, 66, 68, 69, 71, 83})
COCO_SLOTS = 91


def coco_by_id() -> tuple[str, ...]:
    """Return the name of each COCO number from 0 to 90, empty if unused, for models with 91 class slots."""
    left = iter(COCO)
    return tuple("" if k == 0 or k in COCO_UNUSED else next(left) for k in range(COCO_SLOTS))


def known_names(model: Path, metadata: Mapping[str, str], file: Path | None) -> tuple[str, ...] | None:
    """Return the names from the user, the model or a file beside it; None if there are none.

    Parameters
    ----------
    model : Path
    metadata : mapping of str to str
        Metadata of the model.
    file : Path or None
        The user's file of names.

    Raises
    ------
    InputError
        A file contains no list of names.
    """
    if file is not None:
        return read_names(file)
    for key in METADATA_KEYS:
        if key in metadata:
            names = parse_names(metadata[key])
            if names:
                return names
    for pattern in BESIDE:
        beside = model.with_name(pattern.format(stem=model.stem))
        if beside.is_file():
            return read_names(beside)
    return None


def names_for(count: int, class_names: tuple[str, ...] | None, model: Path) -> tuple[str, ...]:
    """Return a name for each of `count` classes.

    If no names are known, 80 classes and 91 slots are COCO's. A model may have one more slot than names: the last slot
    is then the background, with the empty name.

    Raises
    ------
    InputError
        There are more or fewer names than classes.
    """
    if class_names is None:
        if count == COCO_SLOTS:
            return coco_by_id()
        named = COCO if count >= len(COCO) else ()
        return (*named, *(f"class {k}" for k in range(len(named), count)))
    if len(class_names) == count:
        return class_names
    if len(class_names) == count - 1:
        return (*class_names, "")
    raise InputError(
        f"{model}: has {count} classes, but there are {len(class_names)} names; name a file with labels=FILE"
    )


def read_names(path: Path) -> tuple[str, ...]:
    """Return the names in a file: one per line, or JSON.

    Raises
    ------
    InputError
        The file cannot be read or contains no names.
    """
    try:
        if path.stat().st_size > MAX_NAMES_BYTES:
            raise InputError(f"{path}: is no list of class names: larger than {MAX_NAMES_BYTES >> 20} MB")
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read as a list of class names: {error}") from None
    names = parse_names(text)
    if not names:
        raise InputError(f"{path}: holds no class names; one a line, or JSON, expected")
    return names


def parse_names(text: str) -> tuple[str, ...]:
    """Return the names in a text: one per line, a list, or a mapping from number to name (JSON or Python syntax).

    Raises
    ------
    InputError
        A mapping does not number its names from 0.
    """
    text = text.strip()
    if text[:1] in ("{", "["):
        return _of_document(_document(text))
    return tuple(line.strip() for line in text.splitlines() if line.strip())


def _document(text: str) -> object:
    try:
        return json.loads(text)
    except ValueError:
        pass
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError, MemoryError, RecursionError):
        return None


def _of_document(document: object) -> tuple[str, ...]:
    if isinstance(document, dict) and isinstance(document.get("id2label"), dict):
        document = document["id2label"]
    if isinstance(document, list):
        return tuple(str(name) for name in document)
    if not isinstance(document, dict):
        return ()
    try:
        numbered = {int(number): str(name) for number, name in document.items()}
    except (TypeError, ValueError):
        return ()
    if not numbered or min(numbered) < 0 or max(numbered) > 10 * len(numbered):
        raise InputError(f"class names must be numbered from 0, got {shown(sorted(numbered))}")
    return tuple(numbered.get(k, "") for k in range(max(numbered) + 1))
