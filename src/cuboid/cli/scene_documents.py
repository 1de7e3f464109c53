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
    from cuboid.results.files.text import LENGTH, rounded

    return {
        "recording": one.recording,
        "label": one.label,
        "name": one.name,
        "change": one.change,
        **_places(one),
        "metres": None if one.metres is None else rounded(one.metres, LENGTH),
        "sure": rounded(one.sure, LENGTH),
    }


def event_document(one: SceneEvent) -> dict[str, Any]:
    """Return an event of an object: positions in metres; null where the object was or is not there."""
    from cuboid.results.files.text import LENGTH, rounded

    return {
        "recording": one.recording,
        "frame": one.frame,
        "label": one.label,
        "event": one.event,
        **_places(one),
        "score": rounded(one.score, LENGTH),
    }


def _places(one: SceneChange | SceneEvent) -> dict[str, Any]:
    """Return the old and the new position in metres."""
    from cuboid.results.files.text import LENGTH, rounded_list

    places = {"from_m": one.from_m, "to_m": one.to_m}
    return {name: None if place is None else rounded_list(place, LENGTH) for name, place in places.items()}


def relation_document(one: PastRelation) -> dict[str, Any]:
    """Return a relation, and the first and last recording at whose end it held."""
    from cuboid.results.files.text import LENGTH, rounded

    return {
        "is": one.kind,
        "to": one.to,
        "first_recording": one.first_recording,
        "last_recording": one.last_recording,
        "score": rounded(one.score, LENGTH),
    }
