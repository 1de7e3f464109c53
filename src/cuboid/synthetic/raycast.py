"""First hits of all pixels of a camera, by Embree."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.frame import Float32Array, Float64Array, Intrinsics

# A shadow ray starts this far off its surface, metres: single precision at 5 m is 0.5 micrometres.
SHADOW_BIAS_M = 2e-3


@dataclass(frozen=True, slots=True)
class Hits:
    """What the pixels of an image see.

    Attributes
    ----------
    depth_m : (H, W) float32
        Along the optical axis; 0 where nothing is hit.
    face : (H, W) int32
        -1 where nothing is hit.
    u, v : (H, W) float32
        Barycentric coordinates: weights of the face's second and third corner.
    """

    depth_m: Float32Array
    face: npt.NDArray[np.int32]
    u: Float32Array
    v: Float32Array


class RayCaster:
    """Triangles that rays can be cast against.

    Parameters
    ----------
    corners : (F, 3, 3) float64
        Of the faces, metres.
    """

    def __init__(self, corners: Float64Array) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self._scene = EmbreeScene()
        TriangleMesh(self._scene, np.ascontiguousarray(corners, np.float32))

    def first_hits(self, intrinsics: Intrinsics, T_world_camera: Float64Array) -> Hits:
        """Cast a ray through the centre of each pixel."""
        shape = (intrinsics.height, intrinsics.width)
        # Rays of unit depth: the parameter of a hit is its depth.
        directions = pixel_rays(intrinsics).reshape(-1, 3) @ T_world_camera[:3, :3].T.astype(np.float32)
        origins = np.broadcast_to(T_world_camera[:3, 3].astype(np.float32), directions.shape)
        hit = self._scene.run(np.ascontiguousarray(origins), np.ascontiguousarray(directions), output=True)
        face = hit["primID"].reshape(shape)
        depth = np.where(face >= 0, hit["tfar"].reshape(shape), np.float32(0))
        return Hits(depth, face, hit["u"].reshape(shape), hit["v"].reshape(shape))

    def reaches(self, points: Float32Array, light: Float64Array) -> npt.NDArray[np.uint8]:
        """Tell for points (N, 3) whether nothing lies between them and a light (3,): 1 or 0."""
        towards = light.astype(np.float32) - points
        blocked = self._scene.run(points, towards, dists=np.ones(len(points), np.float32), query="OCCLUDED")
        return (blocked != 0).astype(np.uint8)


def pixel_rays(intrinsics: Intrinsics) -> Float32Array:
    """Return the point at depth 1 of each pixel in camera coordinates, (H, W, 3)."""
    rays = np.ones((intrinsics.height, intrinsics.width, 3), np.float32)
    rays[..., 0] = (np.arange(intrinsics.width) - intrinsics.cx) / intrinsics.fx
    rays[..., 1] = ((np.arange(intrinsics.height) - intrinsics.cy) / intrinsics.fy)[:, None]
    return rays
