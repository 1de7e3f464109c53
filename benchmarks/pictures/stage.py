"""A scene in MuJoCo: things fall and come to rest, then color, depth and labels are drawn."""

from __future__ import annotations

import mujoco  # type: ignore[import-untyped]
import numpy as np
import numpy.typing as npt
from meshes import GLASS, SHINY, Floats, Part, Rng
from sensors import Exact

from scene import STRUCTURE, Body, Scene

WIDTH, HEIGHT = 640, 480
# Groups of geoms: drawn, and for contacts.
DRAWN, TOUCHED = 1, 3
DENSITY = 300.0


class Stage:
    """A compiled scene: settles, and draws color, depth, labels and materials for a camera."""

    def __init__(self, scene: Scene, focal_px: float) -> None:
        self.scene, self.focal_px = scene, focal_px
        self._keys: dict[int, str] = {}
        spec = mujoco.MjSpec()
        spec.worldbody.add_camera(name="eye", fovy=float(np.degrees(2 * np.arctan(HEIGHT / 2 / focal_px))))
        spec.option.timestep, spec.option.integrator = 0.002, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        self._labels: list[int] = []
        self._finishes: list[int] = []
        number = 0
        for body in scene.bodies:
            number += body.label == 1
            self._add_body(spec, body, number if body.label == 1 else body.label)
        for light in _lights(scene.rng):
            spec.worldbody.add_light(**light)
        self._visual(spec)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self._renderer: mujoco.Renderer | None = None

    def _visual(self, spec: mujoco.MjSpec) -> None:
        """Set depth range, shadows and ambient light; no antialiasing, which would mix labels."""
        visual, rng = spec.visual, self.scene.rng
        visual.global_.offwidth, visual.global_.offheight = WIDTH, HEIGHT
        visual.quality.shadowsize, visual.quality.offsamples = 4096, 0
        visual.headlight.ambient, visual.headlight.specular = [rng.uniform(0.12, 0.42)] * 3, [0] * 3
        visual.headlight.diffuse = [rng.uniform(0, 0.3)] * 3
        visual.map.znear, visual.map.zfar, visual.map.shadowscale = 0.05, 20.0, 0.8
        spec.stat.extent, spec.stat.center = 1.0, [0, 0, 0.8]

    def _material(self, spec: mujoco.MjSpec, part: Part) -> str:
        """Add a material once and return its name."""
        name = f"part{len(self._keys)}"
        alpha = 0.45 if part.finish == GLASS else 1.0
        material = spec.add_material(name=name, rgba=[*part.color, alpha])
        material.specular, material.shininess = (0.9, 0.7) if part.finish in (SHINY, GLASS) else (0.15, 0.3)
        if part.texture is not None:
            h, w = part.texture.shape[:2]
            texture = spec.add_texture(name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, width=w, height=h, nchannel=3)
            texture.data = np.ascontiguousarray(part.texture).tobytes()
            material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
        return name

    def _add_mesh(self, spec: mujoco.MjSpec, part: Part) -> str:
        """Add a drawn mesh and its material once and return their name."""
        if id(part) in self._keys:
            return self._keys[id(part)]
        name = self._material(spec, part)
        mesh = spec.add_mesh(name=name, uservert=part.vertices.ravel(), userface=part.faces.ravel())
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        if part.uv is not None:
            mesh.usertexcoord = part.uv.ravel()
            mesh.userfacetexcoord = (part.faces if part.uv_faces is None else part.uv_faces).ravel()
        self._keys[id(part)] = name
        return name

    def _add_body(self, spec: mujoco.MjSpec, body: Body, label: int) -> None:
        """Add a body: drawn meshes without contacts, hidden convex bodies with contacts."""
        quat = np.zeros(4)
        mujoco.mju_mat2Quat(quat, np.ascontiguousarray(body.turn).ravel())
        node = spec.worldbody.add_body(name=f"body{len(spec.worldbody.bodies)}", pos=body.position, quat=quat)
        for part in body.parts:
            name = self._add_mesh(spec, part)
            node.add_geom(
                type=mujoco.mjtGeom.mjGEOM_MESH,
                meshname=name,
                material=name,
                contype=0,
                conaffinity=0,
                group=DRAWN,
                mass=0,
            )
            self._labels.append(label)
            self._finishes.append(part.finish)
        for k, corners in enumerate(body.colliders):
            name = f"{node.name}-{k}"
            mesh = spec.add_mesh(name=name, uservert=corners.ravel(), maxhullvert=24)
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
            node.add_geom(
                type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, group=TOUCHED, friction=[0.8, 0.01, 0.001], mass=0
            )
            self._labels.append(label)
            self._finishes.append(0)
        if body.falls:
            _set_inertia(node, np.concatenate(body.colliders))
            node.add_freejoint()

    def settle(self, seconds: float) -> None:
        """Let the things fall and come to rest."""
        self.model.dof_damping[:] = 1e-3
        for _ in range(int(seconds / self.model.opt.timestep)):
            mujoco.mj_step(self.model, self.data)
        mujoco.mj_forward(self.model, self.data)

    def look(self, T_world_camera: Floats) -> None:
        """Point the camera along a pose (4, 4) with z forward and y down."""
        if self._renderer is None:
            self._renderer = mujoco.Renderer(self.model, HEIGHT, WIDTH)
            self._options = mujoco.MjvOption()
            self._options.geomgroup[:] = [0, 1, 0, 0, 0, 0]
        self.data.cam_xpos[0] = T_world_camera[:3, 3]
        self.data.cam_xmat[0] = (T_world_camera[:3, :3] * [1, -1, -1]).ravel()
        self._renderer.update_scene(self.data, "eye", self._options)

    def labels(self) -> tuple[npt.NDArray[np.uint16], npt.NDArray[np.uint8]]:
        """Return labels and finishes of the pixels, shape (480, 640)."""
        assert self._renderer is not None
        self._renderer.enable_segmentation_rendering()
        geom = self._renderer.render()[..., 0]
        self._renderer.disable_segmentation_rendering()
        labels = np.array([*self._labels, STRUCTURE], np.uint16)
        return labels[geom], np.array([*self._finishes, 0], np.uint8)[geom]

    def exact(self, finish: npt.NDArray[np.uint8]) -> Exact:
        """Draw color and depth of the present view."""
        assert self._renderer is not None
        color = self._renderer.render().astype(np.float32)
        self._renderer.enable_depth_rendering()
        depth = self._renderer.render().copy()
        self._renderer.disable_depth_rendering()
        depth[depth > 15] = 0
        return Exact(depth, finish, color)

    def close(self) -> None:
        """Free the renderer."""
        if self._renderer is not None:
            self._renderer.close()


def _set_inertia(node: mujoco.MjsBody, corners: Floats) -> None:
    """Give a body the mass and inertia of a block around its corners (n, 3)."""
    low, high = corners.min(0), corners.max(0)
    size = np.maximum(high - low, 0.008)
    mass = float(np.clip(DENSITY * np.prod(size), 0.02, 5))
    node.mass, node.ipos = mass, (low + high) / 2
    node.inertia = mass / 12 * ((size**2).sum() - size**2)
    node.explicitinertial = True


def _lights(rng: Rng) -> list[dict[str, object]]:
    """Draw one to three lamps under the ceiling, or a low one with hard shadows, warm or cold."""
    lamps: list[dict[str, object]] = []
    hard = rng.random() < 0.3
    for n in range(1 if hard else int(rng.integers(1, 4))):
        place = np.array([*rng.uniform(-1.8, 1.8, 2), rng.uniform(1.5, 2.4) if hard else rng.uniform(2.1, 2.5)])
        aim = np.array([*rng.uniform(-0.4, 0.4, 2), 0.6]) - place
        warm = rng.uniform(-0.1, 0.12)
        color = (
            rng.uniform(0.6, 0.95) if hard else rng.uniform(0.35, 0.6) if n == 0 else rng.uniform(0.1, 0.25)
        ) * np.array([1 + warm, 1, 1 - warm])
        lamps.append(
            {
                "pos": place,
                "dir": aim / np.linalg.norm(aim),
                "diffuse": color,
                "specular": 0.5 * color,
                "ambient": [0.02] * 3,
                "castshadow": n == 0 or rng.random() < 0.3,
                "cutoff": 62.0,
                "exponent": 0.4,
            }
        )
    return lamps
