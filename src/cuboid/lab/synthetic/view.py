"""A scene ready for rendering: its triangles, and the object of each triangle.

Rays are cast in the room frame, where walls and tops are aligned with the axes: their bounding boxes are thin, and rays
are three times as fast as in the rotated world.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.geometry import se3
from cuboid.lab.synthetic.mesh import Mesh, corner_normals, merged, sample_surface
from cuboid.lab.synthetic.raycast import SHADOW_BIAS_M, Hits, RayCaster, pixel_rays
from cuboid.lab.synthetic.scene import Placed, Scene, SceneObject
from cuboid.lab.synthetic.sensor_effects import Seen
from cuboid.lab.synthetic.sensors import SENSORS
from cuboid.lab.synthetic.shading import ShadingParameters, part_rows, shade

# Number of sample points on an object's surface for its visible fraction: a fraction of 0.05 has 30 points.
SURFACE_POINTS = 600
# Directions, from level to straight above, from which the visible part of an object's surface is determined: the inside
# of a hollow body and the bottom face cannot be seen.
_BEARINGS = np.arange(0, 2 * np.pi, np.pi / 6)
_VIEWS = np.array(
    [[np.cos(b) * np.cos(e), np.sin(b) * np.cos(e), np.sin(e)] for e in (0.02, 0.5, 1.0) for b in _BEARINGS]
    + [[0.0, 0.0, 1.0]]
)
RAY_END_M = 3.0
# Maximum difference between true depth and a point's depth for the point to be visible, metres.
AGREES_M = 0.02
# A mirroring face has a normal within 8 degrees of up; faces are distinguished by height to this accuracy, metres.
LEVEL_COSINE, LEVEL_M = 0.99, 2e-3
# In each patch of a mirroring face, depth is that of the face or of its mirror image: side of a patch, metres, and
# number of different patches.
MIRROR_PATCH_M, PATCHES = 0.03, 64
# Maximum distance from the face of a mirror image in depth, metres: a farther one is too faint for the sensor.
MIRRORED_M = 0.15
UPSIDE_DOWN = np.array([1, 1, -1], np.float32)
# Steps of the visible fraction.
FRACTION_STEPS = 20


@dataclass(frozen=True, slots=True)
class Rendered:
    """A frame of a scene.

    Attributes
    ----------
    color : (H, W, 3) uint8
        RGB.
    depth_m : (H, W) float32
        Depth as measured by the sensor.
    hits : Hits
        The true first hits.
    """

    color: UInt8Array
    depth_m: Float32Array
    hits: Hits


class SceneView:
    """A scene that can be rendered.

    Parameters
    ----------
    scene : Scene
    intrinsics : Intrinsics
    """

    def __init__(self, scene: Scene, intrinsics: Intrinsics) -> None:
        self._seed = scene.seed
        self._poses = scene.T_room_camera
        self._intrinsics = intrinsics
        self._placed = scene.placed
        self._moves = any(body.path is not None for body in self._placed)
        parts = [(body, part) for body in self._placed for part in body.model.parts]
        materials = [material for _, (_, material) in parts]
        faces = [len(mesh.faces) for _, (mesh, _) in parts]
        labels = [body.id if isinstance(body, SceneObject) else 0 for body, _ in parts]
        self.face_label: npt.NDArray[np.int32] = np.repeat(np.array(labels, np.int32), faces)
        moving = [body.path is not None for body, _ in parts]
        self.face_moves: npt.NDArray[np.bool_] = np.repeat(np.array(moving, np.bool_), faces)
        self._face_part = np.repeat(np.arange(len(parts), dtype=np.int32), faces)
        self._materials, self._light, self._camera = materials, scene.light, scene.color_camera
        # Mesh of each part in its current pose, with the normals of its corners.
        self._standing: dict[int, tuple[Mesh, Float32Array]] = {}
        self._stand(0)
        self._mirrors = np.array([material.mirror for material in materials], np.float32)
        self._patches = np.random.default_rng([scene.seed, 3]).random((PATCHES, PATCHES), np.float32)
        self._objects = scene.objects
        self._surfaces = [_surface(scene, body) for body in scene.objects]
        self._ghosts = [_surface(scene, body) for body in scene.ghosts]

    def _stand(self, frame: int) -> None:
        """Move all bodies to their poses in a frame."""
        parts, poses = [], []
        every = [(body, mesh) for body in self._placed for mesh, _ in body.model.parts]
        for k, (body, mesh) in enumerate(every):
            if body.path is not None or k not in self._standing:
                there = mesh.moved(body.at(frame).T_room_model)
                self._standing[k] = there, corner_normals(there).astype(np.float32)
            parts.append(self._standing[k])
            poses.append(se3.inverse(body.at(frame).T_room_model))
        self._caster = RayCaster(merged(mesh for mesh, _ in parts).corners())
        rows, layers = part_rows(self._materials, poses)
        normals = np.concatenate([normals for _, normals in parts])
        self._look = ShadingParameters(self._face_part, normals, rows, layers, self._light)

    def render(self, frame: int, sensor: str) -> Rendered:
        """Render a frame with one of `SENSORS`."""
        color, seen, hits = self.seen(frame)
        depth_rng = np.random.default_rng([self._seed, frame, 1])
        return Rendered(color, SENSORS[sensor](seen, self._intrinsics, depth_rng), hits)

    def seen(self, frame: int) -> tuple[UInt8Array, Seen, Hits]:
        """Return a frame before the sensor: its color (H, W, 3), what a sensor sees, and the true first hits."""
        if self._moves:
            self._stand(frame)
        T = self._poses[frame]
        rays = pixel_rays(self._intrinsics, T)
        hits = self._caster.first_hits(T[:3, 3].astype(np.float32), rays)
        color_rng = np.random.default_rng([self._seed, frame, 0])
        shaded = shade(self._caster, self._look, hits, color_rng, self._camera, frame)
        color, true_m = self._mirrored(hits, shaded.color, frame)
        return color, Seen(true_m, shaded.cosine, shaded.albedo, self._shine(hits)), hits

    def _shine(self, hits: Hits) -> Float32Array:
        """Return the strength of the highlight of each pixel's surface, (H, W)."""
        shine = self._look.parts[:, 8].astype(np.float32)
        return np.where(hits.face >= 0, shine[self._look.face_part[hits.face]], np.float32(0))

    def _mirrored(self, hits: Hits, color: UInt8Array, frame: int) -> tuple[UInt8Array, Float32Array]:
        """Return color and depth with mirror images in level faces; their depth is below the face."""
        rng = np.random.default_rng([self._seed, frame, 2])
        part = np.where(hits.face >= 0, self._look.face_part[hits.face], 0)
        mirror = np.where(hits.face >= 0, self._mirrors[part], np.float32(0))
        mirror = np.where(self._look.normals[hits.face, 0, 2] > LEVEL_COSINE, mirror, np.float32(0))
        depth_m = hits.depth_m
        if not mirror.any():
            return color, depth_m
        points = hits.eye + depth_m[..., None] * hits.rays
        cell = np.floor(points / MIRROR_PATCH_M).astype(np.int64) % len(self._patches)
        read = self._patches[cell[..., 0], cell[..., 1]] < mirror
        for height_m in np.unique(np.round(points[..., 2][mirror > 0], 3)):
            eye, rays = hits.eye * UPSIDE_DOWN + np.array([0, 0, 2 * height_m], np.float32), hits.rays * UPSIDE_DOWN
            image = self._caster.first_hits(eye, rays, depth_m + np.float32(SHADOW_BIAS_M))
            there = (mirror > 0) & (np.abs(points[..., 2] - height_m) < LEVEL_M) & (image.face >= 0)
            image = replace(image, face=np.where(there, image.face, np.int32(-1)))
            shown = shade(self._caster, self._look, image, rng, self._camera, frame).color
            share = np.where(there, mirror, np.float32(0))[..., None]
            color = np.rint(color * (1 - share) + shown * share).astype(np.uint8)
            near = (image.depth_m - depth_m) * np.linalg.norm(hits.rays, axis=-1) < MIRRORED_M
            depth_m = np.where(there & read & near, image.depth_m, depth_m)
        return color, depth_m

    def labels(self, hits: Hits) -> npt.NDArray[np.int32]:
        """Return the object id of each pixel, (H, W) int32, 0 for none."""
        return np.where(hits.face >= 0, self.face_label[hits.face], 0).astype(np.int32)

    def visible_fractions(self, frame: int, hits: Hits) -> Float64Array:
        """Return for each object the visible fraction of its points that face the camera, in steps of 0.05."""
        T_camera_room = se3.inverse(self._poses[frame])
        return np.array(
            [
                self._share(points, normals, T_camera_room @ _moved_since(body, frame), hits)
                for body, (points, normals) in zip(self._objects, self._surfaces, strict=True)
            ]
        )

    def empty_fractions(self, frame: int, hits: Hits) -> Float64Array:
        """Return for each ghost the fraction of its camera-facing points at or behind which a surface is seen."""
        T_camera_room = se3.inverse(self._poses[frame])
        return np.array([self._share(*ghost, T_camera_room, hits, through=True) for ghost in self._ghosts])

    def _share(
        self,
        points: Float64Array,
        normals: Float64Array,
        T_camera_room: Float64Array,
        hits: Hits,
        *,
        through: bool = False,
    ) -> float:
        seen_from = se3.transform(T_camera_room, points)
        facing = np.einsum("ij,ij->i", seen_from, normals @ T_camera_room[:3, :3].T) < 0
        if not facing.any():
            return 0.0
        k = self._intrinsics
        front = seen_from[facing & (seen_from[:, 2] > 0.05)]
        x, y = np.rint(k.pixels(front)).T
        inside = (x >= 0) & (x < k.width) & (y >= 0) & (y < k.height)
        depth = hits.depth_m[y[inside].astype(np.int64), x[inside].astype(np.int64)]
        off = depth - front[inside, 2]
        agrees = (off >= -AGREES_M if through else np.abs(off) <= AGREES_M) & (depth > 0)
        return round(float(agrees.sum() / facing.sum()) * FRACTION_STEPS) / FRACTION_STEPS


def _moved_since(body: Placed, frame: int) -> Float64Array:
    """Return the motion (4, 4) in the room from a body's final pose to its pose in a frame."""
    if body.path is None:
        return np.eye(4)
    return np.asarray(body.path[frame] @ se3.inverse(body.T_room_model))


def _surface(scene: Scene, body: SceneObject) -> tuple[Float64Array, Float64Array]:
    """Return points of an object's surface that are visible from outside, and their normals."""
    mesh = body.mesh()
    rng = np.random.default_rng([scene.seed, body.id])
    points, normals = sample_surface(mesh, 4 * SURFACE_POINTS, rng)
    alone, seen = RayCaster(mesh.corners()), np.zeros(len(points), np.bool_)
    start = (points + SHADOW_BIAS_M * normals).astype(np.float32)
    for direction in _VIEWS:
        facing = np.flatnonzero(~seen & (normals @ direction > 0.1))
        seen[facing] = alone.reaches(start[facing], start[facing] + RAY_END_M * direction.astype(np.float32)) > 0
    kept = np.flatnonzero(seen)[:: max(1, int(seen.sum()) // SURFACE_POINTS)]
    return points[kept], normals[kept]
