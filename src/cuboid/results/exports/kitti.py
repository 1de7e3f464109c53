"""KITTI: the text of its tracking benchmark, a line an object seen in a frame.

    frame track_id type truncated occluded alpha left top right bottom height width length x y z rotation_y score

- ``frame``: number in the recording; ``track_id``: the label; ``type``: "Misc", the benchmark's name for other things.
- ``truncated``: 0 the box lies in the image, 1 it reaches out of it, 2 more than half of its rectangle is outside.
- ``occluded``: 0 at least 80 % of the near side is seen, 1 at least 40 %, 2 less.
- ``alpha``: `rotation_y` less the direction to the object, -pi..pi.
- rectangle in pixels; ``height width length`` and the place in metres, in the camera frame of that frame (x right,
  y down, z forward). As the benchmark has it, the place is the middle of the box's lower face.
- ``rotation_y``: turn of the length about the camera's y axis, -pi..pi.
- ``score``: probability of the object in that frame, 0..1.

The format has no other rotation: it was made for cars with a level camera. Where the camera looks down,
each box keeps its centre and its size but is set upright in the camera's frame, by the smallest turn that does it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.overlap import iou
from cuboid.ground.geometry.se3 import inverse
from cuboid.results.files import Results, TrackRow
from cuboid.results.files.text import LENGTH, PIXEL, number, numbers
from cuboid.results.views.projection import NEAR_PLANE_M

TYPE = "Misc"
UPRIGHT = np.array([0.0, -1.0, 0.0])  # up in a level camera's frame

# Minimum visible fraction of "not occluded" and "partly occluded"; the benchmark gives no figures for them.
WHOLE, PARTLY = 0.8, 0.4

# Number of boxes, evenly over the file, for the estimate of the format's loss.
PROBES = 200


def write(run: Results, path: Path) -> list[str]:
    """Write the file; return a note about the format's loss."""
    rows = [
        kitti_row(seen, run.poses[seen.frame].T_world_camera, run.found.intrinsics, run.probability_of(seen))
        for seen in run.tracks
    ]
    path.write_text("".join(f"{line}\n" for line, _ in rows), encoding="utf-8", newline="\n")
    return _losses(run, [box for _, box in rows])


def kitti_row(seen: TrackRow, T_world_camera: Float64Array, intrinsics: Intrinsics, score: float) -> tuple[str, Box]:
    """Return the line of a sighting, and its box as readers of the line see it: upright, in the camera frame."""
    box = in_camera(seen.box, T_world_camera)
    along = _upright_turn(box.up) @ box.rotation[:, 0]
    rotation_y_rad = float(np.arctan2(-along[2], along[0]))
    alpha_rad = _wrapped(rotation_y_rad - float(np.arctan2(box.center[0], box.center[2])))
    foot, (length, width, height) = box.center - (box.size[2] / 2.0) * UPRIGHT, box.size
    occluded = 0 if seen.visible >= WHOLE else 1 if seen.visible >= PARTLY else 2
    line = (
        f"{seen.frame} {seen.label} {TYPE} {_truncated(box, intrinsics)} {occluded} {number(alpha_rad, LENGTH)} "
        f"{numbers(seen.rect_xyxy, PIXEL, ' ')} {numbers((height, width, length, *foot), LENGTH, ' ')} "
        f"{number(rotation_y_rad, LENGTH)} {number(score, LENGTH)}"
    )
    c, s = np.cos(rotation_y_rad), np.sin(rotation_y_rad)
    rotation = np.array([[c, s, 0.0], [0.0, 0.0, -1.0], [-s, c, 0.0]])
    return line, Box(foot + (box.size[2] / 2.0) * UPRIGHT, box.size, rotation)


def in_camera(box: Box, T_world_camera: Float64Array) -> Box:
    """Return a box of the world in the camera frame."""
    return box.moved(inverse(T_world_camera))


def _upright_turn(up: Float64Array) -> Float64Array:
    """Return the smallest rotation (3, 3) that takes a direction to `UPRIGHT` (none for the opposite one)."""
    x, y, z = np.cross(up, UPRIGHT)
    cosine = float(up @ UPRIGHT)
    if cosine < -1.0 + 1e-9:
        return np.eye(3)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn: Float64Array = np.eye(3) + cross + cross @ cross / (1.0 + cosine)
    return turn


def _truncated(box: Box, intrinsics: Intrinsics) -> int:
    corners = box.corners()
    if corners[:, 2].min() < NEAR_PLANE_M:
        return 2
    pixels = intrinsics.pixels(corners)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    last = np.array([intrinsics.width, intrinsics.height]) - 0.5
    inside = np.clip(np.minimum(high, last) - np.maximum(low, -0.5), 0.0, None)
    fraction = float(np.prod(inside) / np.prod(high - low))
    return 0 if fraction >= 1.0 else 1 if fraction >= 0.5 else 2


def _wrapped(angle_rad: float) -> float:
    return float((angle_rad + np.pi) % (2.0 * np.pi) - np.pi)


def _losses(run: Results, written: list[Box]) -> list[str]:
    """Return a note about the camera's tilt and the overlap of upright boxes with the true ones."""
    if not written:
        return []
    chosen = range(0, len(written), -(-len(written) // PROBES))
    true = [in_camera(run.tracks[i].box, run.poses[run.tracks[i].frame].T_world_camera) for i in chosen]
    tilts_rad = [np.arccos(np.clip(box.up @ UPRIGHT, -1.0, 1.0)) for box in true]
    kept = [iou(written[i], box) for i, box in zip(chosen, true, strict=True)]
    return [
        "KITTI boxes turn about the camera's y axis only; the camera was tilted by "
        f"{np.degrees(np.median(tilts_rad)):.0f} degrees, and the written boxes overlap the true ones by "
        f"IoU {np.median(kept):.2f} (medians)"
    ]
