"""PLY: the points of each object in a file of its own, and all boxes as a mesh with edges.

A folder with

- ``object_001.ply`` and so on: the map's points of the object with that label, in the layout of ``map.ply``;
- ``boxes.ply``: eight corners a box in its label's color, six outward faces, twelve edges; ``label`` a corner.

Metres, in the world.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from cuboid.ground.core.palette import color_of
from cuboid.ground.core.results import TrackedObject
from cuboid.ground.geometry.box import EDGES
from cuboid.results.files import Results, write_map

# Corners of each face in the order of `Box.corners`, counter-clockwise seen from outside.
OUTWARD_FACES = ((0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6))

CORNER = np.dtype([("xyz", "<f4", 3), ("rgb", "u1", 3), ("label", "<i4")])
FACE = np.dtype([("count", "u1"), ("corners", "<i4", 4)])
EDGE = np.dtype([("ends", "<i4", 2)])  # without a color: trimesh reads only such


def write(run: Results, folder: Path) -> list[str]:
    """Write the files into a folder."""
    objects, points = run.found.objects, run.map_points()
    digits = max(3, len(str(max((item.label for item in objects), default=0))))
    for item in objects:
        write_map(folder / f"object_{item.label:0{digits}d}.ply", points.of_object(item.label))
    (folder / "boxes.ply").write_bytes(boxes_ply(objects))
    return []


def boxes_ply(objects: tuple[TrackedObject, ...]) -> bytes:
    """Return the boxes of objects as a binary PLY of corners, faces and edges."""
    first = 8 * np.arange(len(objects))[:, None, None]
    corners: npt.NDArray[np.void] = np.zeros(8 * len(objects), CORNER)
    faces: npt.NDArray[np.void] = np.zeros(6 * len(objects), FACE)
    edges: npt.NDArray[np.void] = np.zeros(12 * len(objects), EDGE)
    if objects:
        colors = np.array([color_of(item.label) for item in objects], np.uint8)
        corners["xyz"] = np.concatenate([item.box.corners() for item in objects])
        corners["rgb"] = np.repeat(colors, 8, axis=0)
        corners["label"] = np.repeat([item.label for item in objects], 8)
        faces["count"] = 4
        faces["corners"] = (first + np.array(OUTWARD_FACES)).reshape(-1, 4)
        edges["ends"] = (first + np.array(EDGES)).reshape(-1, 2)
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(corners)}",
        *(f"property float {axis}" for axis in "xyz"),
        *(f"property uchar {color}" for color in ("red", "green", "blue")),
        "property int label",
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        f"element edge {len(edges)}",
        "property int vertex1",
        "property int vertex2",
        "end_header",
    ]
    return ("\n".join(header) + "\n").encode("ascii") + corners.tobytes() + faces.tobytes() + edges.tobytes()
