"""A draft of a scene, and the room, the table and the circular path that several kinds share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.lab.synthetic.mesh import shift, turn
from cuboid.lab.synthetic.paths import CAMERAS, MAX_STEP_M, Style, around, fly
from cuboid.lab.synthetic.placement import Arrangement
from cuboid.lab.synthetic.scene import Agent, Furniture, Scene, SceneEvent, Surface
from cuboid.lab.synthetic.shapes import CATALOGUE, Model, build, sets

# Default gap between objects, metres.
OBJECT_GAP_M = 0.06
# Distance from the middle of a room to its walls, metres.
ROOM_HALF_M = 2.6


@dataclass
class Draft:
    """A draft of a scene.

    Attributes
    ----------
    rng : numpy.random.Generator
    frames : int
    camera : str
        One of `CAMERAS`.
    meshes : sequence of Model
        The user's meshes, which are used before generated models.
    furniture : list of Furniture
    objects : Arrangement
        Objects; set when the surfaces are known.
    waypoints : (K, 6) float64
    whole : bool
        Whether the path must be flown to its end.
    style : Style or None
        Motion style of the camera; default: that of `camera`.
    roll_rad : float
        Roll of the camera about its optical axis.
    agents : list of Agent
    events : list of SceneEvent
    """

    rng: np.random.Generator
    frames: int
    camera: str
    meshes: Sequence[Model]
    furniture: list[Furniture]
    objects: Arrangement
    waypoints: Float64Array
    whole: bool = False
    style: Style | None = None
    roll_rad: float = 0.0
    agents: list[Agent] = field(default_factory=list)
    events: list[SceneEvent] = field(default_factory=list)

    def add(self, model: Model, T_room_model: Float64Array, *, doubtful: bool = False) -> None:
        """Add furniture at a pose (4, 4)."""
        self.furniture.append(Furniture(model, T_room_model, doubtful))

    def make(self, name: str, **sizes: Any) -> Model:
        """Return a model of a shape of the table of shapes, with these sizes."""
        return build(name, self.rng, **sizes)

    def models(self, count: int, of: str | Sequence[str] = "basic") -> list[Model]:
        """Draw random models of a set or of these names, the user's first; a name is repeated after all are used."""
        names = sets()[of] if isinstance(of, str) else of
        user_models = [self.meshes[int(k)] for k in self.rng.permutation(len(self.meshes))][:count]
        drawn: list[str] = []
        while len(drawn) < count - len(user_models):
            drawn += [names[int(k)] for k in self.rng.permutation(len(names))]
        return user_models + [CATALOGUE[name](self.rng) for name in drawn[: count - len(user_models)]]

    def fill(self, surface: int, count: int, of: str, gap: float, within: float = 1.0) -> None:
        """Put random models of a set on a surface; see `models` and `Arrangement.put`."""
        for model in self.models(count, of):
            self.objects.put(model, surface, gap, within)


def finish(draft: Draft, name: str, kind: str, seed: int, T_world_room: Float64Array, focal_px: float) -> Scene:
    """Return the scene of a draft whose room has the pose `T_world_room` (4, 4)."""
    style = draft.style or CAMERAS[draft.camera]
    poses = fly(draft.waypoints, draft.frames, style, draft.rng, whole=draft.whole) @ turn(draft.roll_rad)
    return Scene(
        name=name,
        kind=kind,
        seed=seed,
        objects=tuple(draft.objects.objects),
        furniture=tuple(draft.furniture),
        surfaces=draft.objects.surfaces,
        T_world_room=T_world_room,
        T_room_camera=poses,
        focal_px=focal_px,
        agents=tuple(draft.agents),
        events=tuple(sorted(draft.events, key=lambda one: one.end)),
    )


def on_floor(surface: Surface) -> Float64Array:
    """Return T_room_model (4, 4) of furniture on the floor whose top is a surface."""
    return shift((*surface.center, 0)) @ turn(surface.angle_rad)


def add_shell(draft: Draft, floor: Model, half: float, *, pictures: bool = True) -> None:
    """Add floor, ceiling and walls; `pictures` tells whether the wall at +y has any."""
    draft.add(floor, np.eye(4))
    draft.add(draft.make("ceiling", half=half + 0.1), np.eye(4))
    for k in range(4):
        wall = draft.make("wall", length=2 * half, pictures=pictures or k > 0)
        draft.add(wall, turn(k * np.pi / 2) @ shift((0, half, 0)))


def add_room(draft: Draft, half: float = ROOM_HALF_M) -> None:
    """Add floor, ceiling, walls, and a curtain at -y."""
    add_shell(draft, draft.make("floor", half=half + 0.1), half)
    draft.add(draft.make("curtain", length=2 * half), turn(np.pi) @ shift((0, half - 0.2, 0)))


def add_middle_table(draft: Draft) -> None:
    """Add a round or rectangular table in the middle of the room: the first surface."""
    rng = draft.rng
    height, angle = rng.uniform(0.42, 0.85), rng.uniform(0, np.pi)
    if rng.random() < 0.3:
        radius = rng.uniform(0.5, 0.62)
        surface = Surface("round table", height, np.zeros(2), np.full(2, radius), 0.0, round=True)
        draft.add(draft.make("round_table", radius=radius, height=height), np.eye(4))
    else:
        half = np.array([rng.uniform(0.55, 0.75), rng.uniform(0.4, 0.5)])
        surface = Surface("table", height, np.zeros(2), half, angle)
        draft.add(draft.make("table", x=2 * half[0], y=2 * half[1], height=height), on_floor(surface))
    draft.objects = Arrangement((surface,), rng)


def circling(
    draft: Draft, surface: int, radius: float, height: float | None = None, *, steady: bool = False
) -> Float64Array:
    """Return waypoints around a surface, as far as the number of frames allows."""
    rng, top = draft.rng, draft.objects.surfaces[surface]
    middle = (*top.center, top.height_m + 0.05)
    level = top.height_m + rng.uniform(0.5, 0.85) if height is None else height
    angle = draft.frames * MAX_STEP_M * 0.95 / radius
    if draft.camera == "orbit" or steady:
        count, radii, levels = 24, np.full(24, radius), np.full(24, level)
        angles = np.linspace(0, angle, count)
    else:
        count = max(4, draft.frames // 28)
        wide = 0.3 if draft.camera == "drone" else 0.2
        radii = radius + rng.uniform(-0.5 * wide, wide, count)
        levels = level + rng.uniform(-0.6 * wide, (2.2 if draft.camera == "drone" else 1.0) * wide, count)
        angles = np.linspace(0, 0.8 * angle, count)
    waypoints = around(middle, rng.uniform(0, 2 * np.pi) + (1 if rng.random() < 0.5 else -1) * angles, radii, levels)
    if not steady:
        waypoints[:, 3:] += rng.uniform(-0.06, 0.06, (len(waypoints), 3)) * (draft.camera != "orbit")
    return waypoints
