"""Visibility of the known objects in a frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.limits import SAMPLE_POINTS
from cuboid.ground.core.observation import Observation
from cuboid.ground.core.results import Sighting
from cuboid.ground.core.tolerances import DRIFT_M, MIN_READINGS
from cuboid.ground.core.working import WorkingImage
from cuboid.ground.geometry.rectangles import rect_iou
from cuboid.ground.geometry.se3 import transform
from cuboid.method.objects.association import MIN_MATCH_IOU, Association
from cuboid.method.objects.entry import MapObject
from cuboid.method.objects.kernels import sightings as kernel
from cuboid.method.objects.store import ObjectStore
from cuboid.method.surfaces.frame_segments import FrameSegments
from cuboid.method.surfaces.kernels.outlines import EDGE_LEVELS

# An object is seen if this fraction of its near side is visible.
MIN_VISIBLE_FRACTION = 0.1
# Fraction by which the rectangle of an object moves towards the rectangle of the frame's segment.
BLEND_GAIN = 0.2
# Largest difference per channel, of 255, between the color of a pixel and of a point that agree: noise, exposure, and
# texture finer than a voxel.
MAX_COLOR_DIFFERENCE = EDGE_LEVELS // 3


@dataclass(frozen=True, slots=True)
class Visibility:
    """Visibility of an object in a frame.

    Attributes
    ----------
    visible : float
        Visible fraction of its near side, 0..1.
    rect_xyxy : (4,) float64
        Rectangle of its unhidden part, down to its foot, in pixels of the full image, clipped to it.
    seen : bool
    """

    visible: float
    rect_xyxy: Float64Array
    seen: bool


def boxes_in_frustum(
    boxes: Float64Array, bounds: Float64Array, image: WorkingImage, T_camera_world: Float64Array, far_m: float
) -> npt.NDArray[np.int64]:
    """Return the boxes (N, 15), see `pack`, whose bounding spheres reach into the image and are near enough, ascending.

    A row of NaN is never found; `bounds` are those of batches of boxes, see `kernels.overlap.bound`.
    """
    c, found = image.camera, np.empty(len(boxes), np.int64)
    pinhole, T = c.pinhole, np.ascontiguousarray(T_camera_world)
    return found[: kernel.boxes_in_frustum(boxes, bounds, T, pinhole, c.width, c.height, far_m, found)]


def objects_in_frustum(
    store: ObjectStore, image: WorkingImage, T_camera_world: Float64Array, far_m: float
) -> list[MapObject]:
    """Return the objects, confirmed or not, whose spheres reach into the image at a pose (4, 4), by number."""
    found = boxes_in_frustum(store.boxes[: store.numbers], store.bounds, image, T_camera_world, far_m)
    return [store[n] for n in found.tolist()]


def places_in_view(objects: Sequence[MapObject], boxes: Float64Array, observed: Observation) -> list[MapObject]:
    """Return the objects whose centre lies in the image, with no reading in front of their box (n, 15) there."""
    if not objects:
        return []
    c, depth_m = observed.image.camera, observed.image.depth_m
    points = transform(observed.T_camera_world, boxes[:, :3])
    z, half_m = points[:, 2], np.linalg.norm(boxes[:, 3:6], axis=1) / 2.0
    u, v = np.rint(c.pixels(np.where(z[:, None] > DRIFT_M, points, 1.0))).T.astype(np.int64)
    inside = (z > DRIFT_M) & (u >= 0) & (v >= 0) & (u < c.width) & (v < c.height)
    reading_m = depth_m[np.clip(v, 0, c.height - 1), np.clip(u, 0, c.width - 1)]
    return [objects[k] for k in np.flatnonzero(inside & (reading_m > z - half_m)).tolist()]


def measure_visibility(
    objects: Sequence[MapObject],
    boxes: Float64Array,
    observed: Observation,
    slots: npt.NDArray[np.int32],
    owner: npt.NDArray[np.int32],
    noise_per_m: float,
) -> list[Visibility]:
    """Return the visibility of each object in this frame.

    A point is seen if the reading at its pixel agrees with it; without a reading (in a sensor shadow, on dark or shiny
    surfaces), if the color agrees. A point behind a reading of its own object is on the far side and is ignored; a
    point behind another surface is hidden. Of the unknown points, outside the image or without a reading, half count as
    hidden: half of an object faces away.

    Parameters
    ----------
    objects : sequence of MapObject
    boxes : (n, 15) float64
        Boxes of the objects, see `pack`.
    observed : Observation
    slots : (h, w) int32
        Voxel of each working pixel, -1: none.
    owner : (N,) int32
        Number of the object that owns each voxel, 0: none.
    noise_per_m : float
        The standard deviation of depth is this value times z squared.
    """
    image = observed.image
    if not objects:
        return []
    samples = [slice(None, None, max(1, len(o.points) // SAMPLE_POINTS)) for o in objects]
    points = [o.points[sample] for o, sample in zip(objects, samples, strict=True)]
    colors = [o.colors[sample] for o, sample in zip(objects, samples, strict=True)]
    n, c = len(objects), image.camera
    counts, corners = np.empty((n, 3), np.int64), np.empty((n, 4))
    ends, numbers = np.cumsum([len(p) for p in points]), np.array([o.number for o in objects])
    surfaces = kernel.Surfaces(np.concatenate(points), np.concatenate(colors), ends, _feet(boxes), numbers)
    pinhole, T = c.pinhole, np.ascontiguousarray(observed.T_camera_world)
    view = kernel.View(image.depth_m, image.color, slots, owner, pinhole, T)
    kernel.count_seen(surfaces, view, noise_per_m, DRIFT_M, MAX_COLOR_DIFFERENCE, counts, corners)
    seen, hidden, unknown = counts.T
    visible = seen / np.maximum(1.0, seen + hidden + 0.5 * unknown)
    seen_enough = (visible >= MIN_VISIBLE_FRACTION) & (seen >= MIN_READINGS)
    rectangles = _rectangles(corners, image)
    return [Visibility(float(visible[k]), rectangles[k], bool(seen_enough[k])) for k in range(n)]


def sightings_of(
    visible: Sequence[tuple[MapObject, Visibility]],
    frame_segments: FrameSegments,
    found: Association,
    min_probability: float,
) -> tuple[Sighting, ...]:
    """Return the sightings of the reported objects among the visible ones, by label.

    Parameters
    ----------
    visible : sequence of (MapObject, Visibility)
        The visible objects, after they were recorded as seen.
    frame_segments : FrameSegments
    found : Association
    min_probability : float
        Objects with a lower probability are left out.
    """
    matched = [(found.objects[j].survivor.number, i, j) for i, j in enumerate(found.match.tolist()) if j >= 0]
    iou = {number: float(found.iou[i, j]) for number, i, j in matched}
    rect = {number: frame_segments.segments[i].rect_xyxy for number, i, _ in matched}
    sightings = []
    for entry, view in visible:
        if entry.is_reported(min_probability):
            frame_iou = None if entry.frames_seen == 1 else iou.get(entry.number)  # a first sighting has no earlier box
            rect_xyxy = blended_rectangle(view.rect_xyxy, rect.get(entry.number))
            values = entry.label, entry.box, frame_iou, view.visible, rect_xyxy
            sightings.append(Sighting(*values, probability=entry.score))
    return tuple(sorted(sightings, key=lambda s: s.label))


def blended_rectangle(rect_xyxy: Float64Array, segment_xyxy: Float64Array | None) -> Float64Array:
    """Return the rectangle (4,) of an object in a frame, moved by a fifth towards that of the frame's segment.

    The map has errors from poses and missing parts, the frame from noise and holes: the combination has smaller errors.
    A segment with a different rectangle, or None, changes nothing.
    """
    if segment_xyxy is None or rect_iou(rect_xyxy, segment_xyxy) < MIN_MATCH_IOU:
        return rect_xyxy
    return np.asarray(rect_xyxy + BLEND_GAIN * (segment_xyxy - rect_xyxy))


def _feet(boxes: Float64Array) -> Float64Array:
    """Return the planes on which boxes (n, 15) stand, (n, 4): unit normal, and normal.p for points p on the plane."""
    up = boxes[:, 8::3]
    return np.column_stack([up, (up * boxes[:, :3]).sum(1) - boxes[:, 5] / 2])


def _rectangles(corners: Float64Array, image: WorkingImage) -> Float64Array:
    """Return rectangles (n, 4) of the working image in the full image; zeros for empty ones."""
    rectangles = image.full_rectangles(corners)
    rectangles[corners[:, 0] > corners[:, 2]] = 0.0
    return rectangles
