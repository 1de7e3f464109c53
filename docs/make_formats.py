"""The page of file formats and the JSON Schemas, made from the program's own descriptions for `make_reference.py`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import msgspec

from cuboid.ground.formats.camera_file import CameraDocument
from cuboid.ground.formats.keyframes_file import KeyframesDocument
from cuboid.ground.formats.objects_file import ObjectsDocument
from cuboid.ground.formats.rig_file import RigDocument
from cuboid.ground.formats.rows_files import AgentEntry, BoxEntry, EventEntry, PoseEntry, ProposalEntry, TrackEntry
from cuboid.ground.formats.run_file import RunDocument
from cuboid.ground.formats.table_validation import Row, header_of
from cuboid.ground.formats.truth_file import TruthDocument
from cuboid.ground.formats.visits_file import VisitsDocument

# By the name under which people know the file.
DOCUMENTS: dict[str, type[msgspec.Struct]] = {
    "objects.json": ObjectsDocument,
    "run.json": RunDocument,
    "truth.json": TruthDocument,
    "camera.json": CameraDocument,
    "keyframes.json": KeyframesDocument,
    "visits.json": VisitsDocument,
    "rig.json": RigDocument,
}
TABLES: dict[str, type[Row]] = {
    "tracks.csv": TrackEntry,
    "proposals.csv": ProposalEntry,
    "events.csv": EventEntry,
    "agents.csv": AgentEntry,
    "trajectory.txt": PoseEntry,
    "boxes of another tracker (.csv)": BoxEntry,
}
DIALECT = "https://json-schema.org/draft/2020-12/schema"


def schema_of(kind: type[msgspec.Struct]) -> dict[str, Any]:
    """Return the JSON Schema of a document; of a row it is that of the list of its values."""
    return {"$schema": DIALECT, **msgspec.json.schema(kind)}


def markdown() -> str:
    """Return a page that describes each file."""
    parts = [HEAD]
    for name, kind in DOCUMENTS.items():
        found = msgspec.json.schema(kind)
        parts.append(f"## `{name}`\n\n{kind.__doc__}\n\n{_fields(found, kind.__name__)}")
        parts += [
            f"### {_title(part)}\n\n{found['$defs'][part]['description']}\n\n{_fields(found, part)}"
            for part in _parts_of(found, kind.__name__)
        ]
    for name, row in TABLES.items():
        found = msgspec.json.schema(row)["$defs"][row.__name__]
        separator = " " if name.endswith(".txt") else ","
        lines = ["| column | meaning |", "|---|---|"]
        for column, item in zip(row.__struct_fields__, found["prefixItems"], strict=True):
            lines.append(f"| `{column}` | {_what(item)} |")
        title, table = name if name.endswith(")") else f"`{name}`", "\n".join(lines)
        parts.append(f"## {title}\n\n{row.__doc__}\n\n```text\n{header_of(row, separator)}\n```\n\n{table}")
    return "\n\n".join(parts) + "\n"


HEAD = """# File formats

The program validates files by the descriptions on this page. The same descriptions as JSON Schemas:
[camera](schemas/camera.schema.json), [objects](schemas/objects.schema.json), [run](schemas/run.schema.json),
[truth](schemas/truth.schema.json), [keyframes](schemas/keyframes.schema.json), [visits](schemas/visits.schema.json),
[rig](schemas/rig.schema.json). A file that does not match is refused with a message of one line that names the field.

Numbers are finite. JSON documents have at most 64 MB. Fields that are not listed here are ignored, except in
`camera.json` and `rig.json`, where they are refused. Text files are UTF-8, with lines of at most 10,000 characters.
`map.ply` is a binary little-endian PLY with one element `vertex`: float `x y z`, uchar `red green blue`, float `heat`
(0 to 1) and int `label` (0: none), in this order.

Images are PNG or JPEG, with at most 64 megapixels and 256 MB. Only regular files are opened, no devices or FIFOs."""


def _parts_of(schema: dict[str, Any], name: str) -> Iterator[str]:
    """Yield the names of the parts of a document, each once, in their order."""
    seen: dict[str, None] = {}

    def walk(value: Any) -> None:
        if isinstance(value, dict):
            part = value.get("$ref", "").removeprefix("#/$defs/")
            if part and part not in seen:
                seen[part] = None
                walk(schema["$defs"][part])
            for item in value.values():
                walk(item)
        elif isinstance(value, list):
            for item in value:
                walk(item)

    walk(schema["$defs"][name])
    yield from seen


def _fields(schema: dict[str, Any], name: str) -> str:
    part = schema["$defs"][name]
    lines = ["| field | meaning |", "|---|---|"]
    for field, item in part["properties"].items():
        optional = "" if field in part.get("required", ()) else "; may be left out"
        lines.append(f"| `{field}` | {_what(item)}{optional} |")
    return "\n".join(lines)


def _what(item: dict[str, Any]) -> str:
    """Return the kind of a value, its range and its meaning."""
    kind, meaning = _kind(item), item.get("description", "")
    return f"{kind}: {meaning}" if meaning and meaning not in kind else kind


def _kind(item: dict[str, Any]) -> str:
    if "$ref" in item:
        return _title(item["$ref"].removeprefix("#/$defs/")).lower()
    if "anyOf" in item:
        kinds = dict.fromkeys(_kind(one) for one in item["anyOf"])
        return " or ".join(kinds)
    if "enum" in item:
        return " or ".join(f"`{value}`" if isinstance(value, str) else str(value) for value in item["enum"])
    match item.get("type"):
        case "array" if "prefixItems" in item:
            each = list(map(_kind, item["prefixItems"]))
            return f"{len(each)} x ({each[0]})" if len({*each}) == 1 else f"[{', '.join(each)}]"
        case "array":
            return f"list of {_kind(item['items'])}"
        case "object":
            values = item.get("additionalProperties", {})
            return "object" if "anyOf" in values else f"object, each value {_kind(values)}"
        case "number" | "integer":
            return ("number" if item["type"] == "number" else "whole number") + _range(item)
        case "string":
            return "text"
        case "boolean":
            return "true or false"
        case "null":
            return "null"
    return "anything"


def _range(item: dict[str, Any]) -> str:
    low, above, high = (item.get(name) for name in ("minimum", "exclusiveMinimum", "maximum"))
    if above is not None:
        return f" above {above:,g}, at most {high:,g}"
    return "" if low is None else f" {low:,g} to {high:,g}"


def _title(name: str) -> str:
    """Return the name of a part as people write it: PlaneEntry, BoxOfTruth are a plane, a box."""
    stem = name.removesuffix("Entry").removesuffix("OfTruth")
    return stem[:1] + "".join(f" {char.lower()}" if char.isupper() else char for char in stem[1:])
