"""`objects.json`: the map of objects at the end of a run."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cuboid.errors import InputError
from cuboid.frame import Float64Array, Intrinsics
from cuboid.geometry.box import Box
from cuboid.outputs.text import DIRECTION, LENGTH, rounded, rounded_list
from cuboid.results import SupportPlane, TrackedObject

FORMAT = "cuboid-objects"
VERSION = 1


@dataclass(frozen=True, slots=True)
class ObjectsFile:
    """What `objects.json` holds.

    Attributes
    ----------
    up : (3,) float64 or None
        Up in the world; None where no supporting plane was found and nothing else told.
    intrinsics : Intrinsics
        Of the recording's color image at its full size.
    planes : tuple of SupportPlane
    objects : tuple of TrackedObject
        By label.
    """

    up: Float64Array | None
    intrinsics: Intrinsics
    planes: tuple[SupportPlane, ...]
    objects: tuple[TrackedObject, ...]


def write_objects(path: Path, content: ObjectsFile) -> None:
    """Write `objects.json`.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    K = content.intrinsics
    document = {
        "format": FORMAT,
        "version": VERSION,
        "up": None if content.up is None else rounded_list(content.up, DIRECTION),
        "intrinsics": {
            "fx": K.fx,
            "fy": K.fy,
            "cx": K.cx,
            "cy": K.cy,
            "width": K.width,
            "height": K.height,
        },
        "planes": [_plane_to_json(plane) for plane in content.planes],
        "objects": [_object_to_json(item) for item in sorted(content.objects, key=lambda item: item.label)],
    }
    write_json(path, document)


def read_objects(path: Path) -> ObjectsFile:
    """Read `objects.json`.

    Raises
    ------
    InputError
        The file is missing, is not JSON, is of another format or version, or lacks a field.
    """
    document = read_json(path)
    if document.get("format") != FORMAT or document.get("version") != VERSION:
        raise InputError(
            f"{path}: expected format '{FORMAT}' version {VERSION}, "
            f"got '{document.get('format')}' version {document.get('version')}"
        )
    try:
        return ObjectsFile(
            up=None if document["up"] is None else np.array(document["up"], dtype=np.float64),
            intrinsics=Intrinsics(**document["intrinsics"]),
            planes=tuple(
                SupportPlane(
                    np.array(plane["normal"], dtype=np.float64),
                    float(plane["offset"]),
                    np.array(plane["extent"], dtype=np.float64).reshape(-1, 3),
                )
                for plane in document["planes"]
            ),
            objects=tuple(_object_from_json(item) for item in document["objects"]),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: a field is missing or malformed: {error!r}") from error


def write_json(path: Path, document: dict[str, Any]) -> None:
    """Write a JSON document the way all of ours are written: short lists on one line, no NaN."""
    path.write_text(_layout(document) + "\n", encoding="utf-8")


def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON object.

    Raises
    ------
    InputError
        The file is missing, unreadable, or no JSON object.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise InputError(f"{path}: is not JSON: {error}") from error
    if not isinstance(document, dict):
        raise InputError(f"{path}: expected a JSON object")
    return document


def _layout(value: Any, indent: int = 0) -> str:
    """Return JSON with what fits into a line on one line."""
    flat = json.dumps(value, allow_nan=False, ensure_ascii=False)
    if len(flat) + indent <= 100 or not isinstance(value, dict | list) or not value:
        return flat
    pad = " " * (indent + 1)
    if isinstance(value, dict):
        parts = [f"{json.dumps(key)}: {_layout(item, indent + 1)}" for key, item in value.items()]
        opening, closing = "{", "}"
    else:
        parts = [_layout(item, indent + 1) for item in value]
        opening, closing = "[", "]"
    return f"{opening}\n{pad}" + f",\n{pad}".join(parts) + f"\n{' ' * indent}{closing}"


def _plane_to_json(plane: SupportPlane) -> dict[str, Any]:
    return {
        "normal": rounded_list(plane.normal, DIRECTION),
        "offset": rounded(plane.offset, LENGTH),
        "extent": [rounded_list(point, LENGTH) for point in plane.extent],
    }


def _object_to_json(item: TrackedObject) -> dict[str, Any]:
    return {
        "label": item.label,
        "center": rounded_list(item.box.center, LENGTH),
        "size": rounded_list(item.box.size, LENGTH),
        "rotation": [rounded_list(row, DIRECTION) for row in item.box.rotation],
        "score": rounded(item.score, LENGTH),
        "heat": rounded(item.heat, LENGTH),
        "first_frame": item.first_frame,
        "last_frame": item.last_frame,
        "frames_seen": item.frames_seen,
        "points": item.points,
        "mean_color": rounded_list(item.mean_color, 1),
        "plane": item.plane,
        "merged_labels": list(item.merged_labels),
    }


def _object_from_json(item: dict[str, Any]) -> TrackedObject:
    vector = {name: np.array(item[name], dtype=np.float64) for name in ("center", "size", "rotation", "mean_color")}
    return TrackedObject(
        label=int(item["label"]),
        box=Box(vector["center"], vector["size"], vector["rotation"]),
        score=float(item["score"]),
        heat=float(item["heat"]),
        first_frame=int(item["first_frame"]),
        last_frame=int(item["last_frame"]),
        frames_seen=int(item["frames_seen"]),
        points=int(item["points"]),
        mean_color=vector["mean_color"],
        plane=None if item["plane"] is None else int(item["plane"]),
        merged_labels=tuple(int(label) for label in item["merged_labels"]),
    )
