"""The output of `cuboid scene --json`: objects and changes of a scene, ready for JSON."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cuboid.runs.scene import PastRelation, SceneChange, SceneEvent, SceneObject


def object_document(item: SceneObject) -> dict[str, Any]:
    """Return an object: its box in the world of the scene as in `objects.json`, and its first and last sighting."""
    from cuboid.results.files.objects import object_to_json

    return {
        **object_to_json(item),
        "name": item.name,
        "state": item.state,
        "merged_into": item.merged_into,
        "first_seen": dict(zip(("recording", "frame"), item.first_seen, strict=True)),
        "last_seen": dict(zip(("recording", "frame"), item.last_seen, strict=True)),
    }


def change_document(one: SceneChange) -> dict[str, Any]:
    """Return a change: old and new position in metres; null if the object was absent before or is absent now."""
    return _document(one, "recording", "label", "name", "change", "from_m", "to_m", "metres", "sure")


def event_document(one: SceneEvent) -> dict[str, Any]:
    """Return an event: appeared, moved, gone or back, with positions in metres."""
    return _document(one, "recording", "frame", "label", "event", "from_m", "to_m", "score")


def relation_document(one: PastRelation) -> dict[str, Any]:
    """Return a relation, as in `objects.json`, and the recordings over which it held."""
    return {"is": one.kind, **_document(one, "to", "first_recording", "last_recording", "score")}


def _document(one: SceneChange | SceneEvent | PastRelation, *fields: str) -> dict[str, Any]:
    from cuboid.results.files.text import plain

    return {name: plain(getattr(one, name)) for name in fields}
