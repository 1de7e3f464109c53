"""Hands with arms that hold things; they are ignored."""

from __future__ import annotations

import numpy as np
from meshes import Color, Floats, ellipsoid, pick, tube
from prints import random_color
from thing import Thing

from scene import IGNORE, Scene

SKIN: tuple[Color, ...] = ((0.87, 0.65, 0.53), (0.75, 0.52, 0.4), (0.5, 0.33, 0.23), (0.94, 0.77, 0.67))


def hand(scene: Scene, held_at: Floats, reach: float, width: float, from_above: bool) -> None:
    """Add an arm whose fingers hold something at a point (3,); the arm comes from -y."""
    rng, skin = scene.rng, pick(scene.rng, SKIN)
    back = np.array([rng.uniform(-0.3, 0.3), -0.7, 1.2 if from_above else rng.uniform(0.2, 0.6)])
    back /= np.linalg.norm(back)
    side = np.cross(back, [0, 0, 1.0])
    side /= np.linalg.norm(side)
    lift = np.cross(side, back)
    palm = held_at + back * (reach + 0.07)
    parts = []
    for k in range(4):
        root = palm + lift * (0.03 - 0.02 * k)
        knuckle = root + side * (width + 0.012) - back * 0.06
        parts.append(
            tube([root + side * 0.02, knuckle, knuckle - side * width * 0.6 - back * (reach + 0.01)], 0.0085, skin)
        )
    parts.append(
        tube(
            [palm - side * 0.02, palm - side * (width + 0.012) - back * 0.05, held_at - side * (width + 0.004)],
            0.0105,
            skin,
        )
    )
    hull_ = ellipsoid((0.045, 0.05, 0.025), color=skin).moved((0, 0, -0.025))
    parts.append(hull_.moved(palm, np.stack([lift, back, side], 1)))
    wrist = palm + back * 0.07
    sleeve, bend = random_color(rng), rng.uniform(0.08, 0.3)
    elbow = wrist + back * bend
    parts.append(tube([palm, wrist, elbow], (0.033, 0.028, 0.04), skin))
    parts.append(
        tube([elbow, wrist + back * 0.55 - lift * 0.05, wrist + back * 1.1 - lift * 0.3], (0.048, 0.055, 0.065), sleeve)
    )
    scene.add(Thing(tuple(parts), ()), (0, 0, 0), IGNORE)
