"""A persistent scene: one file per place holds its map, objects and labels; later recordings extend it."""

from __future__ import annotations

from cuboid.core.results import SceneChange
from cuboid.scene.answers import PastRelation, SceneEvent, SceneObject, ScenePast, SceneRecording
from cuboid.scene.scene import Scene
from cuboid.scene.session import SceneTracker
from cuboid.scene.visit import Source

__all__ = [
    "PastRelation",
    "Scene",
    "SceneChange",
    "SceneEvent",
    "SceneObject",
    "ScenePast",
    "SceneRecording",
    "SceneTracker",
    "Source",
]
