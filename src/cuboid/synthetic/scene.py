"""A scene: what stands where, what supports it, and the camera's path; all in a room whose z is up."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from cuboid.core.frame import Float64Array, Intrinsics
from cuboid.geometry import se3
from cuboid.geometry.box import Box
from cuboid.synthetic.footprint import hull, is_round, smallest_rectangle
from cuboid.synthetic.mesh import Mesh
from cuboid.synthetic.shapes import Model

FRAMES_PER_S = 30.0


@dataclass(frozen=True, slots=True)
class Surface:
    """A level face that supports objects.

    Attributes
    ----------
    name : str
    height_m : float
        Above the room's floor.
    center : (2,) float64
    half : (2,) float64
        Half its size along its own axes, metres; a round one has twice the same.
    angle_rad : float
        Of its first axis.
    round : bool
    """

    name: str
    height_m: float
    center: Float64Array
    half: Float64Array
    angle_rad: float = 0.0
    round: bool = False

    def contains(self, points: Float64Array, margin_m: float) -> bool:
        """Tell whether points (N, 2) in the room all lie on it, `margin_m` from its edge."""
        c, s = np.cos(self.angle_rad), np.sin(self.angle_rad)
        own = (points - self.center) @ np.array([[c, -s], [s, c]])
        if self.round:
            return bool((np.linalg.norm(own, axis=1) <= self.half[0] - margin_m).all())
        return bool((np.abs(own) <= self.half - margin_m).all())

    def at(self, first: float, second: float) -> Float64Array:
        """Return the point (2,) in the room at coordinates -1..1 along its axes."""
        c, s = np.cos(self.angle_rad), np.sin(self.angle_rad)
        point: Float64Array = self.center + np.array([[c, -s], [s, c]]) @ (self.half * (first, second))
        return point


@dataclass(frozen=True, slots=True)
class Placed:
    """A model in the room.

    Attributes
    ----------
    model : Model
    T_room_model : (4, 4) float64
        Of what moves, where it stands in the end.
    path : (N, 4, 4) float64 or None
        T_room_model in each frame; None for what stays.
    """

    model: Model
    T_room_model: Float64Array
    path: Float64Array | None = field(default=None, kw_only=True)

    def mesh(self) -> Mesh:
        """Return all its parts in the room."""
        return self.model.mesh().moved(self.T_room_model)

    def at(self, frame: int) -> Self:
        """Return it as it is in a frame."""
        return self if self.path is None else replace(self, T_room_model=self.path[frame])


@dataclass(frozen=True, slots=True)
class SceneObject(Placed):
    """A thing that a tracker should find.

    Attributes
    ----------
    id : int
        From 1.
    surface : int
        Of `Scene.surfaces`; what it stands on, directly or by what lies between.
    judged : bool
        False where it is open whether it is one object: it counts neither way.
    touches : tuple of int
        Objects at no distance.
    on, inside : int
        The object that it lies on, and the one that it stands in; 0 for none.
    """

    id: int = 0
    surface: int = 0
    judged: bool = True
    touches: tuple[int, ...] = ()
    on: int = 0
    inside: int = 0


@dataclass(frozen=True, slots=True)
class Furniture(Placed):
    """A thing that is no object: what supports objects, walls, and obstacles.

    Attributes
    ----------
    doubtful : bool
        True for what stands alone, such as a chair, which others may well call an object.
    """

    doubtful: bool = False


@dataclass(frozen=True, slots=True)
class Agent(Placed):
    """A rigid part of a person: it moves by itself, and is no object."""


@dataclass(frozen=True, slots=True)
class SceneEvent:
    """A change of an object while the camera runs.

    Attributes
    ----------
    event : str
        "appeared", "moved", "gone" or "back".
    id : int
        Of the object.
    begin, end : int
        Frames in which it leaves its place, and in which it is at rest again, or out of the scene.
    T_room_from, T_room_to : (4, 4) float64 or None
        Where it stood, and stands; None where it was, or is, not in the scene.
    """

    event: str
    id: int
    begin: int
    end: int
    T_room_from: Float64Array | None
    T_room_to: Float64Array | None


@dataclass(frozen=True, slots=True)
class Scene:
    """A room, and the path of a camera through it.

    Attributes
    ----------
    name, kind : str
    seed : int
    objects : tuple of SceneObject
    furniture : tuple of Furniture
    surfaces : tuple of Surface
    T_world_room : (4, 4) float64
        Turned and shifted any way: in the world, up is no axis.
    T_room_camera : (N, 4, 4) float64
        True poses.
    focal_px : float
        At a width of 640 pixels.
    lamp : (L, 3) float64
        Points of the lamp, in the room.
    ghosts : tuple of SceneObject
        What stood there at an earlier visit and does not any more.
    agents : tuple of Agent
        Parts of people.
    events : tuple of SceneEvent
        What happens to objects, in the order in which it ends.
    """

    name: str
    kind: str
    seed: int
    objects: tuple[SceneObject, ...]
    furniture: tuple[Furniture, ...]
    surfaces: tuple[Surface, ...]
    T_world_room: Float64Array
    T_room_camera: Float64Array
    focal_px: float
    lamp: Float64Array = field(
        default_factory=lambda: np.array([[1.0, -0.7, 2.55], [0.65, -0.5, 2.6], [0.75, -0.95, 2.6]])
    )
    ghosts: tuple[SceneObject, ...] = ()
    agents: tuple[Agent, ...] = ()
    events: tuple[SceneEvent, ...] = ()

    @property
    def placed(self) -> tuple[Placed, ...]:
        """All bodies: objects, furniture, agents."""
        return (*self.objects, *self.furniture, *self.agents)

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.T_room_camera)

    @property
    def T_world_camera(self) -> Float64Array:
        """True poses, (N, 4, 4)."""
        poses: Float64Array = self.T_world_room @ self.T_room_camera
        return poses

    def intrinsics(self, width: int = 640, height: int = 480) -> Intrinsics:
        """Return the pinhole for images of a size; the horizontal field of view stays."""
        focal = self.focal_px * width / 640
        return Intrinsics(focal, focal, (width - 1) / 2, (height - 1) / 2, width, height)

    def plane(self, surface: int) -> tuple[Float64Array, float]:
        """Return normal (3,) and offset of a surface in the world: normal.p + offset = 0."""
        normal = self.T_world_room[:3, 2]
        point = se3.transform(self.T_world_room, (0, 0, self.surfaces[surface].height_m))
        return normal, -float(normal @ point)

    def box(self, placed: Placed) -> Box:
        """Return the box of least footprint around a body that stands upright, in the world."""
        points = placed.mesh().vertices
        center, size, angle = smallest_rectangle(hull(points[:, :2]))
        low, high = float(points[:, 2].min()), float(points[:, 2].max())
        c, s = np.cos(angle), np.sin(angle)
        rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        return Box(
            center=se3.transform(self.T_world_room, (*center, (low + high) / 2)),
            size=np.array([*size, high - low]),
            rotation=self.T_world_room[:3, :3] @ rotation,
        )

    def is_round(self, placed: Placed) -> bool:
        """Tell whether a body that stands upright looks alike from all sides."""
        return is_round(hull(placed.mesh().vertices[:, :2]))
