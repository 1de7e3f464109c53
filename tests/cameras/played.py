"""A camera that plays frames, and vendors' libraries that have no more than the real ones have."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from cuboid.inputs.cameras import Shot, StreamEndedError
from cuboid.inputs.readers import Calibration

SIZE = (64, 48)
CALIBRATION = Calibration(64.0, 64.0, 32.0, 24.0, SIZE, "the fake")


def color_image(k: int) -> np.ndarray:
    """A picture whose red says which frame it is of, and whose blue is something else."""
    image = np.random.default_rng(k).integers(0, 200, (SIZE[1], SIZE[0], 3)).astype(np.uint8)
    image[..., 0] = k
    return image


def depth_image(k: int) -> np.ndarray:
    """Millimetres."""
    return np.full((SIZE[1], SIZE[0]), 1500 + k, np.uint16)


def pose(k: int) -> np.ndarray:
    T = np.eye(4)
    T[0, 3] = 0.01 * k
    return T


class PlayedDriver:
    """Gives so many frames, then ends, is silent, or fails."""

    name = "a played camera"
    depth_units_per_metre = 1000.0

    def __init__(
        self,
        frames: int,
        *,
        calibration: Calibration = CALIBRATION,
        paced: bool = True,
        poses: bool = True,
        then: Callable[[], Shot | None] | None = None,
        every_s: float = 0.0,
        spoil: tuple[int, ...] = (),
        first_s: float = 100.0,
        interval_s: float = 1 / 30,
    ) -> None:
        self.calibration, self.paced, self.has_poses = calibration, paced, poses
        self.closed = 0
        self.taken = 0
        self._first_s, self._interval_s = first_s, interval_s
        self._frames, self._then, self._every_s, self._spoil = frames, then, every_s, spoil

    def take(self, wait_s: float) -> Shot | None:
        assert not self.closed, "the camera is closed"
        k = self.taken
        if k >= self._frames:
            if self._then is not None:
                return self._then()
            raise StreamEndedError
        self.taken += 1
        time.sleep(self._every_s)
        depth = depth_image(k) * (k not in self._spoil)
        time_s = self._first_s + k * self._interval_s
        return Shot(time_s, color_image(k), depth.astype(np.uint16), pose(k) if self.has_poses else None)

    def close(self) -> None:
        self.closed += 1


def install(monkeypatch: pytest.MonkeyPatch, name: str, members: dict[str, Any]) -> ModuleType:
    """Let a fake be the vendor's library."""
    module = ModuleType(name)
    vars(module).update(members)
    monkeypatch.setitem(sys.modules, name, module)
    return module


def answering(kind: str, **answers: Any) -> type:
    """Return a class whose methods return these values."""
    return type(kind, (), {name: lambda self, value=value: value for name, value in answers.items()})


def lacking(fake: Any, real: Any, path: str = "") -> list[str]:
    """Return what a fake has and the real one has not: what it would allow and the device would not."""
    found = []
    for name, member in vars(fake).items():
        if name.startswith("_"):
            continue
        if not hasattr(real, name):
            found.append(f"{path}{name}")
        elif isinstance(member, type) and isinstance(getattr(real, name), type):
            found += lacking(member, getattr(real, name), f"{path}{name}.")
    return found
