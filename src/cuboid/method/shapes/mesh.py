"""The mesh of an object: triangles with colors, each measured or guessed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array, UInt8Array
from cuboid.ground.core.extras import require
from cuboid.ground.geometry import se3

EXTRA = "shapes"


@dataclass(frozen=True, slots=True, eq=False)
class ObjectMesh:
    """The surface of an object.

    Attributes
    ----------
    label : int
    name : str or None
    vertices : (V, 3) float64
        World, metres.
    faces : (F, 3) int32
        Rows of `vertices`, counter-clockwise seen from outside.
    rgb : (V, 3) uint8
    guessed : (V,) bool
        Whether no camera saw the vertex: it lies in a closed bottom or in a filled hole.
    views : int
        Number of fused views.
    """

    label: int
    name: str | None
    vertices: Float64Array
    faces: npt.NDArray[np.int32]
    rgb: UInt8Array
    guessed: npt.NDArray[np.bool_]
    views: int

    def __repr__(self) -> str:
        guessed = f", {self.guessed_faces.mean():.0%} guessed" if self.guessed.any() else ""
        return f"ObjectMesh(#{self.label}: {len(self.faces)} faces from {self.views} views{guessed})"

    @property
    def guessed_faces(self) -> npt.NDArray[np.bool_]:
        """Faces (F,) with a guessed vertex."""
        return np.asarray(self.guessed[self.faces].any(axis=1))

    def moved(self, T: Float64Array) -> ObjectMesh:
        """Return the mesh after a rigid motion `T` (4, 4)."""
        return replace(self, vertices=se3.transform(T, self.vertices))

    def part(self, faces: npt.NDArray[np.bool_]) -> ObjectMesh:
        """Return the mesh of the faces in a mask (F,), without unused vertices."""
        kept, rows = np.unique(self.faces[faces], return_inverse=True)
        return ObjectMesh(
            self.label,
            self.name,
            self.vertices[kept],
            rows.reshape(-1, 3).astype(np.int32),
            self.rgb[kept],
            self.guessed[kept],
            self.views,
        )

    def to_trimesh(self) -> Any:
        """Return the mesh as `trimesh.Trimesh` with vertex colors, in the world; its method `export` writes files.

        The `vertex_attributes` contain "guessed", which a PLY file keeps.

        Raises
        ------
        MissingExtraError
            trimesh is not installed.
        """
        trimesh = require("trimesh", "ObjectMesh.to_trimesh", EXTRA)
        guessed = {"guessed": self.guessed.astype(np.uint8)}
        return trimesh.Trimesh(
            self.vertices, self.faces, vertex_colors=self.rgb, vertex_attributes=guessed, process=False
        )
