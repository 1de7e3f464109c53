"""Names that people give to objects of finished results."""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from cuboid.ground.core.errors import InputError, shown
from cuboid.ground.core.results import TrackedObject
from cuboid.ground.formats.folder import EVENTS, OBJECTS, REPORT, TRACKS
from cuboid.method.objects.naming import chosen_name
from cuboid.results.files.gone import gone_labels
from cuboid.results.files.objects import ObjectsFile, read_objects, write_objects
from cuboid.results.files.pending import replacing, write_whole
from cuboid.results.files.rows import read_events, read_tracks

# Largest number of characters of a name, which is shown beside its label.
LONGEST_NAME = 100
# Number of names that a message lists.
SHOWN_NAMES = 8


def checked_name(where: object, name: str) -> str:
    """Return a name without surrounding space; an empty name stands for no name.

    Raises
    ------
    InputError
        The name is not a single line of at most `LONGEST_NAME` characters; the message begins with `where`.
    """
    name = name.strip()
    if not name.isprintable() or len(name) > LONGEST_NAME:
        raise InputError(f"{where}: a name is one line of at most {LONGEST_NAME} characters, got {shown(name)}")
    return name


def renamed_object(item: TrackedObject, name: str) -> TrackedObject:
    """Return an object with a name given by a user; with an empty name, the detector's class is its name again."""
    if name:
        return item.with_given_name(name)
    seen = () if item.name_score is None else ((item.name or "", item.name_score),)
    return dataclasses.replace(item, **chosen_name((*seen, *item.names)))


def name_object(folder: Path, label: int, name: str) -> None:
    """Set the name of an object, a gone one too, or of furniture of a result folder; an empty name removes it.

    Parameters
    ----------
    folder : Path
        Result folder of `cuboid track`; its `objects.json` is replaced, and its `report.html` if there is one.
    label : int
    name : str

    Raises
    ------
    InputError
        No object has the label, or the name is not a single line of at most `LONGEST_NAME` characters.
    OutputError
        The file cannot be written; it is unchanged.
    """
    path = folder / OBJECTS
    name = checked_name(path, name)
    found = read_objects(path)
    item = next((item for item in (*found.objects, *found.furniture) if item.label == label), None)
    if item is not None:
        named = renamed_object(item, name)
        objects, furniture = (
            tuple(named if other is item else other for other in entries)
            for entries in (found.objects, found.furniture)
        )
        changed, shown_name = dataclasses.replace(found, objects=objects, furniture=furniture), name_document(named)
    else:
        _refuse_unknown(folder, found, label)
        others = {one: text for one, text in found.gone_names.items() if one != label}
        changed = dataclasses.replace(found, gone_names=others | ({label: name} if name else {}))
        shown_name = {"name": name}
    with replacing(path) as partial:
        write_objects(partial, changed)
    report = folder / REPORT
    if report.is_file():
        write_whole(report, _renamed_page(report.read_text(encoding="utf-8"), label, shown_name))


def _refuse_unknown(folder: Path, found: ObjectsFile, label: int) -> None:
    """Raise InputError unless an object with the label left during the run."""
    events, merged = folder / EVENTS, {old for item in found.objects for old in item.merged_labels}
    left = gone_labels(read_events(events)) - merged if events.exists() else set()
    if label not in left or all(row.label != label for row in read_tracks(folder / TRACKS)):
        raise InputError(f"{folder / OBJECTS}: no object has the label {label}")


def name_document(item: TrackedObject) -> dict[str, Any]:
    """Return the name fields of an object for the page."""
    return {
        "name": item.name or "",
        "name_score": None if item.name_score is None else round(item.name_score, 2),
        "names": [[name, round(score, 2)] for name, score in item.names],
    }


def page_json(document: Mapping[str, Any]) -> str:
    """Return the data of a page as JSON without "<": "</script>" in a text would end the element."""
    return json.dumps(document, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def nameless(name: str) -> str:
    """Return the message that no object has a name, and how to give one."""
    return f"no object has a name yet; 'cuboid name DIR 1={name or 'bin'}' gives object 1 a name (also SCENE and STORE)"


def listed_names(names: Iterable[str]) -> str:
    """Return the names that exist as the end of a message: at most `SHOWN_NAMES` of them."""
    every = sorted(set(names))
    more = f" and {len(every) - SHOWN_NAMES} others" if len(every) > SHOWN_NAMES else ""
    return f"names: {', '.join(map(shown, every[:SHOWN_NAMES]))}{more}"


def _renamed_page(page: str, label: int, names: Mapping[str, Any]) -> str:
    """Return a page with the name of an object; a page without data of this program is returned unchanged."""
    found = re.search(r'(<script type="application/json" id="data">)(.*?)(</script>)', page, re.DOTALL)
    if found is None:
        return page
    document = json.loads(found[2])
    for entry in document["objects"]:
        if entry["label"] == label:
            entry.update(names)
    for entry in (*document["changes"], *document["gone"]):
        if entry["label"] == label:
            entry["name"] = names["name"]
    return page[: found.start(2)] + page_json(document) + page[found.end(2) :]
