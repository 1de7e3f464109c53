"""Small recordings, made file by file."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

SIZE = (48, 64)  # rows, columns
CAMERA = {"fx": 60.0, "fy": 61.0, "cx": 31.5, "cy": 23.5, "width": 64, "height": 48}
NO_TURN = "0 0 0 1"


def color_image(k: int, shape: tuple[int, int] = SIZE) -> np.ndarray:
    """RGB; the first pixel is (200, 10 + k, 30), the rest is smooth so that JPEG keeps it."""
    image = np.zeros((*shape, 3), np.uint8)
    image[:] = (200, 10 + k, 30)
    image[shape[0] // 2 :] = (20, 30, 220)
    return image


def depth_image(k: int, units: float, shape: tuple[int, int] = SIZE) -> np.ndarray:
    """1 m + k cm at the left, 2 m at the right, one column without reading."""
    image = np.full(shape, round((1.0 + 0.01 * k) * units), np.uint16)
    image[:, shape[1] // 2 :] = round(2.0 * units)
    image[:, 0] = 0
    return image


def write_image(path: Path, image: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    stored = image[..., ::-1] if image.ndim == 3 else image
    done, data = cv2.imencode(path.suffix, np.ascontiguousarray(stored))
    assert done
    path.write_bytes(data.tobytes())


@dataclass(frozen=True)
class Made:
    """A made recording: its folder, and where the files of frame k lie."""

    path: Path
    color: Callable[[int], Path]
    depth: Callable[[int], Path]
    units: float


def make_plain(root: Path, frames: int = 5, poses: bool = True) -> Made:
    folder = root / "mine"
    made = Made(
        folder,
        lambda k: folder / "color" / f"{k:06d}.png",
        lambda k: folder / "depth" / f"{k:06d}.png",
        1000.0,
    )
    write_frames(made, frames)
    (folder / "camera.json").write_text(json.dumps(CAMERA | {"depth_units_per_metre": made.units}))
    if poses:
        lines = [f"{k} {0.1 * k} 0 0 {NO_TURN}" for k in range(frames)]
        (folder / "poses.txt").write_text("# number tx ty tz qx qy qz qw\n" + "\n".join(lines) + "\n")
    return made


def write_frames(made: Made, frames: int, shape: tuple[int, int] = SIZE) -> None:
    for k in range(frames):
        write_image(made.color(k), color_image(k, shape))
        write_image(made.depth(k), depth_image(k, made.units, shape))
