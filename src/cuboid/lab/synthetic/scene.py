"""A scene: objects, their supports, and the camera's path, all in a room frame with z up."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.geometry import se3
from cuboid.ground.geometry.box import Box
from cuboid.lab.synthetic.footprint import hull, is_round, smallest_rectangle
from cuboid.lab.synthetic.light import ColorCamera, Light
from cuboid.lab.synthetic.mesh import Mesh, turn
from cuboid.lab.synthetic.shapes import Model

FRAMES_PER_S = 30.0


def require_known(what: str, name: str, known: Collection[str]) -> None:
    """Raise InputError unless a name is known; `what` says what it is the name of."""
    if name not in known:
        raise InputError(f"no {what} is called '{name}'; there are {', '.join(known)}")


@dataclass(frozen=True, slots=True)
class Surface:
    """A level face that supports objects.

    Attributes
    ----------
    name : str
    height_m : float
        Height above the room's floor.
    center : (2,) float64
    half : (2,) float64
        Half the size along the surface's axes, metres; both are equal for a round surface.
    angle_rad : float
        Direction of the first axis.
    round : bool
    """

    name: str
    height_m: float
    center: Float64Array
    half: Float64Array
    angle_rad: float = 0.0
    round: bool = False

    def contains(self, points: Float64Array, margin_m: float) -> bool:
        """Return whether all points (N, 2) of the room lie on the surface, at least `margin_m` from its edge."""
        c, s = np.cos(self.angle_rad), np.sin(self.angle_rad)
        local = (points - self.center) @ np.array([[c, -s], [s, c]])
        if self.round:
            return bool((np.linalg.norm(local, axis=1) <= self.half[0] - margin_m).all())
        return bool((np.abs(local) <= self.half - margin_m).all())

    def at(self, first: float, second: float) -> Float64Array:
        """Return the point (2,) in the room at coordinates -1..1 along the surface's axes."""
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
        Pose; for moving bodies the final pose.
    path : (N, 4, 4) float64 or None
        T_room_model in each frame; None for static bodies.
    """

    model: Model
    T_room_model: Float64Array
    path: Float64Array | None = field(default=None, kw_only=True)

    def mesh(self) -> Mesh:
        """Return all parts as one mesh in the room."""
        return self.model.mesh().moved(self.T_room_model)

    def at(self, frame: int) -> Self:
        """Return the body with its pose in a frame."""
        return self if self.path is None else replace(self, T_room_model=self.path[frame])


@dataclass(frozen=True, slots=True)
class SceneObject(Placed):
    """An object that a tracker should find.

    Attributes
    ----------
    id : int
        Id of the object, from 1.
    surface : int
        Index in `Scene.surfaces` of its support, direct or below other objects.
    judged : bool
        False if it is undecided whether it is one object: it counts neither way.
    touches : tuple of int
        Ids of touching objects.
    on, inside : int
        Id of the object on which it lies, and of the object in which it stands; 0 for none.
    """

    id: int = 0
    surface: int = 0
    judged: bool = True
    touches: tuple[int, ...] = ()
    on: int = 0
    inside: int = 0


@dataclass(frozen=True, slots=True)
class Furniture(Placed):
    """A body that is no object: supports, walls, and obstacles.

    Attributes
    ----------
    doubtful : bool
        True for free-standing furniture such as a chair, which may also count as an object.
    """

    doubtful: bool = False


@dataclass(frozen=True, slots=True)
class Agent(Placed):
    """A rigid part of a person: it moves, and is no object."""


@dataclass(frozen=True, slots=True)
class SceneEvent:
    """A change of an object while the camera runs.

    Attributes
    ----------
    event : str
        "appeared", "moved", "gone" or "back".
    id : int
        Id of the object.
    begin, end : int
        Frames in which the object leaves its place, and in which it is at rest again or out of the scene.
    T_room_from, T_room_to : (4, 4) float64 or None
        Pose before and after; None if it was not, or is not, in the scene.
    """

    event: str
    id: int
    begin: int
    end: int
    T_room_from: Float64Array | None
    T_room_to: Float64Array | None


@dataclass(frozen=True, slots=True)
class Rig:
    """Several cameras that take turns: frame i of the scene is of camera i modulo their number.

    Attributes
    ----------
    moving : bool
    T_rig_camera : (N, 4, 4) float64
        In the rig; the rig of fixed cameras is the world.
    focal : tuple of float
        Focal length of each camera as a multiple of the scene's.
    """

    moving: bool
    T_rig_camera: Float64Array
    focal: tuple[float, ...]

    @property
    def cameras(self) -> int:
        """Number of cameras."""
        return len(self.T_rig_camera)


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
        Random rotation and translation: up is not an axis of the world.
    T_room_camera : (N, 4, 4) float64
        True camera poses.
    focal_px : float
        Focal length at an image width of 640 pixels.
    light : Light
    color_camera : ColorCamera
    ghosts : tuple of SceneObject
        Objects of an earlier visit that are gone.
    agents : tuple of Agent
        Parts of people.
    events : tuple of SceneEvent
        Events of objects, in the order of their ends.
    rig : Rig or None
        Several cameras, if frames are of several.
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
    light: Light = field(default_factory=Light)
    color_camera: ColorCamera = field(default_factory=ColorCamera)
    ghosts: tuple[SceneObject, ...] = ()
    agents: tuple[Agent, ...] = ()
    events: tuple[SceneEvent, ...] = ()
    rig: Rig | None = None

    @property
    def placed(self) -> tuple[Placed, ...]:
        """All bodies: objects, furniture, agents."""
        return (*self.objects, *self.furniture, *self.agents)

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.T_room_camera)

    @property
    def cameras(self) -> int:
        """Number of cameras."""
        return 1 if self.rig is None else self.rig.cameras

    @property
    def T_world_camera(self) -> Float64Array:
        """True poses, (N, 4, 4)."""
        poses: Float64Array = self.T_world_room @ self.T_room_camera
        return poses

    def intrinsics(self, width: int = 640, height: int = 480, camera: int = 0) -> Intrinsics:
        """Return the intrinsics of a camera of the rig for an image size, with the same horizontal field of view."""
        focal = self.focal_px * width / 640 * (1.0 if self.rig is None else self.rig.focal[camera])
        return Intrinsics(focal, focal, (width - 1) / 2, (height - 1) / 2, width, height)

    def plane(self, surface: int) -> tuple[Float64Array, float]:
        """Return normal (3,) and offset of a surface in the world: normal.p + offset = 0."""
        normal = self.T_world_room[:3, 2]
        point = se3.transform(self.T_world_room, (0, 0, self.surfaces[surface].height_m))
        return normal, -float(normal @ point)

    def box(self, placed: Placed) -> Box:
        """Return the box with the smallest footprint around an upright body, in the world."""
        points = placed.mesh().vertices
        center, size, angle = smallest_rectangle(hull(points[:, :2]))
        low, high = float(points[:, 2].min()), float(points[:, 2].max())
        return Box(
            center=se3.transform(self.T_world_room, (*center, (low + high) / 2)),
            size=np.array([*size, high - low]),
            rotation=self.T_world_room[:3, :3] @ turn(angle)[:3, :3],
        )

    def is_round(self, placed: Placed) -> bool:
        """Return whether an upright body looks the same from all sides."""
        return is_round(hull(placed.mesh().vertices[:, :2]))
