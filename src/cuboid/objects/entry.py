"""An object as the map keeps it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from cuboid.frame import Float64Array
from cuboid.geometry.box import Box
from cuboid.surfaces.plane import Plane


@dataclass(slots=True, eq=False)
class MapObject:
    """An object of the map, confirmed or not.

    Attributes
    ----------
    number : int
        Owner number in the voxel map, from 1.
    label : int
        0 until confirmed.
    points : (N, 3) float32
        Its voxels' places in the world, as of the last look at the map.
    colors : (N, 3) uint8
        Their colors.
    box : Box
    plane : Plane or None
        What it stands on.
    heat : float
        Mean heat of its voxels.
    mean_color : (3,) float64
    first_frame, last_frame : int
        First and last frame that saw it.
    frames_seen : int
        Frames that saw it.
    proposed : int
        Frames whose own proposals it matched.
    before : int
        Frames in which its points were hot before it was an object.
    whole : int
        Of these, frames in which no border of the picture cut it.
    patience : int
        How often it has to be proposed before it gets a label; 0 while that is not known.
    merged_labels : list of int
    missing : int
        Looks at its place in which it was not found.
    apart : int
        Looks in a row in which a part of it stood apart.
    bonded : bool
        Parts that no voxels link were found to belong to it.
    holding : int
        Looks in which most of it held up a plane, since one in which less of it did.
    retired : bool
    """

    number: int
    points: npt.NDArray[np.float32]
    colors: npt.NDArray[np.uint8]
    box: Box
    plane: Plane | None
    heat: float
    mean_color: Float64Array
    first_frame: int
    last_frame: int
    label: int = 0
    frames_seen: int = 0
    proposed: int = 0
    before: int = 0
    whole: int = 0
    patience: int = 0
    merged_labels: list[int] = field(default_factory=list)
    missing: int = 0
    apart: int = 0
    bonded: bool = False
    holding: int = 0
    retired: bool = False

    @property
    def confirmed(self) -> bool:
        """Whether it has a label."""
        return self.label > 0

    @property
    def score(self) -> float:
        """Confidence that it is an object: hot, and proposed again and again, 0..1."""
        return float(min(1.0, self.heat) * (1.0 - np.exp(-self.proposed / 10.0)))
