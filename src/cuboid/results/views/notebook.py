"""Pictures of a frame and of its results, as a notebook shows them."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from cuboid.ground.arrays import UInt8Array
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.palette import color_of
from cuboid.ground.core.results import FrameResult
from cuboid.results.views.overlays import depth_picture, heat_over
from cuboid.results.views.tags import TAG_PX, place_tag, put_tag

# Approximate width of a notebook's column, pixels.
WIDEST_PX = 960
DARK = 24


def png_of(value: object) -> bytes:
    """Return the picture of a frame or of a result, as PNG."""
    if isinstance(value, FrameResult):
        return result_png(value)
    assert isinstance(value, Frame)
    return frame_png(value)


def frame_png(frame: Frame) -> bytes:
    """Return color and depth side by side, as PNG."""
    height, width = frame.depth_m.shape
    usual = Intrinsics(float(width), float(width), width / 2, height / 2, width, height)  # only for the relief
    return png(np.hstack([frame.color, depth_picture(frame.depth_m, usual)]))


def result_png(result: FrameResult) -> bytes:
    """Return the heat of a frame with its visible objects, as PNG."""
    width, height = result.size or result.heat.shape[::-1]
    picture = heat_over(np.full((height, width, 3), DARK, np.uint8), result.heat)
    taken: list[tuple[int, int, int, int]] = []
    for seen in result.sightings:
        x0, y0, x1, y1 = (round(float(value)) for value in seen.rect_xyxy)
        cv2.rectangle(picture, (x0, y0), (x1 - 1, y1 - 1), color_of(seen.label), 2, cv2.LINE_AA)
        place = place_tag(f"#{seen.label}", TAG_PX, seen.rect_xyxy, taken, (height, width))
        taken.append(place)
        put_tag(picture, f"#{seen.label}", TAG_PX, color_of(seen.label), False, place)
    return png(picture)


def png(picture: UInt8Array) -> bytes:
    """Return a picture (H, W, 3), RGB, as PNG, no wider than a notebook's column."""
    shrink = WIDEST_PX / picture.shape[1]
    shown: Any = picture
    if shrink < 1:
        shown = cv2.resize(picture, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)
    return bytes(cv2.imencode(".png", np.ascontiguousarray(shown[..., ::-1]))[1].tobytes())
