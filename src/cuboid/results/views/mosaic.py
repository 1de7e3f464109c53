"""Pictures of the cameras of a rig side by side."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np

from cuboid.ground.arrays import UInt8Array
from cuboid.ground.core.frame import RigCamera
from cuboid.results.views.drawing import DARK, WHITE
from cuboid.results.views.encoding import VideoWriter
from cuboid.results.views.tags import unit_of
from cuboid.results.views.text import put_text

# Size of a camera's name in its picture, and distance from the corner, pixels of an image 640 pixels wide.
NAME_PX, NAME_MARGIN_PX = 16, 10


class CamerasVideo:
    """Writes the pictures of a camera into a video; those of a rig's cameras side by side.

    Parameters
    ----------
    video : VideoWriter
        Closed by its owner.
    cameras : sequence of RigCamera
        Cameras of the rig; empty without one.
    """

    def __init__(self, video: VideoWriter, cameras: Sequence[RigCamera] = ()) -> None:
        self._video = video
        self._mosaic = Mosaic(cameras) if cameras else None

    def add(self, name: str, picture: UInt8Array) -> None:
        """Add the next picture of a camera; a video of a rig gets one when it is complete."""
        complete = picture if self._mosaic is None else self._mosaic.add(name, picture)
        if complete is not None:
            self._video.add(complete)

    def finish(self) -> None:
        """Add the last picture of a rig."""
        last = None if self._mosaic is None else self._mosaic.last()
        if last is not None:
            self._video.add(last)


class Mosaic:
    """Puts the last picture of each camera side by side, in a grid of tiles as large as the first camera's picture.

    A picture is complete when a camera takes its next one: cameras with different rates show their last pictures.

    Parameters
    ----------
    cameras : sequence of RigCamera
        In the order of the tiles.
    """

    def __init__(self, cameras: Sequence[RigCamera]) -> None:
        self._names = [camera.name for camera in cameras]
        self._size = cameras[0].intrinsics.width, cameras[0].intrinsics.height
        self._columns = math.ceil(math.sqrt(len(cameras)))
        width, height = self._size
        rows = -(-len(cameras) // self._columns)
        self._picture = np.full((rows * height, self._columns * width, 3), DARK, np.uint8)
        self._new: set[str] = set()

    def add(self, name: str, picture: UInt8Array) -> UInt8Array | None:
        """Add the next picture of a camera; return the picture of all cameras before it, if it is complete."""
        complete = self._picture.copy() if name in self._new else None
        if complete is not None:
            self._new.clear()
        self._new.add(name)
        self._put(name, picture)
        return complete

    def last(self) -> UInt8Array | None:
        """Return the last picture of all cameras; None if there is none since the last complete one."""
        return self._picture.copy() if self._new else None

    def _put(self, name: str, picture: UInt8Array) -> None:
        k, (width, height) = self._names.index(name), self._size
        top, left = k // self._columns * height, k % self._columns * width
        tile = self._picture[top : top + height, left : left + width]
        tile[:] = DARK
        scale = min(width / picture.shape[1], height / picture.shape[0])
        small = max(1, round(picture.shape[1] * scale)), max(1, round(picture.shape[0] * scale))
        fitted = picture if scale == 1.0 else cv2.resize(picture, small, interpolation=cv2.INTER_AREA)
        y, x = (height - fitted.shape[0]) // 2, (width - fitted.shape[1]) // 2
        tile[y : y + fitted.shape[0], x : x + fitted.shape[1]] = fitted
        unit = unit_of(width)
        margin = round(NAME_MARGIN_PX * unit)
        named = np.ascontiguousarray(tile)
        put_text(named, name, margin, margin, max(1, round(NAME_PX * unit)), WHITE)
        tile[:] = named
