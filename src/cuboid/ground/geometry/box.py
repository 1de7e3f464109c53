"""An oriented box with nine degrees of freedom, independent of its source."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array

# The eight corners in units of half sizes; corner k has bit 0, 1, 2 of k for +x, +y, +z.
CORNER_SIGNS = np.array(
    [[(k & 1) * 2 - 1, (k >> 1 & 1) * 2 - 1, (k >> 2 & 1) * 2 - 1] for k in range(8)], dtype=np.float64
)
# The twelve edges as pairs of corner numbers.
EDGES = tuple((a, b) for a in range(8) for b in range(a + 1, 8) if (a ^ b) in (1, 2, 4))


@dataclass(frozen=True, slots=True)
class Box:
    """An oriented box in some frame (the world unless said otherwise).

    Attributes
    ----------
    center : (3,) float64
        Centre in metres.
    size : (3,) float64
        Length, width, height along the box's own axes in metres.
    rotation : (3, 3) float64
        The columns are the axes of the box; the third is the normal of its supporting plane, pointing upwards.
    """

    center: Float64Array
    size: Float64Array
    rotation: Float64Array

    def __post_init__(self) -> None:
        shapes = self.center.shape, self.size.shape, self.rotation.shape
        if shapes != ((3,), (3,), (3, 3)):
            raise ValueError(f"a box needs center (3,), size (3,), rotation (3, 3), got {shapes}")

    def __repr__(self) -> str:
        return f"Box({self.text()})"

    def text(self) -> str:
        """Return size (centimetres) and centre (metres) as text."""
        return f"{self.size_text} cm at {self.center_text} m"

    @property
    def size_text(self) -> str:
        """Its size as text, centimetres."""
        return " x ".join(f"{side * 100:.1f}" for side in self.size)

    @property
    def center_text(self) -> str:
        """Its centre as text, metres."""
        return ", ".join(f"{value:z.2f}" for value in self.center)

    @property
    def up(self) -> Float64Array:
        """The box's third axis, (3,)."""
        return self.rotation[:, 2]

    @property
    def volume(self) -> float:
        """Volume in cubic metres."""
        return float(self.size[0] * self.size[1] * self.size[2])

    def foot_m(self, normal: Float64Array, offset: float) -> float:
        """Return the height, metres, of the box's foot above a parallel plane: normal (3,), normal.p + offset = 0."""
        return float(normal @ self.center) + offset - float(self.size[2]) / 2.0

    def contains(self, points: Float32Array | Float64Array, beyond_m: float) -> npt.NDArray[np.bool_]:
        """Return which points (N, 3) lie in the box, extended by `beyond_m` metres upwards and downwards, (N,)."""
        away = np.abs((points - self.center) @ self.rotation) - self.size / 2.0
        return np.asarray((away <= (0.0, 0.0, beyond_m)).all(1))

    def distances_m(self, points: Float64Array) -> Float64Array:
        """Return the distances of points (N, 3) from the box, metres, (N,); 0 inside."""
        beyond = np.abs((points - self.center) @ self.rotation) - self.size / 2.0
        return np.asarray(np.linalg.norm(np.maximum(beyond, 0.0), axis=-1))

    def distance_m(self, point: Float64Array) -> float:
        """Return the distance of a point (3,) from the box, metres; 0 inside."""
        return float(self.distances_m(point))

    def moved(self, T_new_old: Float64Array) -> Box:
        """Return the box after a rigid transform (4, 4)."""
        R = T_new_old[:3, :3]
        return Box(R @ self.center + T_new_old[:3, 3], self.size, R @ self.rotation)

    def corners(self) -> Float64Array:
        """Return the eight corners, (8, 3), in the order of `CORNER_SIGNS`."""
        return self.center + (CORNER_SIGNS * (self.size / 2.0)) @ self.rotation.T
