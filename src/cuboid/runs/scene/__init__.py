"""A persistent scene: one file per place holds its map, objects and labels; later recordings extend it."""

from __future__ import annotations

from cuboid.ground.core.results import SceneChange
from cuboid.runs.scene.answers import PastRelation, SceneEvent, SceneObject, ScenePast, SceneRecording
from cuboid.runs.scene.scene import Scene
from cuboid.runs.scene.session import SceneTracker
from cuboid.runs.scene.visit import RecordingInfo

__all__ = [
    "PastRelation",
    "RecordingInfo",
    "Scene",
    "SceneChange",
    "SceneEvent",
    "SceneObject",
    "ScenePast",
    "SceneRecording",
    "SceneTracker",
]
