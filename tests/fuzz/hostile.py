"""Sequences of frames that a sensor gone mad, or a user who means ill, would give; the same seed gives the same frames.

    for item in hostile(seed).frames(100):
        tracker.update(item.frame) if item.frame is not None else ...   # item.refused: why it is no frame

A sequence is a room with a table and boxes on it, seen from a moving camera, in stretches of a few frames each of which
goes wrong in a way of its own (`KINDS`). Size, focal length and scene are drawn per sequence.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba import njit

from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.frame import Frame, Intrinsics

Array = np.ndarray[Any, np.dtype[Any]]

KINDS = (
    "calm", "noise", "blocks", "flat", "empty", "near", "far", "no numbers", "spikes", "stripes", "stairs", "teleport",
    "wrong pose", "upside down", "spin", "scaled pose", "sheared pose", "mirrored pose", "pose of no numbers",
    "far away", "drift", "moved", "swapped", "crowd", "frozen", "time",
)  # fmt: skip
SIZES = ((160, 120), (160, 120), (320, 240), (640, 480), (64, 48), (1, 1), (3, 200), (200, 3), (7, 5), (1280, 720))
LONGEST_STRETCH = 25
# Readings of 256 that there are none of.
MISSING = 8
TABLE_M, FLOOR_M, WALL_M = 0.0, -0.75, 2.5


@dataclass
class Item:
    """A frame, or why it is none.

    Attributes
    ----------
    kind : str
        What is wrong with it, of `KINDS`.
    frame : Frame or None
    refused : str
    """

    kind: str
    frame: Frame | None
    refused: str = ""


@dataclass
class Hostile:
    """A sequence.

    Attributes
    ----------
    seed : int
    intrinsics : Intrinsics
    """

    seed: int
    intrinsics: Intrinsics
    rng: np.random.Generator
    boxes: Array = field(default_factory=lambda: np.zeros((0, 6)))  # low and high corners

    def frames(self, count: int) -> Iterator[Item]:
        """Yield so many frames."""
        kind, left, begun, angle = "calm", int(self.rng.integers(0, 12)), 0, float(self.rng.uniform(0, 6.28))
        frozen: tuple[Array, Array, Array] | None = None
        for index in range(count):
            if left == 0:
                kind = KINDS[int(self.rng.integers(len(KINDS)))]
                left, begun, frozen = int(self.rng.integers(1, LONGEST_STRETCH)), index, None
                self._change(kind)
            left -= 1
            angle += float(self.rng.normal(0.02, 0.01)) * (20 if kind == "spin" else 1)
            T = self._seen_from(angle, kind)
            if kind == "frozen" and frozen is not None:
                color, depth, T = frozen
            else:
                color, depth = self._readings(self._rendered(T), kind)
            frozen = color, depth, T
            time_s = float(self.rng.uniform(-1, 1)) if kind == "time" else index / 30
            yield self._item(index, time_s, kind, color, depth, self._told(T, kind, index - begun))

    def _item(self, index: int, time_s: float, kind: str, color: Array, depth: Array, T: Array) -> Item:
        try:
            return Item(kind, Frame(index, time_s, color, depth, T))
        except FrameError as error:
            return Item(kind, None, str(error))

    def _change(self, kind: str) -> None:
        """Change the scene as a stretch of this kind begins."""
        if kind == "moved" and len(self.boxes):
            self.boxes[0, [0, 1, 3, 4]] += np.tile(self.rng.uniform(-0.3, 0.3, 2), 2)
        elif kind == "swapped" and len(self.boxes) > 1:
            middle = (self.boxes[:2, :2] + self.boxes[:2, 3:5]) / 2
            self.boxes[0, [0, 1, 3, 4]] += np.tile(middle[1] - middle[0], 2)
            self.boxes[1, [0, 1, 3, 4]] += np.tile(middle[0] - middle[1], 2)
        elif kind == "crowd":
            self.boxes = _boxes(self.rng, int(self.rng.integers(10, 40)))

    def _seen_from(self, angle: float, kind: str) -> Array:
        """Return T_world_camera of a camera that looks at the table."""
        if kind == "teleport":
            angle = float(self.rng.uniform(0, 6.28))
        place = np.array([1.3 * np.cos(angle), 1.3 * np.sin(angle), 0.9])
        z = -place / np.linalg.norm(place)
        x = np.cross(z, (0.0, 0.0, 1.0))
        x /= np.linalg.norm(x)
        if kind == "upside down":
            x = -x
        T = np.eye(4)
        T[:3] = np.column_stack((x, np.cross(z, x), z, place))
        return T

    def _told(self, T: Array, kind: str, since: int) -> Array:
        """Return the pose that comes with the frame."""
        T = T.copy()
        match kind:
            case "wrong pose":
                T[:3, 3] += self.rng.normal(0, 0.5, 3)
            case "scaled pose":
                T[:3, :3] *= self.rng.choice((0.9, 0.999, 1.001, 1.01, 1.07, 1e-3, 1e3))
            case "sheared pose":
                T[0, 1] += self.rng.choice((0.004, 0.05, 0.5))
            case "mirrored pose":
                T[:3, 0] *= -1
            case "pose of no numbers":
                T[self.rng.integers(4), self.rng.integers(4)] = self.rng.choice((np.nan, np.inf, 1e300))
            case "far away":
                T[:3, 3] += self.rng.choice((1e3, 1e5, 9e5, 1e9))
            case "drift":
                T[:3, 3] += 0.03 * since
        return T

    def _rendered(self, T: Array) -> tuple[Array, Array]:
        """Return color and depth of the room; the floor, the table, four walls and the boxes."""
        K = self.intrinsics
        room = np.array([[-WALL_M, -WALL_M, FLOOR_M, WALL_M, WALL_M, 3.0]])
        table = np.array([[-0.7, -0.5, -0.03, 0.7, 0.5, TABLE_M]])
        depth, number = np.empty((K.height, K.width), np.float32), np.empty((K.height, K.width), np.uint8)
        _cast(np.concatenate((room, table, self.boxes)), T, np.array([K.fx, K.fy, K.cx, K.cy]), depth, number)
        palette = np.random.default_rng(self.seed).integers(0, 256, (256, 3), np.uint8)
        return palette.take(number, axis=0), depth

    def _readings(self, seen: tuple[Array, Array], kind: str) -> tuple[Array, Array]:
        """Return what the sensor makes of it."""
        (color, depth), rng = seen, self.rng
        depth = depth + np.float32(0.002) * rng.standard_normal(depth.shape, np.float32) * depth
        depth[rng.integers(0, 256, depth.shape, np.uint8) < MISSING] = 0
        match kind:
            case "noise":
                depth = rng.uniform(0, 5, depth.shape).astype(np.float32)
                color = rng.integers(0, 256, color.shape, dtype=np.uint8)
            case "blocks":
                rows, columns = (np.arange(side) // int(rng.integers(2, 12)) for side in depth.shape)
                cells = rng.uniform(0.5, 3, (rows[-1] + 1, columns[-1] + 1))
                depth = cells[np.ix_(rows, columns)].astype(np.float32)
            case "flat":
                depth[:] = rng.uniform(0.3, 4)
            case "empty":
                depth[:] = 0
            case "near":
                depth = (depth * 1e-4).astype(np.float32)
            case "far":
                depth = (depth * 1e4).astype(np.float32)
            case "no numbers":
                bad = np.array((np.nan, np.inf, -np.inf, -1.0, 3e38), np.float32)
                chosen = rng.random(depth.shape) < rng.choice((0.01, 0.5, 1.0))
                depth[chosen] = rng.choice(bad, int(chosen.sum()))
            case "spikes":
                chosen = rng.random(depth.shape) < 0.05
                depth[chosen] *= rng.uniform(0.2, 2, int(chosen.sum())).astype(np.float32)
            case "stripes":
                depth[:, :: int(rng.integers(2, 9))] *= 0.8
            case "stairs":
                step = rng.choice((0.05, 0.2))
                depth = (np.ceil(depth / step) * step).astype(np.float32)
        return color, np.ascontiguousarray(depth, np.float32)


@njit(cache=True)
def _cast(boxes: Array, T: Array, pinhole: Array, depth: Array, number: Array) -> None:  # pragma: no cover
    """Write depth and number (H, W) of the first box (N, 6) that each pixel's ray meets; 50 m where none is."""
    along = np.empty(3)
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            x, y = (u - pinhole[2]) / pinhole[0], (v - pinhole[3]) / pinhole[1]
            for axis in range(3):
                ray = T[axis, 0] * x + T[axis, 1] * y + T[axis, 2]
                along[axis] = 1.0 / (ray if abs(ray) > 1e-9 else 1e-9)
            depth[v, u], number[v, u] = 50.0, 0
            for k in range(len(boxes)):
                near, far = -np.inf, np.inf
                for axis in range(3):
                    one = (boxes[k, axis] - T[axis, 3]) * along[axis]
                    other = (boxes[k, axis + 3] - T[axis, 3]) * along[axis]
                    near, far = max(near, min(one, other)), min(far, max(one, other))
                hit = near if near > 0 else far
                if near <= far and 0 < hit < depth[v, u]:
                    depth[v, u], number[v, u] = hit, k


def hostile(seed: int, size: tuple[int, int] | None = None) -> Hostile:
    """Return the sequence of a seed, of images of a size or of one that is drawn."""
    rng = np.random.default_rng(seed)
    drawn = SIZES[int(rng.integers(len(SIZES)))]
    width, height = size or drawn
    focal = max(width, height) * rng.choice((0.3, 0.8, 0.8, 0.8, 3.0))
    camera = Intrinsics(float(focal), float(focal), (width - 1) / 2, (height - 1) / 2, width, height)
    return Hostile(seed, camera, rng, _boxes(rng, int(rng.integers(0, 8))))


def _boxes(rng: np.random.Generator, count: int) -> Array:
    """Return boxes on the table, low and high corners (N, 6); they may stand in each other."""
    sides = rng.uniform(0.02, 0.25, (count, 3))
    low = np.column_stack((rng.uniform((-0.6, -0.4), (0.4, 0.2), (count, 2)), np.zeros(count)))
    return np.hstack((low, low + sides))
