"""Pictures of each object, cut from the recording: the best one, and small ones through time."""

from __future__ import annotations

import base64
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise

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
PICTURE_MARGIN = 0.25

# Largest width of pictures: that of a card in the page on a high-resolution screen.
WIDTH_PX = 480

# JPEG quality, sharp enough for a slide; about 20 kB per picture.
SLIDE_QUALITY = 82

# Ratio of width to height of a card's picture; a narrower or lower rectangle is extended around the object.
ASPECT = 1.5


# Pictures of an object through time: the largest number for an object and for a page, their width and JPEG quality.
# 2 to 4 kB each: a page of many objects grows by 1.4 MB at most (base64), and few frames of a long recording are read.
STRIP = 6
MAX_STRIP_PICTURES = 240
STRIP_WIDTH_PX = 150
STRIP_QUALITY = 72

# A frame from which another picture is cut anyway replaces the best one if it shows at least this fraction of the
# object's pixels there: reading a frame costs more than cutting a picture.
GOOD_ENOUGH = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A picture of an object.

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
        return jpeg_address(self.jpeg)


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


Strips = dict[int, list[tuple[int, bytes]]]


def cut_pictures(
    best: Mapping[int, TrackRow],
    read: Callable[[int], Frame],
    boxes: Mapping[int, Box],
    poses: Mapping[int, PoseRow],
    intrinsics: Intrinsics,
    chosen: Mapping[int, Sequence[TrackRow]] | None = None,
) -> tuple[dict[int, Picture], Strips]:
    """Return the pictures of labels, and small ones through time; each frame is read once.

    A frame that cannot be read gives no picture.

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
        Of the color images, if frames do not come with a camera of a rig.
    chosen : mapping of int to sequence of TrackRow, optional
        From `through_time`.

    Returns
    -------
    pictures : dict of int to Picture
    strips : dict of int to list of (int, bytes)
        Frame and JPEG of the small pictures, by label and frame.
    """
    chosen = chosen or {}
    through = {(row.label, row.frame) for rows in chosen.values() for row in rows}
    every = {(row.label, row.frame): row for rows in (best.values(), *chosen.values()) for row in rows}
    pictures: dict[int, Picture] = {}
    strips: Strips = {label: [] for label in chosen}
    for row, frame in _read_rows(every.values(), read):
        color = frame.color
        x0, y0, x1, y1 = window(color, row.rect_xyxy)
        if (row.label, row.frame) in through:
            small = shrunk(color[y0:y1, x0:x1], STRIP_WIDTH_PX)
            strips[row.label].append((row.frame, encode_jpeg(small, STRIP_QUALITY)))
        if row.label in best and best[row.label].frame == row.frame:
            picture = shrunk(color[y0:y1, x0:x1], WIDTH_PX)
            camera = frame.intrinsics_or(intrinsics)
            edges = wireframes([boxes[row.label]], poses[row.frame].T_world_camera, camera)[0].front.reshape(-1, 4)
            shown = (edges - (x0, y0, x0, y0)) * (picture.shape[1] / (x1 - x0))
            pictures[row.label] = Picture(row.frame, encode_jpeg(picture, SLIDE_QUALITY), picture.shape[1::-1], shown)
    return pictures, strips


def through_time(
    rows: Iterable[TrackRow], labels: Collection[int], best: Mapping[int, TrackRow]
) -> dict[int, list[TrackRow]]:
    """Return for each label some rows that show the object through time, by frame.

    The sightings of a label are divided into as many parts of equal count as the label gets pictures. Of each part, the
    row with the largest visible part of its rectangle is taken, or a row of a frame that is read anyway.

    Parameters
    ----------
    rows : iterable of TrackRow
        By frame.
    labels : collection of int
        Labels that get pictures; the other rows are left out.
    best : mapping of int to TrackRow
        From `best_sightings`: their frames are read anyway.
    """
    count = min(STRIP, MAX_STRIP_PICTURES // max(len(labels), 1))
    seen: dict[int, list[TrackRow]] = {label: [] for label in sorted(labels)}
    for row in rows:
        if row.label in seen:
            seen[row.label].append(row)
    frames = {row.frame for label, row in best.items() if label in seen}
    chosen: dict[int, list[TrackRow]] = {}
    for label, found in seen.items():
        parts = min(count, len(found))
        bounds = [len(found) * i // parts for i in range(parts + 1)] if parts else []
        chosen[label] = [_representative(found[i:j], frames) for i, j in pairwise(bounds)]
        frames.update(row.frame for row in chosen[label])
    return chosen


def jpeg_address(jpeg: bytes) -> str:
    """Return a JPEG as a data URL (RFC 2397)."""
    return "data:image/jpeg;base64," + base64.b64encode(jpeg).decode("ascii")


def cut_picture(recording: Recording, frame: int, rect_xyxy: Float64Array) -> bytes | None:
    """Return the picture of a rectangle in a frame of a recording, JPEG; None if the frame cannot be read."""
    try:
        color = recording.without_poses().read(frame).color
    except CuboidError:
        return None
    x0, y0, x1, y1 = window(color, rect_xyxy)
    return encode_jpeg(shrunk(color[y0:y1, x0:x1], WIDTH_PX), SLIDE_QUALITY) if x0 < x1 and y0 < y1 else None


def window(color: UInt8Array, rect_xyxy: Float64Array) -> tuple[int, int, int, int]:
    """Return the part of a picture (H, W, 3) around a rectangle, in the aspect ratio of a card: x0, y0, x1, y1."""
    low, high = rect_xyxy[:2], rect_xyxy[2:]
    half = (high - low) / 2.0 + PICTURE_MARGIN * float((high - low).max())
    half = np.maximum(half, (half[1] * ASPECT, half[0] / ASPECT))
    limit = np.array(color.shape[1::-1], dtype=np.float64)
    half = np.minimum(half, limit / 2.0)
    middle = np.clip((low + high) / 2.0, half, limit - half)
    (x0, y0), (x1, y1) = np.round(middle - half).astype(int), np.round(middle + half).astype(int)
    return max(int(x0), 0), max(int(y0), 0), int(x1), int(y1)


def _shown_px(row: TrackRow) -> float:
    x0, y0, x1, y1 = row.rect_xyxy
    return float((x1 - x0) * (y1 - y0) * row.visible)


def _representative(rows: Sequence[TrackRow], frames: Collection[int]) -> TrackRow:
    """Return the row that shows the most pixels; a row of one of `frames` if it shows enough of them."""
    best = max(rows, key=_shown_px)
    shared = [row for row in rows if row.frame in frames and _shown_px(row) >= GOOD_ENOUGH * _shown_px(best)]
    return max(shared, key=_shown_px, default=best)


def _read_rows(rows: Iterable[TrackRow], read: Callable[[int], Frame]) -> Iterator[tuple[TrackRow, Frame]]:
    """Yield rows, by frame, with their frame; each frame is read once.

    Rows of a frame that cannot be read, and rows outside of the image, are left out.
    """
    for index, group in groupby(sorted(rows, key=lambda row: row.frame), lambda row: row.frame):
        try:
            frame = read(index)
        except (CuboidError, IndexError):  # the results may be those of another recording
            continue
        for row in group:
            x0, y0, x1, y1 = window(frame.color, row.rect_xyxy)
            if x0 < x1 and y0 < y1:
                yield row, frame
