"""Recordings that tempt a correction of given poses: things that move, sensors that err, and poses that do drift.

A table with four boxes before two walls, cast ray by ray, seen from an arc of 60 degrees, there and back.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache

import cv2
import numpy as np

from cuboid.ground.core.frame import Frame
from cuboid.ground.geometry import se3
from cuboid.ground.geometry.box import Box
from made_scenes import CAMERA, cast, look_at, upright

PLACE = [
    Box(np.array([0.0, 0.0, -0.02]), np.array([1.6, 1.2, 0.04]), np.eye(3)),
    upright((-0.35, 0.1), (0.2, 0.12, 0.25), 0.4),
    upright((0.1, -0.2), (0.15, 0.15, 0.1)),
    upright((0.4, 0.2), (0.1, 0.25, 0.18), 1.1),
    upright((-0.1, 0.35), (0.3, 0.08, 0.05), 0.2),
    Box(np.array([0.0, 0.0, -0.75]), np.array([6.0, 6.0, 0.1]), np.eye(3)),
    Box(np.array([0.0, 1.6, 0.5]), np.array([6.0, 0.1, 2.6]), np.eye(3)),
    Box(np.array([1.9, 0.0, 0.5]), np.array([0.1, 6.0, 2.6]), np.eye(3)),
]
FRAMES = 80
OUT = np.linspace(-30, 30, FRAMES // 2)
ANGLES = np.radians(np.concatenate([OUT, OUT[::-1]]))
TRUE = [look_at((1.3 * np.sin(a), -1.3 * np.cos(a), 0.8), (0.0, 0.0, 0.05)) for a in ANGLES]
# A mover is a box before the camera, this far away, metres; what it covers of the picture is its size.
MOVER_M = 0.7


@dataclass
class World:
    """What happens in a recording, and what its sensor and its poses have wrong.

    `mover` is the way of the box that moves, `covers` the fraction of the picture that it covers at `MOVER_M`.
    """

    mover: str | None = None
    covers: float = 0.3
    depth_factor: float = 1.0
    depth_late: int = 0
    depth_shift_px: int = 0
    color_shift_px: int = 0
    blur_px: int = 0
    brightness: float = 1.0
    repeated: bool = False
    contrast: float = 1.0
    given: list[np.ndarray] = field(default_factory=lambda: TRUE)

    def frames(self) -> Iterator[Frame]:
        for k in range(FRAMES):
            gray, depth = self._seen(k)
            if self.depth_late:
                depth = self._seen(max(0, k - self.depth_late))[1]
            depth = np.roll(depth * np.float32(self.depth_factor), self.depth_shift_px, axis=1)
            gray = np.roll(gray, self.color_shift_px, axis=1)
            if self.blur_px:
                gray = cv2.blur(gray, (self.blur_px, 1))
            gray = (gray * np.float32(self.brightness)).astype(np.uint8)
            yield Frame(k, k / 30, np.repeat(gray[..., None], 3, axis=2), depth, self.given[k])

    def _seen(self, k: int) -> tuple[np.ndarray, np.ndarray]:
        return seen(self.mover, self.covers, self.repeated, self.contrast, k)


@lru_cache(maxsize=FRAMES + 1)
def seen(kind: str | None, covers: float, repeated: bool, contrast: float, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Gray and depth (H, W) of frame k, noisy, by a camera with nothing wrong: many worlds in a row share them."""
    box = None if kind is None else mover(kind, covers, k)
    depth, gray = standing(min(k, FRAMES - 1 - k), repeated)
    if box is not None:
        near, hit = cast([box], TRUE[k])
        moving = (hit == 0) & ((near < depth) | (depth == 0))
        points = points_of(near, TRUE[k])[moving]
        depth, gray = np.where(moving, near, depth), gray.copy()
        gray[moving] = painted((points - box.center) @ box.rotation, repeated) - 20.0
    rng = np.random.default_rng(k)
    noisy = np.where(depth > 0, depth + rng.normal(size=depth.shape) * 1e-3 * depth**2, 0.0)
    gray = 128.0 + contrast * (gray - 128.0) + rng.normal(size=gray.shape) * 3.0
    return np.clip(gray, 0, 255).astype(np.float32), noisy.astype(np.float32)


@lru_cache(maxsize=FRAMES)
def standing(k: int, repeated: bool) -> tuple[np.ndarray, np.ndarray]:
    """Depth and gray (H, W) of what stands still, by the true pose of frame k."""
    depth, hit = cast(PLACE, TRUE[k])
    return depth, painted(points_of(depth, TRUE[k]), repeated) + hit * 7 % 40


def points_of(depth: np.ndarray, T_world_camera: np.ndarray) -> np.ndarray:
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    return se3.transform(T_world_camera, CAMERA.points(u, v, depth))


def painted(points: np.ndarray, repeated: bool) -> np.ndarray:
    """Gray of points (..., 3) of a surface: a pattern that is nowhere the same, or squares that repeat."""
    if repeated:
        return 90.0 + 80.0 * (np.floor(points / 0.06).astype(int).sum(-1) % 2)
    x, y, z = np.moveaxis(points, -1, 0)
    return 128 + 35 * np.sin(23 * x + 9 * y) + 35 * np.sin(31 * y - 12 * z + 1) + 25 * np.sin(17 * z + 13 * x + 2)


def mover(kind: str, covers: float, k: int) -> Box | None:
    """The box that moves, in frame k; None where it is not there."""
    across = np.sqrt(covers * CAMERA.width / CAMERA.fx * CAMERA.height / CAMERA.fy)
    side = MOVER_M * across / (1.0 + across / 8.0)  # its face is nearer than its middle by an eighth of its side
    place, turn, present = np.array([0.02, 0.01, MOVER_M]), 0.15, True
    if kind == "nearing":
        place[2] += 0.6 - 0.01 * k
        present = k < 30
    elif kind == "receding":
        place[2] += 0.01 * (k - 30)
        present = 30 <= k < 60
    elif kind == "slide":  # into the picture and out of it
        place[0] += 0.02 * (k - 40)
    elif kind == "slide from frame 0":
        place[0] += 0.004 * k - 0.1
    elif kind == "enter":
        place[0] += max(0.0, 0.6 - 0.03 * (k - 20))
        present = k >= 20
    elif kind == "turn":
        turn += 0.04 * k
    elif kind != "with the camera":
        raise ValueError(kind)
    if not present:
        return None
    T = TRUE[k] if kind in {"with the camera", "nearing", "receding"} else TRUE[0]
    if kind in {"slide", "enter", "turn"}:  # of the world: it stands where the camera looks half way
        T = TRUE[20]
    rotation = T[:3, :3] @ se3.exp(np.array([0, 0, 0, 0.0, turn, 0.0]))[:3, :3]
    return Box(se3.transform(T, place[None])[0], np.array([side, side, 0.25 * side]), rotation)


def small_motion(metres: tuple[float, float, float], radians: tuple[float, float, float]) -> np.ndarray:
    return se3.exp(np.array([*metres, *radians]))


def drifting(step_m: float, step_rad: float) -> list[np.ndarray]:
    """The true poses with an error that adds up, always the same way: what a gyroscope's bias leaves."""
    wrong, given = np.eye(4), []
    for T in TRUE:
        given.append(wrong @ T)
        wrong = wrong @ small_motion((step_m, 0.0, 0.0), (0.0, 0.0, step_rad))
    return given


def wandering(step_m: float) -> list[np.ndarray]:
    """The true poses with an error that is a random walk."""
    rng = np.random.default_rng(5)
    wrong, given = np.eye(4), []
    for T in TRUE:
        given.append(wrong @ T)
        wrong = wrong @ se3.exp(rng.normal(size=6) * step_m)
    return given


def jumping() -> list[np.ndarray]:
    jump = small_motion((0.05, 0.02, 0.0), (0.0, 0.0, 0.03))
    return [jump @ T if 30 <= k < 60 else T for k, T in enumerate(TRUE)]


MOVERS = {
    f"{kind} {covers:.0%}": World(kind, covers)
    for covers, kinds in (
        (0.3, ("slide", "turn", "with the camera")),
        (0.6, ("slide", "slide from frame 0", "enter", "nearing", "receding", "turn", "with the camera")),
    )
    for kind in kinds
}
SENSORS = {
    **{f"depth times {factor}": World(depth_factor=factor) for factor in (0.9, 0.95, 1.05, 1.1)},
    **{f"depth {late} frames late": World(depth_late=late) for late in (1, 3)},
    "depth 25 px beside": World(depth_shift_px=25),
    **{f"color {px} px beside": World(color_shift_px=px) for px in (5, 20, 60)},
    "blurred": World(blur_px=15),
    "dark": World(brightness=0.15),
    "repeated texture": World(repeated=True),
    "nothing wrong": World(),
}
DRIFTS = {
    "drift 1 mm": World(given=drifting(0.001, 0.001)),
    "drift 2 mm": World(given=drifting(0.002, 0.002)),
    "drift 0.5 mm": World(given=drifting(0.0005, 0.0005)),
    "walk": World(given=wandering(0.003)),
    "jump": World(given=jumping()),
    "drift 2 mm and a mover": World("slide", 0.1, given=drifting(0.002, 0.002)),
    "drift 2 mm and a large mover": World("slide", 0.3, given=drifting(0.002, 0.002)),
    "drift 1 mm and a large mover": World("slide", 0.3, given=drifting(0.001, 0.001)),
    "drift 2 mm and a mover that turns": World("turn", 0.3, given=drifting(0.002, 0.002)),
    "drift 1 mm and a mover that turns": World("turn", 0.3, given=drifting(0.001, 0.001)),
}
EXACT = {**MOVERS, **SENSORS}
