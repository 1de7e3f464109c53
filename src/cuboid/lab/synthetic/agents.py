"""People that move through a scene, in rigid parts: a hand with its arm, and a person who walks by."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.geometry.se3 import assembled
from cuboid.lab.synthetic.material import Material, Texture, two_paints
from cuboid.lab.synthetic.mesh import box, lathe, merged, shift, tube, turn
from cuboid.lab.synthetic.scene import Agent
from cuboid.lab.synthetic.shapes import Model

SKINS = ((0.87, 0.67, 0.54), (0.71, 0.49, 0.36), (0.46, 0.30, 0.22))
# Height of the palm above the fingertips, and length of the arm, metres.
PALM_M, ARM_M = 0.09, 0.55
# A walk: length of a step, metres, and how far the legs swing, radians.
PACE_M, SWING_RAD = 0.7, 0.45
HIP_M, SHOULDER_M = 0.9, 1.42


def hand(rng: np.random.Generator) -> tuple[Model, Model, Model, Model]:
    """Return palm, fingers, thumb and arm.

    The origin of the palm lies between the fingertips, z up. The origins of fingers and thumb are at their tips; the
    origin of the arm is at the wrist, and the arm extends along its z.
    """
    skin = Material(SKINS[int(rng.integers(len(SKINS)))], shine=0.1)
    cloth = Material(*two_paints(rng), Texture.SPECKLE, 0.02)
    palm = box((0.085, 0.08, 0.03), (0, 0, PALM_M))
    tip = [(0, 0, 0), (0.004, 0, 0.03), (0.002, 0, 0.06), (-0.015, 0, PALM_M + 0.015)]
    fingers = merged([tube(tip, 0.009).moved(shift((0, y, 0))) for y in (-0.03, -0.01, 0.01, 0.03)])
    thumb = tube([(-x, 0, z) for x, _, z in tip], 0.011)
    profile = [(0, 0), (0.028, 0.005), (0.033, 0.08), (0.045, 0.28), (0.052, ARM_M - 0.02), (0, ARM_M)]
    return (
        Model("palm", ((palm, skin),)),
        Model("fingers", ((fingers, skin),)),
        Model("thumb", ((thumb, skin),)),
        Model("arm", ((lathe(profile, 24), cloth),)),
    )


def hand_agents(
    models: Sequence[Model], poses: Float64Array, open_m: Float64Array, shoulder: Float64Array
) -> list[Agent]:
    """Return the parts of a hand that moves along a path.

    Parameters
    ----------
    models : sequence of Model
        Output of `hand`.
    poses : (N, 4, 4) float64
        T_room_palm in each frame.
    open_m : (N,) float64
        Half of the distance between fingers and thumb.
    shoulder : (3,) float64
        Position of the shoulder in the room.
    """
    palm, fingers, thumb, arm = models
    to = [np.array([shift((side * x, 0, 0)) for x in open_m]) for side in (1, -1)]
    arms = np.array([_along(wrist, shoulder) for wrist in poses[:, :3, 3] + (0, 0, PALM_M + 0.02)])
    paths = (palm, poses), (fingers, poses @ to[0]), (thumb, poses @ to[1]), (arm, arms)
    return [Agent(model, path[-1], path=path) for model, path in paths]


def _along(start: Float64Array, end: Float64Array) -> Float64Array:
    """Return a pose (4, 4) at `start` with z towards `end`."""
    z = (end - start) / np.linalg.norm(end - start)
    x = np.cross((0.0, 0.0, 1.0), z)
    x /= max(float(np.linalg.norm(x)), 1e-9)
    return assembled(np.column_stack([x, np.cross(z, x), z]), start)


def walker(rng: np.random.Generator, steps: Float64Array) -> list[Agent]:
    """Return the parts of a walking person.

    Parameters
    ----------
    rng : numpy.random.Generator
    steps : (N, 4, 4) float64
        T_room_person in each frame: on the floor, x ahead, z up.
    """
    skin = Material(SKINS[int(rng.integers(len(SKINS)))], shine=0.1)
    shirt, trousers = (Material(*two_paints(rng), Texture.SPECKLE, 0.03) for _ in range(2))
    rise = np.linspace(-np.pi / 2, np.pi / 2, 16)
    head = lathe(np.column_stack([0.095 * np.cos(rise), 1.62 + 0.12 * np.sin(rise)]), 28)
    torso = lathe(
        [(0, HIP_M - 0.06), (0.16, HIP_M - 0.03), (0.15, 1.15), (0.19, SHOULDER_M), (0.06, 1.5), (0, 1.5)], 28
    )
    leg = lathe([(0, -HIP_M), (0.055, -HIP_M + 0.01), (0.06, -0.45), (0.085, 0), (0, 0.01)], 20)
    arm = lathe([(0, -0.62), (0.035, -0.6), (0.045, -0.25), (0.055, 0), (0, 0.01)], 20)
    walked = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(steps[:, :2, 3], axis=0), axis=1))])
    swing = SWING_RAD * np.sin(np.pi * walked / PACE_M)
    body = Model("person", ((torso, shirt), (head, skin)))
    parts = [Agent(body, steps[-1], path=steps)]
    limbs = (("leg", leg, trousers, 0.09, HIP_M), ("arm", arm, shirt, 0.24, SHOULDER_M - 0.04))
    for name, mesh, look, aside, height in limbs:
        for side in (1, -1):
            ahead = side if name == "leg" else -side
            hung = np.array([shift((0, side * aside, height)) @ turn(ahead * angle, 1) for angle in swing])
            path = steps @ hung
            parts.append(Agent(Model(name, ((mesh, look),)), path[-1], path=path))
    return parts
