"""Depth images of simple solids on a table, by formula: exact, without noise unless asked for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cuboid.ground.core.frame import Frame, Intrinsics

CAMERA = Intrinsics(530.0, 530.0, 319.5, 239.5, 640, 480)
# A camera 0.6 m above a table, looking down at 35 degrees: "up" in the camera frame.
UP = np.array([0.0, -np.cos(np.radians(35.0)), -np.sin(np.radians(35.0))])
HEIGHT = 0.6
Hit = np.ndarray[Any, np.dtype[np.float64]]


def rays(camera: Intrinsics = CAMERA) -> Hit:
    """Rays (H, W, 3) with z = 1, so that a distance along one is a depth."""
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    return camera.points(u, v, np.ones(u.shape))


def on_table(right: float, ahead: float, above: float) -> Hit:
    """A point in the camera frame from its place on the table, metres."""
    forward = np.cross(UP, [1.0, 0.0, 0.0])
    forward = forward * np.sign(forward[2])
    return np.array([right, 0.0, 0.0]) + ahead * forward + (above - HEIGHT) * UP


def axes(turn: float = 0.0) -> Hit:
    """Rows: two axes along the table, turned about its normal, and the normal."""
    forward = np.cross(UP, [1.0, 0.0, 0.0])
    forward = forward * np.sign(forward[2])
    right = np.array([1.0, 0.0, 0.0])
    return np.stack([np.cos(turn) * right + np.sin(turn) * forward, np.cos(turn) * forward - np.sin(turn) * right, UP])


def plane(r: Hit, normal: Hit, offset: float) -> Hit:
    """Depth of the plane normal . p + offset = 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        t = -offset / (r @ normal)
    return np.where(t > 0, t, np.inf)


def sphere(r: Hit, center: Hit, radius: float) -> Hit:
    a, b, c = (r * r).sum(-1), r @ center, center @ center - radius**2
    root = b * b - a * c
    return np.where(root >= 0, (b - np.sqrt(np.maximum(root, 0))) / a, np.inf)


def box(r: Hit, center: Hit, size: Sequence[float], turn: float) -> Hit:
    directions, origin = r @ axes(turn).T, -axes(turn) @ center
    half = np.asarray(size) / 2.0
    with np.errstate(divide="ignore", invalid="ignore"):
        one, two = (-half - origin) / directions, (half - origin) / directions
    near, far = np.minimum(one, two).max(-1), np.maximum(one, two).min(-1)
    return np.where((near <= far) & (near > 0), near, np.inf)


def cup(r: Hit, foot: Hit, radius: float, height: float) -> Hit:
    """An open cylinder with a floor 5 mm above the table: outside, inside and bottom."""
    directions, origin = r @ axes().T, -axes() @ foot
    a = (directions[..., :2] ** 2).sum(-1)
    b, c = directions[..., :2] @ origin[:2], origin[:2] @ origin[:2] - radius**2
    root = b * b - a * c
    best = np.full(r.shape[:2], np.inf)
    for sign in (-1.0, 1.0):
        t = (-b + sign * np.sqrt(np.maximum(root, 0))) / a
        z = origin[2] + t * directions[..., 2]
        best = np.where((root >= 0) & (t > 0) & (z >= 0) & (z <= height) & (t < best), t, best)
    t = (0.005 - origin[2]) / directions[..., 2]
    inside = ((origin[:2] + t[..., None] * directions[..., :2]) ** 2).sum(-1) <= radius**2
    return np.where(inside & (t > 0) & (t < best), t, best)


def frame(things: Sequence[Hit], noise: float = 0.0, camera: Intrinsics = CAMERA) -> tuple[Frame, Hit]:
    """The table, a floor 0.7 m below it, and things on it; and which thing each pixel shows (0: none)."""
    r = rays(camera)
    table = plane(r, UP, HEIGHT)
    place = (r * table[..., None]) @ axes()[:2].T
    with np.errstate(invalid="ignore"):
        table = np.where((np.abs(place[..., 0]) < 0.6) & (place[..., 1] < 1.3), table, np.inf)
    layers = np.stack([np.minimum(table, plane(r, UP, HEIGHT + 0.7)), *things])
    depth = layers.min(axis=0)
    owner = np.where(np.isfinite(depth), layers.argmin(axis=0), 0)
    depth = np.where(np.isfinite(depth) & (depth < 8.0), depth, 0.0)
    if noise:
        rng = np.random.default_rng(7)
        with np.errstate(divide="ignore"):
            inverse = 1.0 / depth + noise * rng.standard_normal(depth.shape)
        depth = np.where((depth > 0) & (inverse > 0.1), 1.0 / inverse, 0.0)
    color = np.full((*depth.shape, 3), 128, np.uint8)
    color[owner > 0] = (200, 60, 40)
    return Frame(0, 0.0, color, depth.astype(np.float32)), owner
