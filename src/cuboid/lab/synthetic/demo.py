"""The scene of `cuboid demo`: a table with objects, a screen that hides some, a look aside and back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.geometry import se3
from cuboid.lab.synthetic.draft import Draft, add_shell, finish
from cuboid.lab.synthetic.mesh import shift, turn
from cuboid.lab.synthetic.paths import around
from cuboid.lab.synthetic.placement import Arrangement
from cuboid.lab.synthetic.scene import Scene, Surface
from cuboid.lab.synthetic.shapes import MAKERS, turned

DEMO_FRAMES = 150
# The objects: kind, seed, position on the table (-1..1), yaw in degrees.
_LAID: tuple[tuple[str, int, float, float, float], ...] = (
    ("carton", 13, -0.62, 0.45, 20.0),
    ("bowl", 3, 0.05, 0.42, 0.0),
    ("cap", 13, 0.60, 0.38, 250.0),
    ("mug", 15, -0.42, -0.42, 310.0),
    ("can", 1, 0.10, -0.38, 0.0),
    ("milk", 8, 0.72, -0.45, 35.0),
    ("book", 11, -0.80, -0.35, 80.0),
    ("ball", 5, 0.40, -0.05, 0.0),
)


def demo_scene(frames: int = DEMO_FRAMES) -> Scene:
    """Return the scene of the demo: eight objects, one of which is hidden for a while, and a look aside.

    The world is the first camera's frame, as for poses that are estimated from the video.
    """
    rng = np.random.default_rng(11)
    surface = Surface("table", 0.72, np.zeros(2), np.array([0.62, 0.42]))
    draft = Draft(rng, frames, "handheld", (), [], Arrangement((surface,), rng), np.empty((0, 6)), whole=True)
    _furnish(draft)
    for name, seed, x, y, degrees in _LAID:
        model = turned(MAKERS[name](np.random.default_rng(seed)), np.radians(degrees))
        draft.objects.put_at(model, 0, (x, y))
    draft.waypoints = _path()
    scene = finish(draft, "synthetic demo", "demo", 11, np.eye(4), 540.0)
    return replace(scene, T_world_room=se3.inverse(scene.T_room_camera[0]))


def _furnish(draft: Draft) -> None:
    half = 2.4
    add_shell(draft, draft.make("floor", half=half + 0.1), half)
    draft.add(draft.make("table", x=1.24, y=0.84, height=0.72), np.eye(4))
    draft.add(draft.make("post"), turn(np.radians(-79)) @ shift((0.72, 0, 0)) @ turn(np.pi / 2), doubtful=True)


def _path() -> Float64Array:
    """Return waypoints: along the table, behind the screen, aside to the wall, and back."""
    middle = (0.0, 0.0, 0.76)
    arc = around(middle, np.radians([-106, -98, -90, -82, -74, -66, -60]), 1.3, np.linspace(1.3, 1.38, 7))
    eye, toward = arc[-1, :3], np.arctan2(*(arc[-1, 3:5] - arc[-1, :2])[::-1])
    rows = [arc]
    for fraction in (0.25, 0.5, 0.75, 1.0, 1.0, 0.75, 0.5, 0.25):
        bearing = toward - fraction * np.radians(58)
        target = eye + 1.3 * np.array([np.cos(bearing), np.sin(bearing), -0.47 * (1 - 0.7 * fraction)])
        rows.append(np.concatenate([eye, target])[None])
    rows.append(around(middle, np.radians([-57, -50]), 1.28, [1.38, 1.4]))
    return np.concatenate(rows)
