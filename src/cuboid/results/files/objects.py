"""`objects.json`: the map of objects at the end of a run."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import structs

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.records import columns_of, plain_fields
from cuboid.ground.core.results import SUPPORT, MapPoints, Relation, SupportPlane, TrackedObject, Wall
from cuboid.ground.formats.json_validation import read_json
from cuboid.ground.formats.objects_file import FORMAT, VERSION, ObjectEntry, ObjectsDocument
from cuboid.ground.geometry.box import Box
from cuboid.results.files.text import DIRECTION, LENGTH, rounded, rounded_list


@dataclass(frozen=True, slots=True)
class ObjectsFile:
    """The contents of `objects.json`.

    Attributes
    ----------
    up : (3,) float64 or None
        Up in the world, a unit vector; None if neither a supporting plane nor the recording gives it.
    intrinsics : Intrinsics
        Of the recording's color image at its full size.
    planes : tuple of SupportPlane
    objects : tuple of TrackedObject
        By label; without furniture.
    walls : tuple of Wall
        Walls that objects may be against; empty unless relations were requested.
    furniture : tuple of TrackedObject
        The furniture under the supporting planes, by label; empty unless it was requested. The file has it among the
        objects, with the kind "support".
    gone_names : mapping of int to str
        Names of objects that left before the end of the run, by label.
    """

    up: Float64Array | None
    intrinsics: Intrinsics
    planes: tuple[SupportPlane, ...]
    objects: tuple[TrackedObject, ...]
    walls: tuple[Wall, ...] = ()
    furniture: tuple[TrackedObject, ...] = ()
    gone_names: Mapping[int, str] = field(default_factory=dict)

    def with_relations(self, points: MapPoints) -> ObjectsFile:
        """Return a copy with the relations of the objects, and with the walls that are found in the points.

        Furniture supports the objects that are on its planes.
        """
        from cuboid.method.relations import find_relations, find_walls

        walls = find_walls(points, self.up)
        found = find_relations(self.objects, self.planes, self.up, walls)
        objects = tuple(replace(item, relations=found[item.label]) for item in self.objects)
        furniture = tuple(replace(piece, relations=_supported(piece, found)) for piece in self.furniture)
        return replace(self, objects=objects, walls=walls, furniture=furniture)


def write_objects(path: Path, content: ObjectsFile) -> None:
    """Write `objects.json`.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    entries = (*content.objects, *content.furniture)
    gone = [{"label": label, "name": name} for label, name in sorted(content.gone_names.items())]
    document = {
        "format": FORMAT,
        "version": VERSION,
        "up": None if content.up is None else rounded_list(content.up, DIRECTION),
        "intrinsics": asdict(content.intrinsics),
        "planes": [surface_to_json(plane) for plane in content.planes],
        **({"walls": [surface_to_json(wall) for wall in content.walls]} if content.walls else {}),
        "objects": [object_to_json(item) for item in sorted(entries, key=lambda item: item.label)],
        **({"gone": gone} if gone else {}),
    }
    write_json(path, document)


def read_objects(path: Path) -> ObjectsFile:
    """Read `objects.json`.

    Raises
    ------
    InputError
        The file is missing, is of another format or version, or a field of it is malformed.
    """
    document = read_json(path, ObjectsDocument)
    entries = [_object(item) for item in document.objects]
    return ObjectsFile(
        up=None if document.up is None else np.array(document.up),
        intrinsics=Intrinsics(**structs.asdict(document.intrinsics)),
        planes=tuple(
            SupportPlane(np.array(plane.normal), plane.offset, np.array(plane.extent).reshape(-1, 3))
            for plane in document.planes
        ),
        objects=tuple(item for item in entries if item.kind != SUPPORT),
        walls=tuple(Wall(np.array(wall.normal), wall.offset, np.array(wall.extent)) for wall in document.walls),
        furniture=tuple(item for item in entries if item.kind == SUPPORT),
        gone_names={one.label: one.name for one in document.gone},
    )


def write_json(path: Path, document: dict[str, Any]) -> None:
    """Write a JSON document in the common layout: short lists on one line, no NaN."""
    path.write_text(_layout(document) + "\n", encoding="utf-8", errors="backslashreplace")


def _layout(value: Any, indent: int = 0) -> str:
    """Return JSON in which each value that fits into a line is on one line."""
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


def surface_to_json(plane: SupportPlane | Wall) -> dict[str, Any]:
    """Return a supporting plane or a wall as `objects.json` holds it."""
    return {
        "normal": rounded_list(plane.normal, DIRECTION),
        "offset": rounded(plane.offset, LENGTH),
        "extent": [rounded_list(point, LENGTH) for point in plane.extent],
    }


def object_to_json(item: TrackedObject) -> dict[str, Any]:
    """Return an object as `objects.json` holds it."""
    box = {
        "center": rounded_list(item.box.center, LENGTH),
        "size": rounded_list(item.box.size, LENGTH),
        "rotation": [rounded_list(row, DIRECTION) for row in item.box.rotation],
    }
    return {"label": item.label, **box, **plain_fields(item, columns_of(TrackedObject)[1:])}


def _object(item: ObjectEntry) -> TrackedObject:
    box = Box(np.array(item.center), np.array(item.size), np.array(item.rotation))
    columns = (column for column in columns_of(TrackedObject) if not column.repeats)
    return TrackedObject(box=box, **{column.name: column.read(getattr(item, column.name)) for column in columns})


def _supported(piece: TrackedObject, relations: Mapping[int, Sequence[Relation]]) -> tuple[Relation, ...]:
    """Return the relations of a piece of furniture: it supports the objects on its planes; the likeliest first."""
    tops = {f"plane:{k}" for k in piece.planes}
    scores: dict[int, float] = {}
    for label, of_object in relations.items():
        for relation in of_object:
            if relation.kind == "on" and relation.to in tops:
                scores[label] = max(scores.get(label, 0.0), relation.score)
    found = [Relation(label, "supports", score) for label, score in scores.items()]
    return tuple(sorted(found, key=lambda relation: (-relation.score, relation.to)))
