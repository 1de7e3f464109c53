"""Makes the reference pages of the site from the program: commands, settings, files, exports, HTTP, stores, scenes.

MkDocs calls it when the site is built. ``python docs/make_reference.py FOLDER`` writes the same files into a folder.
"""

from __future__ import annotations

import argparse
import inspect
import json
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import fields
from importlib import import_module
from pathlib import Path
from typing import Any, get_type_hints

from make_formats import DOCUMENTS, markdown, schema_of
from make_tables import exports_table, store_tables

from cuboid.cli import GROUPS, description
from cuboid.cli.parser import Parser
from cuboid.fleet.store.asgi import PATHS as STORE_PATHS
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.state import Record
from cuboid.method.heatmap.kernels.cubes import ROW
from cuboid.runs.scene.codec import layout_of
from cuboid.runs.scene.saving import SceneState
from cuboid.runs.scene.schema import TABLES
from cuboid.services.queries.parameters import Parameter
from cuboid.services.service.endpoints import ENDPOINTS

Row = tuple[str, ...]


def files() -> dict[str, str]:
    """Return the content of each page and JSON Schema, by its path in the documentation."""
    pages = {
        "commands": commands(),
        "settings": settings(),
        "files": markdown(),
        "exports": f"# Forms of exports\n\n{exports_table()}",
        "http": http(),
        "store": f"# The tables of a store\n\n{STORE}\n\n{store_tables()}",
        "scene": scene(),
    }
    schemas = {
        f"schemas/{name.replace('.json', '.schema.json')}": json.dumps(schema_of(kind), indent=1) + "\n"
        for name, kind in DOCUMENTS.items()
    }
    return {f"reference/{name}.md": text for name, text in pages.items()} | {
        f"reference/{name}": text for name, text in schemas.items()
    }


def on_files(files_of_site: Any, config: Any) -> Any:
    """Add the pages to those of the site (called by MkDocs)."""
    from mkdocs.structure.files import File

    for path, text in files().items():
        files_of_site.append(File.generated(config, path, content=text))
    return files_of_site


def table(head: Row, rows: list[Row]) -> str:
    """Return a table of a page."""
    return "\n".join("| " + " | ".join(row) + " |" for row in (head, ("---",) * len(head), *rows)) + "\n"


# --- Commands and settings ------------------------------------------------------------------------------------------


def parser_of(command: str) -> Parser:
    """Return the parser of a command."""
    parser = Parser(prog=f"cuboid {command}", allow_abbrev=False)
    module = import_module(f"cuboid.cli.{command.replace(' ', '_')}")
    parser.example = module.EXAMPLE
    module.add_arguments(parser)
    return parser


def commands() -> str:
    """Return the page of commands, each with its arguments and options."""
    parts = [COMMANDS]
    for group, members in GROUPS.items():
        parts.append(f"## {group.capitalize()}\n")
        for command in members:
            parser = parser_of(command)
            parts.append(f"### `cuboid {command}`\n\n{description(command)}\n\n    {parser.example}\n")
            parts += list(options(parser))
    return "\n".join(parts)


def options(parser: argparse.ArgumentParser) -> Iterator[str]:
    """Yield the table of the arguments of a command, and of each of its verbs."""
    parser.format_help()  # appends the names that an option takes to its help
    formatter, rows = parser._get_formatter(), []
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, one in action.choices.items():
                yield f"#### `{parser.prog.removeprefix('cuboid ')} {name}`\n\n{one.description}\n"
                yield from options(one)
        elif not isinstance(action, argparse._HelpAction):
            value = formatter._format_args(action, action.metavar or action.dest) if action.nargs != 0 else ""
            words = ", ".join(action.option_strings)
            rows.append((f"`{f'{words} {value}'.strip()}`", formatter._expand_help(action) if action.help else ""))
    if rows:
        yield table(("argument", "purpose"), rows)


COMMANDS = """# Commands and options

`cuboid` alone lists the commands, `cuboid COMMAND --help` the options of one. A misspelt command or option is answered
with the nearest one, an incomplete call with the missing argument and an example. `python -m cuboid` is the same
program. [Results](../results.md#commands-in-general) has what all commands share: `--output`, `--json`, `--force`, and
the exit status.
"""


def settings() -> str:
    """Return the page of the tracker's settings."""
    meanings = attributes_of(TrackerConfig)
    rows = []
    for one in fields(TrackerConfig):
        low, high, unit = (one.metadata[key] for key in ("low", "high", "unit"))
        rows.append((f"`{one.name}`", f"{one.default:g} {unit}".strip(), f"{low:g} to {high:g}", meanings[one.name][1]))
    return f"# Settings of the tracker\n\n{SETTINGS}\n\n{table(('setting', 'default', 'range', 'meaning'), rows)}"


SETTINGS = """\
`--set NAME=VALUE` sets one of these, in Python `cuboid.TrackerConfig(NAME=VALUE)`. Unknown names and values out of
range are refused; `run.json` has the values of a run. [Tuning](../finds-nothing.md#tuning) tells which to change."""


def attributes_of(cls: type) -> dict[str, tuple[str, str]]:
    """Return type and meaning of each attribute that the docstring of a class describes."""
    found: dict[str, tuple[str, str]] = {}
    _, _, section = (inspect.getdoc(cls) or "").partition("Attributes\n----------\n")
    for entry in re.split(r"\n(?=\S)", section):
        head, _, meaning = entry.partition("\n")
        names, _, kind = head.partition(" : ")
        found |= {name: (kind, " ".join(meaning.split())) for name in names.split(", ")}
    return found


# --- HTTP -----------------------------------------------------------------------------------------------------------


def http() -> str:
    """Return the page of the addresses that a server answers."""
    known: dict[str, Parameter] = {}
    of_place = [(f"`{one.path}`", one.what, named(one.parameters, known), one.media) for one in ENDPOINTS]
    of_store = [(f"`{path}`", what, named(asked, known)) for path, (what, asked) in STORE_PATHS.items()]
    rows = [(f"`{name}`", one.meaning, f"`{example(one)}`" if example(one) else "") for name, one in known.items()]
    parts = [
        "# Addresses over HTTP\n",
        HTTP,
        "## A scene, results, a run\n",
        table(("address", "answer", "parameters", "type"), of_place),
        "## A store\n",
        table(("address", "answer", "parameters"), of_store),
        "## Parameters\n",
        table(("parameter", "meaning", "example"), rows),
    ]
    return "\n".join(parts)


def named(asked: Mapping[str, Parameter], known: dict[str, Parameter]) -> str:
    """Return the names of parameters, and add them to the known ones."""
    known |= {name: one for name, one in asked.items() if name not in known}
    return ", ".join(f"`{name}`" for name in asked)


def example(one: Parameter) -> str:
    """Return a value of a parameter, empty if none is given."""
    values = [one.schema.get("example"), one.schema.get("default"), *one.schema.get("enum", ())]
    return str(next((value for value in values if value is not None), ""))


HTTP = """\
[Questions and services](../questions.md#over-http) describes the server. `/openapi.json` of a running server has the
same for programs, with the types of all answers. A WebSocket at `/api/changes/live` sends each change as one JSON
message; `?after=N` begins with the changes after number N. `/report.html#LABEL` is the 3D page at an object, except
during a run.
"""


# --- Files ----------------------------------------------------------------------------------------------------------

STORE = """\
[Many recordings](../store.md) describes the store. Names of columns end with their unit. Boxes are as in
[objects.json](files.md#objectsjson): right-handed, metres, and the third axis is the normal of the supporting plane.
The key of a row is `run`; in `objects` it is `run` and `label`, and in `sightings` `run`, `label` and `frame`. The
columns `finished`, `stages`, `seconds` and `peak_memory_mb` of `runs` are measured; all other columns have the same
values for the same input."""


def scene() -> str:
    """Return the page of a scene file: its tables, the rows of the map, and the state of the tracker."""
    rows = [(f"`{name}`", ROWS[name], ", ".join(f"`{one}`" for one in kind.columns)) for name, kind in TABLES.items()]
    types = {name: kind for name, (kind, *_) in (ROW.fields or {}).items()}
    of_row = [
        (f"`{name}`", f"{kind.base} x {kind.shape[0]}" if kind.shape else f"{kind}") for name, kind in types.items()
    ]
    parts = ["# A scene file\n", SCENE, table(("table", "a row is", "columns"), rows)]
    parts += [BLOCKS, table(("field", "type"), of_row), STATE]
    for key, cls in records(SceneState):
        meaning = " ".join((inspect.getdoc(cls) or "").partition("\n\n")[0].split())
        parts += [f"### `{key}`\n\n{meaning}\n", table(("field", "type", "meaning"), list(state_fields(key, cls)))]
    return "\n".join(parts)


def records(cls: type[Record], key: str = "") -> Iterator[tuple[str, type[Record]]]:
    """Give the key and the class of each kind of record, an outer one first."""
    layout = layout_of(cls)
    if key:
        yield key, cls
    for name in layout.names:
        path = f"{key}/{name}" if key else name
        if name in layout.one:
            yield from records(layout.one[name], path)
        elif name in layout.many:
            yield from records(layout.many[name], f"{path}/N")


def state_fields(key: str, cls: type[Record]) -> Iterator[Row]:
    """Give the rows of the table of a record."""
    layout, described, hints = layout_of(cls), attributes_of(cls), get_type_hints(cls)
    for name in layout.names:
        kind, meaning = described.get(name, (getattr(hints[name], "__name__", str(hints[name])), ""))
        if name in layout.one:
            kind = f"row `{key}/{name}`"
        elif name in layout.many:
            kind = f"numbers of the rows `{key}/{name}/N`"
        yield f"`{name}`", kind.replace("|", "or"), meaning


SCENE = """\
[Scenes that last](../scene.md) describes scenes. The file is an SQLite database with the application id 0x43554244
("CUBD"); its `user_version` is that of the file, and other versions are refused. Its tables are `STRICT`. Any SQLite
client can read it; only Cuboid should write it. Lengths are metres, times seconds, quaternions and boxes as in [the
results](files.md). The world is that of the first recording. Frames in `objects` are numbered over the whole scene:
`first_frame` of the recording plus the number in it. Each value is checked when its row is read.
"""

ROWS = {
    "scene": "a fact about the whole, or about an object, by its key; `seal` is a check sum over `parts` and `arrays`",
    "relations": "a relation over recordings; `target` is a label, `plane#` with a plane's `identity`, or `wall`",
    "furniture": "the name of a piece of furniture",
    "recordings": "a recording; `next_frame` is where `--resume` continues",
    "frames": "a frame that has a pose, with its first pose",
    "planes": "a supporting plane; `outline` is JSON",
    "objects": "any label ever given; a present object whose `score` is below `min_probability` is shown as `unlikely`",
    "boxes": "a box that an object had",
    "sightings": "an object seen in a frame",
    "blocks": "at most 1024 points of the map, of one cube of 32 voxels a side; `cube` is its place, x, y, z + 2^20, "
    "21 bits each (of cubes of voxels with half the edge, less 2^63); `check_sum` is the CRC-32 of `data`, followed by "
    "`number` to `living`",
    "parts": "a part of [the state](#the-state), as MessagePack",
    "arrays": "a large array of the state",
    "pending": "rows of incomplete results",
    "known": "an object at the beginning of the last recording",
    "ground": "the seen region of a plane at that time",
    "occupied": "cells of 2 cm with points of no labelled object, at that time",
    "changes": "the state of an object after a recording; `sure` is the confidence, `before` and `after` are pictures",
    "events": "an event of an object while a recording watched it, at the frame that reported it",
    "embeddings": "the vector of an object (float32); `picture` is the check sum of its picture; null: views of a run",
}

BLOCKS = """## Rows of a block

`data` is zlib over the bytes of its rows: all first bytes, then all second bytes and so on. Where it has 36 bytes a
row, it is not compressed: a block that changes all the time is compressed later. Blocks use the frame of the map;
`tracker.T_world_map` in `arrays` transforms it to the world. `voxel` has 5 bits each for x, y, z, `place` is in
1/65,536 of the voxel's edge, `color` in 1/256 of a level, `heat` in 1/65,535. If `mark` is not 0, the row stands for
several voxels of a cell of two voxels a side, bit 4 x + 2 y + z for each; `voxel` is the first of the eight, and the
low and high byte of `place` are the position in the first and the second layer, in 1/256 of a voxel. `anchor` is the
number of a keyframe, or of a row `tracker/voxels/anchors/all/N` that names the keyframe; if that row has a `T_new_old`,
this transform moves the point to its corrected position.
"""

STATE = """## The state

The tables `parts` and `arrays` hold the state from which the tracker continues. Each row of `parts` is one of the
records below. Its `key` is a path, in which N is a number: `tracker/map/store/objects/17` is object 17. Its `fields`
are a MessagePack map from the name of a field to its value.

- An array is a list of its form (JSON: type, shape, and strides if it is not in C order) and its bytes.
- An array of more than 512 bytes is a row of `arrays`; the field holds the `path` of that row.
- A value with fields of its own, such as a `Box`, is a map of its fields.
- A record in a record is a row of its own. A field with several records lists their numbers.
"""


if __name__ == "__main__":
    for name, text in files().items():
        path = Path(sys.argv[1]) / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        print(path)
