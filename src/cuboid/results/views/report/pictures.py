"""The best picture of each object, cut from the recording."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from cuboid.ground.arrays import Float64Array, UInt8Array
from cuboid.ground.core.errors import CuboidError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.geometry.box import Box
from cuboid.inputs.readers import Recording
from cuboid.results.files import PoseRow, TrackRow
from cuboid.results.views.pixels import encode_jpeg, shrunk
from cuboid.results.views.projection import wireframes

# Margin of a picture around the rectangle, as a fraction of its longer side: it shows the surroundings of the object.
MARGIN = 0.25

# Largest width of pictures: that of a card in the page on a high-resolution screen.
WIDTH_PX = 480

# JPEG quality, sharp enough for a slide; about 20 kB per picture.
QUALITY = 82

# Ratio of width to height of a card's picture; a narrower or lower rectangle is extended around the object.
ASPECT = 1.5


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """The best picture of an object.

    Attributes
    ----------
    frame : int or None
        Frame of the recording; None if the picture is from an earlier recording.
    jpeg : bytes
    size : (int, int)
        Width and height, pixels.
    edges : (N, 4) float64
        Edges of the object's box that the box itself does not hide: x0, y0, x1, y1, in pixels of the picture.
    """

    frame: int | None
    jpeg: bytes
    size: tuple[int, int]
    edges: Float64Array

    @property
    def address(self) -> str:
        """The picture as a data URL (RFC 2397)."""
        return "data:image/jpeg;base64," + base64.b64encode(self.jpeg).decode("ascii")


def best_sightings(rows: Iterable[TrackRow]) -> dict[int, TrackRow]:
    """Return for each label the row with the largest visible part of its rectangle.

    Of equal rows, the earliest is returned.
    """
    best: dict[int, TrackRow] = {}
    for row in rows:
        if row.label not in best or _shown_px(row) > _shown_px(best[row.label]):
            best[row.label] = row
    return best


def last_sightings(rows: Iterable[TrackRow]) -> dict[int, TrackRow]:
    """Return for each label the last row, of rows in the order of frames."""
    return {row.label: row for row in rows}


def cut_pictures(
    best: Mapping[int, TrackRow],
    read: Callable[[int], Frame],
    boxes: Mapping[int, Box],
    poses: Mapping[int, PoseRow],
    intrinsics: Intrinsics,
) -> dict[int, Picture]:
    """Return the pictures of labels; a frame that cannot be read gives no picture.

    Parameters
    ----------
    best : mapping of int to TrackRow
        From `best_sightings`.
    read : callable
        Returns a frame of the recording.
    boxes : mapping of int to Box
        Final boxes of the objects in the world, by label, for outlines.
    poses : mapping of int to PoseRow
        By frame.
    intrinsics : Intrinsics
        Of the color images.
    """
    pictures: dict[int, Picture] = {}
    for label, row in sorted(best.items(), key=lambda item: item[1].frame):
        try:
            color = read(row.frame).color
        except CuboidError:
            continue
        x0, y0, x1, y1 = window(color, row.rect_xyxy)
        if x0 < x1 and y0 < y1:
            picture = shrunk(color[y0:y1, x0:x1], WIDTH_PX)
            edges = wireframes([boxes[label]], poses[row.frame].T_world_camera, intrinsics)[0].front.reshape(-1, 4)
            scale = picture.shape[1] / (x1 - x0)
            shown = (edges - (x0, y0, x0, y0)) * scale
            pictures[label] = Picture(row.frame, encode_jpeg(picture, QUALITY), picture.shape[1::-1], shown)
    return pictures


def cut_picture(recording: Recording, frame: int, rect_xyxy: Float64Array) -> bytes | None:
    """Return the picture of a rectangle in a frame of a recording, JPEG; None if the frame cannot be read."""
    try:
        color = recording.without_poses().read(frame).color
    except CuboidError:
        return None
    x0, y0, x1, y1 = window(color, rect_xyxy)
    return encode_jpeg(shrunk(color[y0:y1, x0:x1], WIDTH_PX), QUALITY) if x0 < x1 and y0 < y1 else None


def window(color: UInt8Array, rect_xyxy: Float64Array) -> tuple[int, int, int, int]:
    """Return the part of a picture (H, W, 3) around a rectangle, in the aspect ratio of a card: x0, y0, x1, y1."""
    low, high = rect_xyxy[:2], rect_xyxy[2:]
    half = (high - low) / 2.0 + MARGIN * float((high - low).max())
    half = np.maximum(half, (half[1] * ASPECT, half[0] / ASPECT))
    limit = np.array(color.shape[1::-1], dtype=np.float64)
    half = np.minimum(half, limit / 2.0)
    middle = np.clip((low + high) / 2.0, half, limit - half)
    (x0, y0), (x1, y1) = np.round(middle - half).astype(int), np.round(middle + half).astype(int)
    return max(int(x0), 0), max(int(y0), 0), int(x1), int(y1)


def _shown_px(row: TrackRow) -> float:
    x0, y0, x1, y1 = row.rect_xyxy
    return float((x1 - x0) * (y1 - y0) * row.visible)
