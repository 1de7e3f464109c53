"""Every field of every class that a scene saves is in its state, or said not to be saved."""

from __future__ import annotations

import dataclasses
from typing import Any, get_type_hints

import pytest
from made_scene import CAMERA, Shown

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.state import TRANSIENT, Record, saved_fields, snapshot
from cuboid.method.surfaces.plane import Plane
from cuboid.runs.scene.codec import Encoder, decode, layout_of, take
from cuboid.runs.scene.localisation import SAME_WORLD, ScenePoses
from cuboid.runs.scene.saving import SceneState
from cuboid.runs.tracking.posed_tracker import PosedTracker


def scene() -> tuple[PosedTracker, ScenePoses]:
    """Return tracker and poses of a scene that some frames were taken in."""
    shown = Shown()
    tracker, poses = PosedTracker(CAMERA, proposals=shown.proposals), ScenePoses(CAMERA, TrackerConfig())
    poses.begin(SAME_WORLD, first=True)
    for frame in shown.frames:
        poses.take(frame)
        tracker.update(frame, anchor=1)
    return tracker, poses


def stateful(item: Any) -> list[Any]:
    """Return an object and all others in it that have a state or are one."""
    found, waiting = {}, [item]
    while waiting:
        one = waiting.pop()
        if id(one) in found or not (hasattr(one, "state") or isinstance(one, Record)):
            continue
        found[id(one)] = one
        names = saved_fields(type(one)) if isinstance(one, Record) else vars(one)
        for name in names:
            value = getattr(one, name)
            waiting += value.values() if isinstance(value, dict) else value if isinstance(value, list) else [value]
    return list(found.values())


def record_classes(cls: type[Record]) -> list[type[Record]]:
    """Return a class of records, and all that are in its records."""
    layout = layout_of(cls)
    return [cls, *(one for kind in {**layout.one, **layout.many}.values() for one in record_classes(kind))]


def unsaved(item: Any) -> set[str]:
    """Return the attributes of an object that are neither in its state nor said not to be saved."""
    saved = {one.name for one in dataclasses.fields(get_type_hints(type(item).state)["return"])}
    return {name for name in vars(item) if name.removeprefix("_") not in saved and name not in type(item).NOT_SAVED}


def test_each_attribute_is_saved_or_said_not_to_be() -> None:
    found = [item for root in scene() for item in stateful(root) if not isinstance(item, Record)]
    assert {type(item).__name__ for item in found} == {
        "PosedTracker",
        "PlaneTracker",
        "VoxelMap",
        "StoredPoints",
        "Levels",
        "RowBlocks",
        "Anchors",
        "ObjectMap",
        "ObjectStore",
        "Affinity",
        "ScenePoses",
        "PoseEstimator",
        "Atlas",
    }
    for item in found:
        assert unsaved(item) == set(), type(item).__name__
        assert vars(item).keys() >= type(item).NOT_SAVED, f"{type(item).__name__} has no such attribute"


def test_a_new_attribute_is_noticed() -> None:
    tracker = PosedTracker(CAMERA)
    tracker._map.store.strange = 1  # type: ignore[attr-defined]
    assert unsaved(tracker._map.store) == {"strange"}


def test_records_are_saved_whole() -> None:
    """Dataclasses that are their own state have no attribute but their fields; those not saved have a default."""
    records = [cls for cls in record_classes(SceneState) if not cls.__name__.endswith("State")]
    assert {cls.__name__ for cls in records} == {
        "UpVote",
        "Windows",
        "Plane",
        "GroundPlan",
        "Anchor",
        "MapObject",
        "Keyframe",
    }
    for cls in records:
        fields: Any = dataclasses.fields(cls)  # type: ignore[arg-type]
        assert "__dict__" not in dir(cls), f"{cls.__name__} may have attributes that are no fields"
        assert {one.name for one in fields} == {
            name for base in cls.__mro__ for name in getattr(base, "__slots__", ())
        } - {"_snapshot"}
        for one in fields:
            assert one.metadata != TRANSIENT or one.default is not dataclasses.MISSING, one.name


def test_what_is_saved_is_what_is_loaded() -> None:
    tracker, poses = scene()
    parts = Encoder().parts(take(SceneState(tracker.state(), poses.state())))
    assert any(part.arrays for part in parts.values())
    again = Encoder().parts(take(decode(SceneState, parts)))
    assert repr(again) == repr(parts)
    other = ScenePoses.from_state(decode(SceneState, parts).poses, CAMERA)
    loaded = PosedTracker.from_state(decode(SceneState, parts).tracker, CAMERA)
    assert repr(Encoder().parts(take(SceneState(loaded.state(), other.state())))) == repr(parts)


def test_what_cannot_be_saved_is_refused() -> None:
    plane = Plane(0, 7, offset=object())  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"Plane\.offset cannot be saved: it holds a object"):
        Encoder().parts(take(snapshot(plane)))
