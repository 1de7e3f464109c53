"""The mesh of an object: its views are fused, cropped to the object, closed on request, and colored."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.extras import require
from cuboid.ground.core.results import MapPoints, SupportPlane, TrackedObject
from cuboid.ground.geometry import se3
from cuboid.ground.geometry.box import Box
from cuboid.method.shapes.coloring import colors_of
from cuboid.method.shapes.fusion import PLANE_LAYER, TRUNCATION_VOXELS, Volume, fuse
from cuboid.method.shapes.mesh import EXTRA, ObjectMesh
from cuboid.method.shapes.views import MARGIN_M, ObjectView

# Maximum distance between the bottom of a box and the plane that it stands on, metres: two voxels of the map.
MAX_FOOT_M = 0.02
# Up to this height above the support, metres, readings may belong to the support: depth is noisy, and blurred at the
# rim where the object meets it.
SUPPORT_M = 0.005
# Maximum distance between a surface of the object and the object's map points, metres: two voxels of the map.
OWN_M = 0.02
# Minimum fraction of the seen surface for a separate piece of the mesh: smaller pieces are correlated errors of a few
# readings, or are entirely guessed.
MIN_PIECE = 0.02


def object_mesh(
    item: TrackedObject,
    views: Sequence[ObjectView],
    planes: Sequence[SupportPlane],
    points: MapPoints,
    *,
    close: bool = False,
    complete: bool = False,
) -> ObjectMesh:
    """Return the mesh of an object from its views.

    Parameters
    ----------
    item : TrackedObject
    views : sequence of ObjectView
    planes : sequence of SupportPlane
        `item.plane` is an index into them.
    points : MapPoints
        Labelled map points; they determine which surfaces belong to the object.
    close : bool
        Extend the walls down to the support, and close the bottom.
    complete : bool
        Close all holes: space within the box is solid unless a view saw it empty. This also closes the bottom.

    Raises
    ------
    MissingExtraError
        scikit-image is not installed.
    """
    measure = require("skimage.measure", "mesh", EXTRA)
    plane = None if item.plane is None else planes[item.plane]
    foot_m = _foot_m(item.box, plane)
    volume = fuse(views, item.box, foot_m)
    field, seen = _solid(volume, item, points)
    if field.min() >= 0 or not seen.any():
        return _empty(item, len(views))
    grid, faces, _, _ = measure.marching_cubes(field, 0.0, gradient_direction="descent")
    guessed = ~(_at(seen, np.floor(grid)) & _at(seen, np.ceil(grid)))
    foot = grid[:, 2] <= PLANE_LAYER + SUPPORT_M / volume.voxel_m
    vertices = se3.transform(volume.T_world_grid, grid * volume.voxel_m)
    mesh = ObjectMesh(
        item.label, item.name, vertices, faces.astype(np.int32), np.zeros((len(vertices), 3), np.uint8), guessed, 0
    )
    kept = _wanted(mesh, foot, close=close, complete=complete)
    whole = mesh.part(kept & _large_pieces(mesh, kept))
    rgb = colors_of(whole, views, item.mean_color)
    return ObjectMesh(item.label, item.name, whole.vertices, whole.faces, rgb, whole.guessed, len(views))


def _foot_m(box: Box, plane: SupportPlane | None) -> float:
    """Return the height of a box's bottom above its supporting plane, metres; 0 without a plane, or far from it."""
    if plane is None:
        return 0.0
    foot_m = box.foot_m(plane.normal, plane.offset)
    return foot_m if abs(foot_m) <= MAX_FOOT_M else 0.0


def _solid(volume: Volume, item: TrackedObject, points: MapPoints) -> tuple[Float32Array, npt.NDArray[np.bool_]]:
    """Return the signed distance (X, Y, Z), negative inside the solid object, and a mask (X, Y, Z) of the seen voxels.

    Unobserved voxels within the object's box are solid. The solid ends at the plane of the support. The layers just
    above the plane, where depth may show the support, are copies of the layer above them.
    """
    distance, seen, voxel_m = volume.distance.copy(), volume.seen.copy(), volume.voxel_m
    inside = _inside(volume, item.box)
    distance[~seen & ~inside] = 1.0
    foreign = _foreign(volume, seen & (np.abs(distance) < 1.0), item, points)
    distance[foreign], seen[foreign] = 1.0, False
    above = int(np.ceil(PLANE_LAYER + SUPPORT_M / voxel_m))
    distance[:, :, :above], seen[:, :, :above] = distance[:, :, above : above + 1], False
    height_m = (np.arange(distance.shape[2]) - PLANE_LAYER) * voxel_m
    field = np.maximum(distance, (-height_m / (TRUNCATION_VOXELS * voxel_m)).astype(np.float32))
    # The border of the volume is air, so that a solid that reaches it has a surface there.
    for axis in range(3):
        for side in (0, -1):
            np.moveaxis(field, axis, 0)[side] = 1.0
            np.moveaxis(seen, axis, 0)[side] = False
    return field, seen


def _inside(volume: Volume, box: Box) -> npt.NDArray[np.bool_]:
    """Return a mask (X, Y, Z) of the voxels inside or below a box that is aligned with the volume."""
    T = volume.T_world_grid
    origin = box.rotation.T @ (T[:3, 3] - box.center)
    x, y, z = (origin[axis] + np.arange(n) * volume.voxel_m for axis, n in enumerate(volume.distance.shape))
    half = box.size / 2.0
    level = (np.abs(x) <= half[0])[:, None] & (np.abs(y) <= half[1])[None, :]
    return np.asarray(level[:, :, None] & (z <= half[2])[None, None, :])


def _foreign(
    volume: Volume, band: npt.NDArray[np.bool_], item: TrackedObject, points: MapPoints
) -> npt.NDArray[np.bool_]:
    """Return a mask (X, Y, Z) of the voxels in `band` far from the object's points, or nearer to another object's."""
    from scipy.spatial import cKDTree

    reach = replace(item.box, size=item.box.size + 2 * (MARGIN_M + OWN_M))
    around = reach.contains(points.xyz, MARGIN_M)
    of_item = points.xyz[around & (points.label == item.label)]
    others = points.xyz[around & (points.label != item.label) & (points.label > 0)]
    foreign = np.zeros(band.shape, np.bool_)
    if not len(of_item):
        return foreign
    places = se3.transform(volume.T_world_grid, np.argwhere(band) * volume.voxel_m)
    distance = cKDTree(of_item).query(places, distance_upper_bound=OWN_M)[0]
    away = ~np.isfinite(distance)
    if len(others):
        away |= cKDTree(others).query(places, distance_upper_bound=OWN_M)[0] < distance
    foreign[band] = away
    return foreign


def _at(values: npt.NDArray[np.bool_], grid: Float64Array) -> npt.NDArray[np.bool_]:
    i, j, k = grid.astype(np.int64).T
    return np.asarray(values[i, j, k])


def _wanted(mesh: ObjectMesh, foot: npt.NDArray[np.bool_], *, close: bool, complete: bool) -> npt.NDArray[np.bool_]:
    """Return a mask (F,) of the requested faces: seen faces, with `close` also the bottom, with `complete` all."""
    if complete:
        return np.ones(len(mesh.faces), np.bool_)
    seen = ~mesh.guessed_faces
    if not close:
        return seen
    at_foot = (foot | ~mesh.guessed)[mesh.faces].all(axis=1)
    return seen | at_foot


def _large_pieces(mesh: ObjectMesh, kept: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Return a mask (F,) of the kept faces that belong to sufficiently large pieces."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    faces = mesh.faces[kept]
    large = np.zeros(len(mesh.faces), np.bool_)
    if not len(faces):
        return large
    ends = np.concatenate([faces[:, :2], faces[:, 1:]])
    count = len(mesh.vertices)
    graph = coo_array((np.ones(len(ends), np.int8), (ends[:, 0], ends[:, 1])), shape=(count, count))
    piece = connected_components(graph, directed=False)[1][faces[:, 0]]
    seen = ~mesh.guessed_faces[kept]
    sizes = np.bincount(piece, seen)
    large[kept] = sizes[piece] >= MIN_PIECE * seen.sum()
    return large


def _empty(item: TrackedObject, views: int) -> ObjectMesh:
    none = np.zeros((0, 3))
    return ObjectMesh(
        item.label,
        item.name,
        none,
        none.astype(np.int32),
        none.astype(np.uint8),
        np.zeros(0, np.bool_),
        views,
    )
