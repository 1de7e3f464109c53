"""Rigs of several cameras in a made scene: fixed around its first surface, or moving together along its path.

The cameras take turns: frame i is of camera i modulo their number, at i / 30 s. Each has a focal length of its own.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar, Unpack

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.geometry import se3
from cuboid.lab.synthetic.kinds import FRAMES, SceneOptions, make_scene
from cuboid.lab.synthetic.mesh import turn
from cuboid.lab.synthetic.paths import around, look_at
from cuboid.lab.synthetic.scene import Placed, Rig, Scene

# Kinds whose first surface is free on all sides.
FREE_KINDS = ("table", "clutter", "stacks", "overhead", "bin", "moving", "containers", "toybox", "tray", "alone")
MAX_RIG_CAMERAS = 8
# Angle between neighbouring fixed cameras, seen from the surface; more cameras are nearer to each other.
SPACING_RAD = np.pi / 2
# Variation of the angle, radians, and relative variation of distance and height; variation of the target, metres.
ANGLE_RAD, RELATIVE, TARGET_M = 0.15, 0.1, 0.05
# Smallest ratio of horizontal distance to height above the surface: a camera straight above sees no sides.
MIN_SLOPE = 0.5
# A moving rig: angle and distance between neighbouring cameras, and relative variation of the focal length.
FAN_RAD, BASE_M, FOCAL = np.radians(40.0), 0.09, 0.05
# Frames of each camera of a fixed rig.
FIXED_FRAMES = 40
P = TypeVar("P", bound=Placed)

# Random numbers of rigs begin with this number after the seed.
STREAM = 9


def make_rig(
    kind: str,
    seed: int,
    cameras: int,
    *,
    moving: bool = False,
    frames: int | None = None,
    **made_as: Unpack[SceneOptions],
) -> Scene:
    """Make a scene that several cameras see; the same arguments make the same scene.

    Parameters
    ----------
    kind : str
        One of `FREE_KINDS` for fixed cameras, one of `KINDS` for moving ones.
    seed : int
    cameras : int
        2 to `MAX_RIG_CAMERAS`.
    moving : bool
        Whether the cameras move together along the path of the kind.
    frames : int, optional
        Frames of each camera; default: `FIXED_FRAMES`, or the kind's path.
    **made_as
        The other options of `make_scene`.

    Raises
    ------
    InputError
        The kind, the camera or the style is unknown, or the kind has no room for fixed cameras.
    """
    if not 2 <= cameras <= MAX_RIG_CAMERAS:
        raise InputError(f"a rig has 2 to {MAX_RIG_CAMERAS} cameras, got {cameras}")
    if not moving and kind not in FREE_KINDS:
        raise InputError(f"no rig can stand around a scene of the kind '{kind}'; there are {', '.join(FREE_KINDS)}")
    each = frames or (FRAMES[kind] // cameras if moving and kind in FRAMES else FIXED_FRAMES)
    scene = make_scene(kind, seed, frames=each * cameras, **made_as)
    rng = np.random.default_rng([seed, STREAM, cameras])
    focal = tuple((1.0 + rng.uniform(-FOCAL, FOCAL, cameras)).tolist())
    if moving:
        T_rig_camera = _fan(cameras)
        poses = scene.T_room_camera @ T_rig_camera[np.arange(scene.frames) % cameras]
        return replace(scene, T_room_camera=poses, rig=Rig(True, T_rig_camera, focal))
    T_room_camera = _around(scene, cameras, rng)
    poses = T_room_camera[np.arange(scene.frames) % cameras]
    return replace(scene, T_room_camera=poses, rig=Rig(False, scene.T_world_room @ T_room_camera, focal))


def _fan(cameras: int) -> Float64Array:
    """Return the poses (N, 4, 4) of cameras side by side that look apart; the first one is the rig."""
    fan = np.array([turn(k * FAN_RAD, 1) for k in range(cameras)])
    fan[:, 0, 3] = BASE_M * np.arange(cameras)
    return fan


def _around(scene: Scene, cameras: int, rng: np.random.Generator) -> Float64Array:
    """Return T_room_camera (N, 4, 4) of cameras around the first surface, about as far as the scene's own camera."""
    top, first = scene.surfaces[0], scene.T_room_camera[0, :3, 3]
    middle = np.array([*top.center, top.height_m + 0.05])
    away = first - middle
    height = float(away[2])
    radius = max(float(np.hypot(*away[:2])), MIN_SLOPE * height)
    angles = np.arctan2(away[1], away[0]) + np.arange(cameras) * min(SPACING_RAD, 2 * np.pi / cameras)
    angles = angles + rng.uniform(-ANGLE_RAD, ANGLE_RAD, cameras)
    radii, heights = ((1.0 + rng.uniform(-RELATIVE, RELATIVE, cameras)) * value for value in (radius, height))
    waypoints = around(middle, angles, radii, middle[2] + heights)
    targets = waypoints[:, 3:] + rng.uniform(-TARGET_M, TARGET_M, (cameras, 3))
    return np.array([look_at(eye, target) for eye, target in zip(waypoints[:, :3], targets, strict=True)])


def of_camera(scene: Scene, k: int) -> Scene:
    """Return the scene as one camera of its rig sees it: with only the frames of this camera."""
    assert scene.rig is not None
    step = scene.rig.cameras

    def thinned(body: P) -> P:
        return body if body.path is None else replace(body, path=body.path[k::step])

    return replace(
        scene,
        objects=tuple(thinned(body) for body in scene.objects),
        furniture=tuple(thinned(body) for body in scene.furniture),
        agents=tuple(thinned(body) for body in scene.agents),
        events=tuple(replace(one, begin=one.begin // step, end=one.end // step) for one in scene.events),
        T_room_camera=scene.T_room_camera[k::step],
        focal_px=scene.focal_px * scene.rig.focal[k],
        rig=None,
    )


def document(scene: Scene) -> dict[str, object]:
    """Return the content of the rig's `rig.json`; the recording of camera k is in the folder of its name."""
    assert scene.rig is not None
    names = [name_of(k) for k in range(scene.rig.cameras)]
    return {
        "format": "cuboid-rig",
        "version": 1,
        "kind": "moving" if scene.rig.moving else "fixed",
        "cameras": [
            {"name": name, "recording": name, "T_rig_camera": se3.tidied(T).tolist()}
            for name, T in zip(names, scene.rig.T_rig_camera, strict=True)
        ],
    }


def name_of(k: int) -> str:
    """Return the name of the k-th camera, from 0, and of its folder."""
    return f"camera-{k + 1}"
