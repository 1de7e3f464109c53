"""A scene that lasts: one file a place, with its map, its objects and their labels, opened again and gone on with."""

from __future__ import annotations

from cuboid.core.results import SceneChange
from cuboid.scene.answers import PastRelation, SceneObject, ScenePast, SceneRecording
from cuboid.scene.scene import Scene
from cuboid.scene.session import SceneTracker
from cuboid.scene.visit import Source

__all__ = [
    "PastRelation",
    "Scene",
    "SceneChange",
    "SceneObject",
    "ScenePast",
    "SceneRecording",
    "SceneTracker",
    "Source",
]
