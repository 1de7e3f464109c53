"""The frames and poses of a recording that can be used; the others are left out."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Protocol

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.frame import Frame


class Posed(Protocol):
    """A recording, as far as its poses are concerned."""

    def pose(self, index: int) -> Float64Array | None:
        """Return T_world_camera (4, 4); None without poses; raise FrameError if a frame lacks one."""


def usable_frames(read: Callable[[int], Frame], frames: Iterable[int]) -> Iterator[Frame]:
    """Iterate over those of some frames that can be read."""
    for index in frames:
        with suppress(FrameError):
            yield read(index)


def posed_frames(
    read: Callable[[int], Frame], T_world_camera: Mapping[int, Float64Array], frames: Iterable[int]
) -> Iterator[Frame]:
    """Iterate over those of some frames that can be read, with poses (4, 4) by frame."""
    for index in frames:
        with suppress(FrameError):
            yield replace(read(index), T_world_camera=T_world_camera[index])


def usable_poses(recording: Posed, frames: Iterable[int]) -> dict[int, Float64Array]:
    """Return T_world_camera (4, 4) of those of some frames that have a pose, by frame."""
    poses = {}
    for index in frames:
        with suppress(FrameError):
            T_world_camera = recording.pose(index)
            if T_world_camera is not None:
                poses[index] = T_world_camera
    return poses
