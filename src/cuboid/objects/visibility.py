"""Visibility of the known objects in a frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.core.frame import Float64Array
from cuboid.core.limits import SAMPLE_POINTS
from cuboid.core.observation import Observation
from cuboid.core.results import Sighting
from cuboid.core.tolerances import DRIFT_M, MIN_READINGS
from cuboid.core.working import WorkingImage
from cuboid.geometry.rectangles import rect_iou
from cuboid.objects.association import SAME, Association
from cuboid.objects.entry import MapObject
from cuboid.objects.kernels import sightings as kernel
from cuboid.surfaces.frame_segments import FrameSegments
from cuboid.surfaces.kernels.outlines import EDGE_LEVELS

# An object is seen when this fraction of its near side is.
MIN_VISIBLE_FRACTION = 0.1
# How far the rectangle of an object moves towards that of the frame's own segment, as a fraction of the way.
BLEND_GAIN = 0.2
# A color agrees with a point's when no channel is farther off than this, of 255: noise, exposure, texture finer than
# a voxel.
ALIKE = EDGE_LEVELS // 3


@dataclass(frozen=True, slots=True)
class Visibility:
    """Visibility of an object in a frame.

    Attributes
    ----------
    visible : float
        Fraction of its near side that is seen, 0..1.
    rect_xyxy : (4,) float64
        Rectangle of what nothing hides of it, down to its foot, in pixels of the full image, clipped to it.
    seen : bool
    """

    visible: float
    rect_xyxy: Float64Array
    seen: bool


def boxes_in_frustum(
    boxes: Float64Array, bounds: Float64Array, image: WorkingImage, T_camera_world: Float64Array, far_m: float
) -> npt.NDArray[np.int64]:
    """Return which boxes (N, 15), see `pack`, reach into the picture, and so near, with their spheres, ascending.

    A row of NaN is in no picture; `bounds` are those of batches of boxes, see `kernels.overlap.bound`.
    """
    c, found = image.camera, np.empty(len(boxes), np.int64)
    pinhole, T = c.pinhole, np.ascontiguousarray(T_camera_world)
    return found[: kernel.boxes_in_frustum(boxes, bounds, T, pinhole, c.width, c.height, far_m, found)]


def measure_visibility(
    objects: Sequence[MapObject],
    boxes: Float64Array,
    observed: Observation,
    slots: npt.NDArray[np.int32],
    owner: npt.NDArray[np.int32],
    noise_per_m: float,
) -> list[Visibility]:
    """Return the visibility of each object in this frame.

    A point counts as seen when the reading at its pixel agrees with it; where there is none (in the shadow of what
    stands before it, on what is dark or shines), when the color does. One behind a reading of its own object is
    on the far side and counts not at all; one behind anything else is hidden. Of the points outside the picture or
    without a reading, half count as hidden: half of an object faces away.

    Parameters
    ----------
    boxes : (n, 15) float64
        Theirs, see `pack`.
    observed : Observation
    slots : (h, w) int32
        Voxel of each working pixel, -1 none.
    owner : (N,) int32
        Number of the object that each voxel belongs to, 0 none.
    noise_per_m : float
        Standard deviation of depth is this times z squared.
    """
    image = observed.image
    if not objects:
        return []
    some = [slice(None, None, max(1, len(o.points) // SAMPLE_POINTS)) for o in objects]
    points = [o.points[own] for o, own in zip(objects, some, strict=True)]
    colors = [o.colors[own] for o, own in zip(objects, some, strict=True)]
    n, c = len(objects), image.camera
    counts, corners = np.empty((n, 3), np.int64), np.empty((n, 4))
    ends, numbers = np.cumsum([len(p) for p in points]), np.array([o.number for o in objects])
    surfaces = kernel.Surfaces(np.concatenate(points), np.concatenate(colors), ends, _feet(boxes), numbers)
    pinhole, T = c.pinhole, np.ascontiguousarray(observed.T_camera_world)
    view = kernel.View(image.depth_m, image.color, slots, owner, pinhole, T)
    kernel.count_seen(surfaces, view, noise_per_m, DRIFT_M, ALIKE, counts, corners)
    seen, hidden, unknown = counts.T
    visible = seen / np.maximum(1.0, seen + hidden + 0.5 * unknown)
    seen_enough = (visible >= MIN_VISIBLE_FRACTION) & (seen >= MIN_READINGS)
    rectangles = _rectangles(corners, image)
    return [Visibility(float(visible[k]), rectangles[k], bool(seen_enough[k])) for k in range(n)]


def sightings_of(
    visible: Sequence[tuple[MapObject, Visibility]], frame_segments: FrameSegments, found: Association
) -> tuple[Sighting, ...]:
    """Return the sightings of the labelled objects among those that a frame shows, by label.

    Parameters
    ----------
    visible : sequence of (MapObject, Visibility)
        The objects that the frame shows, once this is recorded.
    frame_segments : FrameSegments
    found : Association
    """
    matched = [(found.objects[j].survivor.number, i, j) for i, j in enumerate(found.match.tolist()) if j >= 0]
    iou = {number: float(found.iou[i, j]) for number, i, j in matched}
    rect = {number: frame_segments.segments[i].rect_xyxy for number, i, _ in matched}
    sightings = []
    for entry, view in visible:
        if entry.confirmed:
            own = None if entry.frames_seen == 1 else iou.get(entry.number)  # a first sighting has no box before it
            rect_xyxy = blended_rectangle(view.rect_xyxy, rect.get(entry.number))
            sightings.append(Sighting(entry.label, entry.box, own, view.visible, rect_xyxy))
    return tuple(sorted(sightings, key=lambda s: s.label))


def blended_rectangle(rect_xyxy: Float64Array, own_xyxy: Float64Array | None) -> Float64Array:
    """Return the rectangle (4,) of an object in a frame, moved by a fifth towards that of the frame's own segment.

    The map errs by poses and by what it lacks, the frame by noise and holes: both together err less. A segment whose
    rectangle is not the same one says nothing, None neither.
    """
    if own_xyxy is None or rect_iou(rect_xyxy, own_xyxy) < SAME:
        return rect_xyxy
    return np.asarray(rect_xyxy + BLEND_GAIN * (own_xyxy - rect_xyxy))


def _feet(boxes: Float64Array) -> Float64Array:
    """Return what boxes (n, 15) stand on, (n, 4): the normal of each plane, and normal.p of all that lies on it."""
    up = boxes[:, 8::3]
    return np.column_stack([up, (up * boxes[:, :3]).sum(1) - boxes[:, 5] / 2])


def _rectangles(corners: Float64Array, image: WorkingImage) -> Float64Array:
    """Return the rectangles (n, 4) in the full image of those in the working image, zeros where there is none."""
    full = np.array([image.camera.width, image.camera.height] * 2) * image.step
    origin, end = np.array([*image.phase, *image.phase]), np.array([0, 0, image.step, image.step])
    rectangles = np.clip(corners * image.step + origin + end, 0, full)
    rectangles[corners[:, 0] > corners[:, 2]] = 0.0
    return np.asarray(rectangles, dtype=np.float64)
