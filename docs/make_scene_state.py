"""Make docs/scene-state.md from the states that a scene file holds: ``python docs/make_scene_state.py``."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import get_type_hints

from cuboid.ground.core.state import Record
from cuboid.runs.scene.codec import layout_of
from cuboid.runs.scene.saving import SceneState

PAGE = Path(__file__).resolve().parent / "scene-state.md"
HEAD = """# The state in a scene file

The tables `parts` and `arrays` of [a scene file](scene.md#the-file) hold the state from which the tracker continues,
except for the points of the map. Each row of `parts` is one of the records below. Its `key` is a path, in which N is a
number: `tracker/map/store/objects/17` is object 17. Its `fields` are a MessagePack map from the name of a field to its
value.

- An array is a list of its form (JSON: type, shape, and strides if it is not in C order) and its bytes.
- An array of more than 512 bytes is a row of `arrays`; the field holds the `path` of that row.
- A value with fields of its own, such as a `Box`, is a map of its fields.
- A record in a record is a row of its own. A field with several records lists their numbers.

`python docs/make_scene_state.py` makes this page from the classes.
"""


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


def attributes_of(cls: type[Record]) -> dict[str, tuple[str, str]]:
    """Return type and meaning of each attribute that the docstring of a class describes."""
    found: dict[str, tuple[str, str]] = {}
    _, _, section = (inspect.getdoc(cls) or "").partition("Attributes\n----------\n")
    for entry in re.split(r"\n(?=\S)", section):
        head, _, meaning = entry.partition("\n")
        names, _, kind = head.partition(" : ")
        found |= {name: (kind, " ".join(meaning.split())) for name in names.split(", ")}
    return found


def markdown() -> str:
    """Return the page."""
    parts = [HEAD]
    for key, cls in records(SceneState):
        layout, described, hints = layout_of(cls), attributes_of(cls), get_type_hints(cls)
        lines = [f"## `{key}`", "", (inspect.getdoc(cls) or "").partition("\n\n")[0].replace("\n", " "), ""]
        lines += ["| field | type | meaning |", "|---|---|---|"]
        for name in layout.names:
            kind, meaning = described.get(name, (getattr(hints[name], "__name__", str(hints[name])), ""))
            if name in layout.one:
                kind = f"row `{key}/{name}`"
            elif name in layout.many:
                kind = f"numbers of the rows `{key}/{name}/N`"
            lines.append(f"| `{name}` | {kind.replace('|', 'or')} | {meaning} |")
        parts.append("\n".join(lines) + "\n")
    return "\n".join(parts)


if __name__ == "__main__":
    PAGE.write_text(markdown(), encoding="utf-8")
    print(PAGE)
