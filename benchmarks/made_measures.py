"""Made recordings of parcels and parts on a table, under a fixed camera or a hand-held one, with their true boxes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.geometry.box import Box
from cuboid.lab.synthetic.draft import Draft, add_room, finish
from cuboid.lab.synthetic.material import Material, Texture
from cuboid.lab.synthetic.mesh import box, lathe
from cuboid.lab.synthetic.paths import STILL, around, random_motion
from cuboid.lab.synthetic.placement import Arrangement
from cuboid.lab.synthetic.scene import Scene, Surface
from cuboid.lab.synthetic.sensors import SENSORS
from cuboid.lab.synthetic.shapes import Model
from cuboid.lab.synthetic.solids import displaced, rounded_box
from cuboid.lab.synthetic.view import SceneView

# Frames per second, and seconds of a fixed camera and of a hand-held round trip.
RATE_HZ, FIXED_S, ROUND_S = 10.0, 2.0, 9.0
# Range of a side, metres; no side is longer than this fraction of the distance, so that the image shows all of it.
SIDES_M, SIDE_FRACTION = (0.02, 0.6), 0.4
TABLE_M, FOCAL_PX, SIZE_PX = 0.7, 600.0, (640, 480)
COLORS = ((0.72, 0.55, 0.38), (0.85, 0.85, 0.82), (0.2, 0.35, 0.65), (0.7, 0.2, 0.15), (0.3, 0.5, 0.3))
DARK = ((0.06, 0.06, 0.07), (0.1, 0.09, 0.08))
TEXTURES = (Texture.PLAIN, Texture.MARBLE, Texture.PRINT, Texture.STRIPES, Texture.SPECKLE)
PRESETS = ("structured-light", "realsense-d435", "azure-kinect")
# Units of the stored depth, and noise of a color, levels of 255.
UNITS_PER_M, COLOR_NOISE = 10000.0, 2.0
VIEWS = ("above", "side", "hand")
# Sets of objects: boxes, cylinders and bags; or bodies of everyday use that have no box's shape.
PARCELS, CURVED = "parcels", "curved"
# The kinds of the second set, by the property that makes their boxes uncertain.
GROUPS = {
    "round": ("can", "ball"),
    "tapered": ("jar", "cup", "bowl", "bottle"),
    "soft-edged": ("soft box", "cushion"),
}


@dataclass(frozen=True, slots=True)
class Thing:
    """An object of a made recording.

    Attributes
    ----------
    box : Box
        True box, in the world.
    kind : str
        "box", "cylinder" or "bag", or one of `GROUPS`.
    touches : tuple of int
        Indices of the objects that touch it.
    """

    box: Box
    kind: str
    touches: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Made:
    """A made recording.

    Attributes
    ----------
    intrinsics : Intrinsics
    poses : (N, 4, 4) float64
        T_world_camera.
    depth_m : (N, H, W) float32
    color : (N, H, W, 3) uint8
    things : list of Thing
    """

    intrinsics: Intrinsics
    poses: npt.NDArray[np.float64]
    depth_m: npt.NDArray[np.float32]
    color: npt.NDArray[np.uint8]
    things: list[Thing]

    def frames(self, *, posed: bool) -> Iterator[Frame]:
        """Yield the frames, with their true poses or without."""
        for k, (depth_m, color) in enumerate(zip(self.depth_m, self.color, strict=True)):
            yield Frame(k, k / RATE_HZ, color, depth_m, self.poses[k] if posed else None)


def recording(work: Path, view: str, sensor: str, distance_m: float, seed: int, shapes: str = PARCELS) -> Made:
    """Return a made recording; it is rendered once and kept in `work`.

    Parameters
    ----------
    work : Path
    view : str
        One of `VIEWS`: fixed straight above, fixed at 45 degrees, or a hand-held round trip at 45 degrees.
    sensor : str
        One of `PRESETS`.
    distance_m : float
        From the camera to the highest top for "above", else to the middle of the objects.
    seed : int
    shapes : str
        `PARCELS` or `CURVED`.
    """
    scene = _scene(view, distance_m, seed, shapes)
    begin = "" if shapes == PARCELS else f"{shapes}-"
    intrinsics = scene.intrinsics(*SIZE_PX)
    place = {o.id: k for k, o in enumerate(scene.objects)}
    things = [Thing(scene.box(o), o.model.name, tuple(place[k] for k in o.touches)) for o in scene.objects]
    file = work / f"{begin}{view}-{sensor}-{distance_m}-{seed}.npz"
    if not file.is_file():
        work.mkdir(parents=True, exist_ok=True)
        _render(scene, intrinsics, {name: work / f"{begin}{view}-{name}-{distance_m}-{seed}.npz" for name in PRESETS})
    stored = np.load(file)
    poses = scene.T_world_camera[stored["frame"]]
    return Made(intrinsics, poses, stored["depth"].astype(np.float32) / UNITS_PER_M, stored["color"], things)


def _render(scene: Scene, intrinsics: Intrinsics, files: dict[str, Path]) -> None:
    """Render the frames for each sensor; a fixed camera sees the same in each frame, with fresh noise."""
    view, every = SceneView(scene, intrinsics), round(30.0 / RATE_HZ)
    fixed = scene.frames <= 30.0 * FIXED_S
    frames = [0] * round(RATE_HZ * FIXED_S) if fixed else list(range(0, scene.frames, every))
    rng, color, seen = np.random.default_rng(scene.seed), None, None
    colors: list[npt.NDArray[np.uint8]] = []
    depths: dict[str, list[npt.NDArray[np.uint16]]] = {name: [] for name in files}
    for frame in frames:
        if seen is None or color is None or not fixed:
            color, seen, _ = view.seen(frame)
        noisy = color + rng.normal(0.0, COLOR_NOISE, color.shape)
        colors.append(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
        for name in files:
            depth_m = SENSORS[name](seen, intrinsics, rng)
            depths[name].append(np.rint(np.minimum(depth_m * UNITS_PER_M, 65535)).astype(np.uint16))
    for name, file in files.items():
        np.savez(file, depth=np.array(depths[name]), color=np.array(colors), frame=np.array(frames))


def _scene(view: str, distance_m: float, seed: int, shapes: str) -> Scene:
    rng = np.random.default_rng([seed, round(1000 * distance_m), VIEWS.index(view), 7])
    frames = round(30.0 * (ROUND_S if view == "hand" else FIXED_S))
    draft = Draft(rng, frames, "handheld", (), [], Arrangement((), rng), np.empty((0, 6)))
    add_room(draft)
    half = np.array([0.8, 0.6])
    draft.objects = Arrangement((Surface("table", TABLE_M, np.zeros(2), half),), rng)
    draft.add(draft.make("table", x=1.6, y=1.2, height=TABLE_M), np.eye(4))
    longest = min(SIDES_M[1], SIDE_FRACTION * distance_m)
    within = 0.22 * distance_m / half
    touching = shapes == PARCELS and seed % 2 == 1
    for number in range(4):
        model = _model(rng, longest) if shapes == PARCELS else _curved(rng)
        others = draft.objects.objects
        if touching and number % 2 == 1 and others:
            draft.objects.put_beside(_box(rng, longest), others[-1], 0.0, 0.02)
        else:
            draft.objects.put_near(model, 0, 0.025, (0.0, 0.0), (float(within[0]), float(within[1])))
    tallest = max(float(o.mesh().vertices[:, 2].max()) for o in draft.objects.objects) - TABLE_M
    if view == "above":
        aim = np.array([0.0, 0.0, TABLE_M])
        eye = aim + np.array([1e-3, 0.0, tallest + distance_m])
        draft.waypoints = np.array([[*eye, *aim], [*(eye + 1e-4), *aim]])
        draft.style, draft.roll_rad, draft.whole = STILL, float(rng.uniform(-np.pi, np.pi)), True
    else:
        aim = np.array([0.0, 0.0, TABLE_M + tallest / 2])
        rise, start = distance_m * np.sqrt(0.5), rng.uniform(0, 2 * np.pi)
        turn = np.linspace(0, 2 * np.pi, 24) if view == "hand" else np.array([0.0, 1e-4])
        draft.waypoints = around(aim, start + turn, rise, float(aim[2]) + rise)
        if view == "side":
            draft.style = STILL
        draft.whole = True
    T_world_room = random_motion(rng)
    return finish(draft, f"measures {view} {distance_m} {seed}", "table", seed, T_world_room, FOCAL_PX)


def _side(rng: np.random.Generator, longest: float) -> float:
    return float(np.exp(rng.uniform(np.log(SIDES_M[0]), np.log(longest))))


def _look(rng: np.random.Generator) -> Material:
    colors = DARK if rng.random() < 0.2 else COLORS
    first, second = (colors[int(rng.integers(len(colors)))] for _ in range(2))
    return Material(first, second, TEXTURES[int(rng.integers(len(TEXTURES)))], 0.03, 0.1)


def _box(rng: np.random.Generator, longest: float) -> Model:
    x, y, z = (_side(rng, longest) for _ in range(3))
    return Model("box", ((box((x, y, z)), _look(rng)),))


def _model(rng: np.random.Generator, longest: float) -> Model:
    """Return a box (half of the draws), a cylinder or a bag."""
    draw = rng.random()
    if draw < 0.5:
        return _box(rng, longest)
    if draw < 0.75:
        radius, height = _side(rng, 0.7 * longest) / 2, _side(rng, longest)
        return Model("cylinder", ((lathe([(0, 0), (radius, 0), (radius, height), (0, height)]), _look(rng)),))
    x, y = max(0.06, _side(rng, longest)), max(0.06, _side(rng, longest))
    z = max(0.03, 0.4 * min(x, y))
    body = rounded_box((x, y, z), 0.3 * min(x, y), 0.45 * z)
    return Model("bag", ((displaced(body, rng, 0.02 * min(x, y), 0.05), _look(rng)),))


def _curved(rng: np.random.Generator) -> Model:
    """Return a body of everyday use that has no box's shape."""
    kind = str(rng.choice([kind for kinds in GROUPS.values() for kind in kinds]))
    r, h = float(rng.uniform(0.025, 0.05)), float(rng.uniform(0.06, 0.14))
    if kind == "soft box":
        x, y, z = rng.uniform(0.06, 0.16), rng.uniform(0.05, 0.12), rng.uniform(0.04, 0.12)
        edge = float(rng.uniform(0.2, 0.4)) * min(x, y, z)
        return Model(kind, ((rounded_box((x, y, z), edge, edge), _look(rng)),))
    if kind == "cushion":
        x, y = rng.uniform(0.1, 0.2), rng.uniform(0.08, 0.16)
        z = 0.4 * min(x, y)
        return Model(kind, ((rounded_box((x, y, z), 0.3 * min(x, y), 0.45 * z), _look(rng)),))
    if kind == "ball":
        angle = np.linspace(-np.pi / 2, np.pi / 2, 25)
        return Model(kind, ((lathe([(r * np.cos(a), r + r * np.sin(a)) for a in angle]), _look(rng)),))
    profile = {
        "can": [(0, 0), (r, 0), (r, h), (0, h)],
        "jar": [(0, 0), (r, 0), (r, 0.75 * h), (0.7 * r, 0.85 * h), (0.7 * r, h), (0, h)],
        "cup": [(0, 0), (0.7 * r, 0), (r, h), (0.93 * r, h), (0.65 * r, 0.06 * h), (0, 0.06 * h)],
        "bowl": [(0, 0), (0.5 * r, 0), (1.6 * r, 0.8 * r), (1.5 * r, 0.8 * r), (0.5 * r, 0.1 * r), (0, 0.1 * r)],
        "bottle": [(0, 0), (r, 0), (r, h), (0.35 * r, 1.4 * h), (0.35 * r, 1.7 * h), (0, 1.7 * h)],
    }[kind]
    return Model(kind, ((lathe(profile), _look(rng)),))
