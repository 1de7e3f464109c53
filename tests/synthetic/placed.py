"""Scenes with their objects in place, made once for all tests that look at the objects alone."""

from __future__ import annotations

from functools import cache

from cuboid.lab.synthetic import Scene, make_scene


@cache
def scene_of(kind: str, seed: int) -> Scene:
    return make_scene(kind, seed, frames=3)
