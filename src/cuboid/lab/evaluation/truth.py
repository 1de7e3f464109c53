"""Ground-truth files: the objects, the region in which they are judged, and their visibility in each frame.

``docs/evaluation.md`` describes the format, "cuboid-truth" version 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import printable
from cuboid.ground.core.paths import PathLike, as_path
from cuboid.ground.formats.json_validation import read_json
from cuboid.ground.formats.relations import RelationOfTruth
from cuboid.ground.formats.truth_file import (
    BoxOfTruth,
    EventOfTruth,
    Move,
    RegionOfTruth,
    TruthDocument,
    VisibilityOfTruth,
)
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.polygons import lie_inside
from cuboid.ground.geometry.se3 import compose
from cuboid.lab.evaluation.boxer import is_boxer, read_boxer

NAME = "truth.json"


@dataclass(frozen=True, slots=True)
class TruthObject:
    """A true object.

    Attributes
    ----------
    id : int
        Positive, unique.
    name : str
        Name for users.
    judged : bool
        False if a detection of the object counts neither way.
    box : Box
        Box in the world of the truth.
    round : bool
        Whether it is rotationally symmetric: its box may be rotated about the third axis.
    path : Path3D or None
        Pose in each frame; None if the object does not move. `box` is the final box.
    """

    id: int
    name: str
    judged: bool
    box: Box
    round: bool = False
    path: Path3D | None = None

    def at(self, frame: int) -> Box:
        """Return the object's box in a frame."""
        return self.box if self.path is None else self.path.at(frame, self.box.size)


@dataclass(frozen=True, slots=True)
class JudgedRegion:
    """The part of the world that the truth covers: a prism over a polygon on a plane.

    Attributes
    ----------
    normal : (3,) float64
        Unit normal of the plane n.p + offset = 0.
    offset : float
        Metres.
    polygon : (N, 3) float64
        Outline on the plane, in order, metres.
    height_m : (float, float)
        Lower and upper limit along the normal, metres.
    """

    normal: Float64Array
    offset: float
    polygon: Float64Array
    height_m: tuple[float, float]

    def contains(self, points: Float64Array) -> npt.NDArray[np.bool_]:
        """Return for each point (N, 3) whether it lies inside, (N,)."""
        height = points @ self.normal + self.offset
        low, high = self.height_m
        across = np.linalg.svd(self.normal[None])[2][1:].T  # two directions along the plane
        inside = lie_inside(points @ across, self.polygon @ across)
        return np.asarray(inside & (height >= low) & (height <= high))


@dataclass(frozen=True, slots=True)
class Path3D:
    """The pose of a box in each frame.

    Attributes
    ----------
    frames : (K,) int64
        Increasing frames; each pose holds until the next frame in the list.
    T_truth_box : (K, 4, 4) float64
    """

    frames: npt.NDArray[np.int64]
    T_truth_box: Float64Array

    def at(self, frame: int, size: Float64Array) -> Box:
        """Return the box with the given size (3,), metres, in a frame."""
        T = self.T_truth_box[max(int(np.searchsorted(self.frames, frame, "right")) - 1, 0)]
        return Box(T[:3, 3], size, T[:3, :3])


@dataclass(frozen=True, slots=True)
class TruthAgent:
    """A rigid part of a person.

    Attributes
    ----------
    size : (3,) float64
    path : Path3D
    """

    size: Float64Array
    path: Path3D


@dataclass(frozen=True, slots=True)
class Truth:
    """The contents of a truth file.

    Attributes
    ----------
    path : Path
    name : str
    frames : int or None
        Number of frames of the recording; None if the file does not give it.
    objects : tuple of TruthObject
        Objects by id.
    region : JudgedRegion or None
        Judged region; None if everything is judged.
    ignored : tuple of Box
        Places where detections count neither way.
    visibility : (frames, objects) float64 or None
        Visible fraction of each object in each frame, 0..1; None if the file does not give it.
    events : sequence of EventOfTruth or None
        Events of objects, in the order of their ends; None if the file does not list them.
    agents : tuple of TruthAgent
        People, in rigid parts.
    relations : sequence of RelationOfTruth or None
        None if the file does not list them.
    planes, walls : tuple of ((3,) float64, float)
        Normal and offset of the surfaces in relations.
    """

    path: Path
    name: str
    frames: int | None
    objects: tuple[TruthObject, ...]
    region: JudgedRegion | None
    ignored: tuple[Box, ...]
    visibility: Float64Array | None
    events: Sequence[EventOfTruth] | None = None
    agents: tuple[TruthAgent, ...] = ()
    relations: Sequence[RelationOfTruth] | None = None
    planes: tuple[tuple[Float64Array, float], ...] = ()
    walls: tuple[tuple[Float64Array, float], ...] = ()

    @property
    def gone(self) -> frozenset[int]:
        """Objects that are gone at the end."""
        last = {event.id: event.event for event in self.events or ()}
        return frozenset(number for number, event in last.items() if event == "gone")


def read_truth(path: PathLike) -> Truth:
    """Read a truth file, the file `NAME` in a folder, or Boxer's table of boxes.

    Raises
    ------
    InputError
        The file is missing, is no truth file, or a field is malformed; the message names file and field.
    """
    path = as_path(path)
    path = path / NAME if path.is_dir() else path
    if is_boxer(path):
        things = tuple(TruthObject(one.label, one.name or str(one.label), True, one.box) for one in read_boxer(path))
        return Truth(path, printable(path.stem), None, things, None, (), None)
    document = read_json(path, TruthDocument)
    objects = sorted(document.objects, key=lambda item: item.id)
    seen = document.visibility
    return Truth(
        path=path,
        name=document.name or printable(path.stem),
        frames=document.frames if seen is None else seen.frames,
        objects=tuple(
            TruthObject(
                item.id,
                item.name or str(item.id),
                item.judged,
                _box(item),
                item.round,
                _path(item.moves) if item.moves else None,
            )
            for item in objects
        ),
        region=None if document.judged_region is None else _region(document.judged_region),
        ignored=tuple(map(_box, document.ignore or ())),
        visibility=None if seen is None else _visibility(seen, [item.id for item in objects]),
        events=document.events,
        agents=tuple(
            TruthAgent(np.array(part.size), _path(part.moves)) for part in document.agents or () if part.moves
        ),
        relations=document.relations,
        planes=tuple((np.array(plane.normal), plane.offset) for plane in document.planes),
        walls=tuple((np.array(wall.normal), wall.offset) for wall in document.walls),
    )


def _box(item: BoxOfTruth) -> Box:
    return Box(np.array(item.center), np.array(item.size), np.array(item.rotation))


def _path(moves: Sequence[Move]) -> Path3D:
    poses = np.array([compose(turn, place) for _, *rest in moves for place, turn in [(rest[:3], rest[3:])]])
    return Path3D(np.array([frame for frame, *_ in moves], np.int64), poses)


def _region(item: RegionOfTruth) -> JudgedRegion:
    normal = np.array(item.normal)
    length = float(np.linalg.norm(normal))
    return JudgedRegion(normal / length, item.offset / length, np.array(item.polygon), (item.hmin, item.hmax))


def _visibility(seen: VisibilityOfTruth, ids: list[int]) -> Float64Array:
    """Return the visible fraction (frames, objects) from run lengths; 0 for objects without any."""
    fractions = np.zeros((seen.frames, len(ids)))
    for k, number in enumerate(ids):
        runs = seen.objects.get(str(number))
        if runs is not None:
            fractions[:, k] = np.repeat([fraction for fraction, _ in runs], [count for _, count in runs])
    return fractions
