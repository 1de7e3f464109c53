"""Pictures of the keyframes: found objects, missed objects, and false detections."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from cuboid.ground.arrays import Float64Array, UInt8Array
from cuboid.ground.core.errors import FrameError
from cuboid.ground.formats.folder import writing
from cuboid.inputs.readers.recording import Recording
from cuboid.lab.evaluation.keyframe_scores import JudgedFrame
from cuboid.lab.evaluation.rectangles import Outcome
from cuboid.results.views.pixels import encode_jpeg
from cuboid.results.views.tags import TAG_PX, place_tag, put_tag
from cuboid.results.views.text import Color, ink, put_text

# Colors of M. Okabe and K. Ito, which color-blind people can distinguish: annotated objects found and missed, sightings
# true and false, and those that count neither way.
FOUND, MISSED, TRUE, FALSE, NEITHER = (0, 158, 115), (230, 97, 0), (86, 180, 233), (240, 228, 66), (170, 170, 170)
KEY = (
    ("found", FOUND),
    ("missed / last stage that had it", MISSED),
    ("true label", TRUE),
    ("false label", FALSE),
    ("neither", NEITHER),
)
STRIP_PX = 24
OUTLINE_DASH_PX, HATCH_PX = 8, 14
JUDGED_JPEG_QUALITY = 90


def write_pictures(folder: Path, frames: tuple[JudgedFrame, ...], recording: Recording) -> int:
    """Write ``000123.jpg`` for each judged frame that can be read; return the number of pictures.

    Raises
    ------
    OutputError
        The folder cannot be written.
    """
    written = 0
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    for frame in frames:
        try:
            color = recording.read(frame.keyframe.frame).color
        except FrameError:
            continue
        path = folder / f"{frame.keyframe.frame:06d}.jpg"
        with writing(path):
            path.write_bytes(encode_jpeg(draw_judged(color, frame), JUDGED_JPEG_QUALITY))
        written += 1
    return written


def draw_judged(color: UInt8Array, frame: JudgedFrame) -> UInt8Array:
    """Return the picture (H, W, 3) of a frame, with a strip below, as it was judged at the first threshold.

    Drawn rectangles are solid, labelled sightings dashed, ignored places hatched.
    """
    unit = max(1.0, color.shape[1] / 640.0)
    picture = np.vstack((color, np.full((round(STRIP_PX * unit), color.shape[1], 3), 16, np.uint8)))
    scene, at = picture[: color.shape[0]], frame.at[0]
    for rect in frame.keyframe.ignored:
        _hatch(scene, rect, round(HATCH_PX * unit))
    tags: list[tuple[str, Color, bool, Float64Array]] = []
    for i, drawn in enumerate(frame.keyframe.drawn):
        tint = (FOUND if at.found[i] else MISSED) if at.counts[i] else NEITHER
        _outline(scene, drawn.rect_xyxy, tint, round(2 * unit), 0)
        tags.append((_tag(frame, i), tint, False, drawn.rect_xyxy))
    for label, rect, outcome in zip(frame.sightings.label, frame.sightings.rects_xyxy, at.outcomes, strict=True):
        tint = {Outcome.TRUE: TRUE, Outcome.FALSE: FALSE}.get(outcome, NEITHER)
        _outline(scene, rect, tint, round(2 * unit), round(OUTLINE_DASH_PX * unit))
        tags.append((f"#{label}", tint, True, rect))
    taken: list[tuple[int, int, int, int]] = []
    for text, tint, outlined, rect in tags:
        place = place_tag(text, round(TAG_PX * unit), rect, taken, scene.shape[:2])
        taken.append(place)
        put_tag(scene, text, round(TAG_PX * unit), tint, outlined, place)
    _key(picture, frame.keyframe.frame, color.shape[0], unit)
    return picture


def _tag(frame: JudgedFrame, i: int) -> str:
    """Return the id of an annotated object and, if it is missed, the last stage that had it."""
    drawn, at = frame.keyframe.drawn[i], frame.at[0]
    if at.found[i] or not at.counts[i]:
        return str(drawn.id)
    reached = [short for short, found in frame.stages.items() if found[i]]
    return f"{drawn.id} / {reached[-1] if reached else 'none'}"


def _outline(picture: UInt8Array, rect: Float64Array, tint: Color, thickness: int, dash: int) -> None:
    """Draw a rectangle with a dark halo, dashed where `dash` is above 0."""
    (x0, y0), (x1, y1) = np.round(rect[:2]).astype(int), np.round(rect[2:]).astype(int) - 1
    cv2.rectangle(picture, (x0, y0), (x1, y1), (16, 16, 16), thickness + 2)
    if not dash:
        cv2.rectangle(picture, (x0, y0), (x1, y1), tint, thickness)
        return
    for a, b in (((x0, y0), (x1, y0)), ((x1, y0), (x1, y1)), ((x1, y1), (x0, y1)), ((x0, y1), (x0, y0))):
        start, direction = np.array(a), np.subtract(b, a)
        length = max(int(np.abs(direction).max()), 1)
        for s in range(0, length, 2 * dash):
            ends = [np.round(start + direction * (t / length)).astype(int).tolist() for t in (s, min(s + dash, length))]
            cv2.line(picture, ends[0], ends[1], tint, thickness)


def _hatch(picture: UInt8Array, rect: Float64Array, step: int) -> None:
    """Lay thin grey diagonals over a rectangle."""
    x0, y0, x1, y1 = np.round(rect).astype(int)
    part = picture[max(y0, 0) : max(y1, 0), max(x0, 0) : max(x1, 0)]
    rows, columns = np.indices(part.shape[:2])
    line = (rows + columns) % step == 0
    line[[0, -1]], line[:, [0, -1]] = True, True
    part[line] = part[line] // 2 + np.array(NEITHER, np.uint8) // 2


def _key(picture: UInt8Array, frame: int, top: int, unit: float) -> None:
    """Write the frame's number and the meaning of the colors into the strip."""
    size, gap = round(12 * unit), round(8 * unit)
    top, left = top + round(4 * unit), gap
    put_text(picture, f"frame {frame}", left, top, size, (245, 246, 248))
    left += ink(f"frame {frame}", size).shape[1] + 2 * gap
    for text, tint in KEY:
        low, high = (left, top + round(3 * unit)), (left + round(9 * unit), top + round(12 * unit))
        cv2.rectangle(picture, low, high, tint, cv2.FILLED)
        put_text(picture, text, left + round(13 * unit), top, size, (200, 205, 212))
        left += round(13 * unit) + ink(text, size).shape[1] + gap
