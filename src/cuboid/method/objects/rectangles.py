"""Rectangles in a frame as evidence for positions: the fraction with depth, the viewing ray, and the distance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.observation import Observation
from cuboid.ground.core.tolerances import DRIFT_M, MIN_READINGS, NEAREST_M
from cuboid.ground.geometry.rectangles import rect_iou_matrix
from cuboid.ground.geometry.se3 import transform

# Width of the rim around a rectangle whose readings give its distance if it contains none, as a fraction of its sides.
RIM = 0.2
# A reading hides an object if it is nearer by this, metres, plus this fraction of the object's distance.
HIDING_M, HIDING = 0.1, 0.1
# A rectangle within this distance of the image border is cut off by it, pixels.
BORDER_PX = 2.0


@dataclass(frozen=True, slots=True)
class Predicted:
    """The predicted view of an object in an image.

    Attributes
    ----------
    rect_xyxy : (4,) float64
        Rectangle clipped to the image, pixels of the full image.
    visible : float
        Fraction of the object that is inside the image and not hidden.
    read : float
        Fraction of the rectangle with depth readings.
    slack_px : float
        Largest offset of the rectangle caused by pose errors, pixels.
    """

    rect_xyxy: Float64Array
    visible: float
    read: float
    slack_px: float


def predict(place: Float64Array, size_m: Float64Array, seen: Observation) -> Predicted | None:
    """Predict the view of an object in a frame; None if it is outside the image.

    Parameters
    ----------
    place : (3,) float64
        Centre of the object, in the map.
    size_m : (2,) float64
        Width and height across the line of sight.
    seen : Observation
    """
    x, y, z = transform(seen.T_camera_world, place)
    if z <= NEAREST_M:
        return None
    image, camera = seen.image, seen.image.camera
    half = 0.5 * size_m * (camera.fx, camera.fy) / z
    middle = np.array([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy])
    rect = np.clip(np.concatenate([middle - half, middle + half]), 0.0, [camera.width, camera.height] * 2)
    sides = rect[2:] - rect[:2]
    if sides.min() < 1.0:
        return None
    depth_m = _inside(rect, seen.image.depth_m)
    read = float((depth_m > 0).mean()) if depth_m.size else 0.0
    hidden = float(((depth_m > 0) & (depth_m < z - HIDING_M - HIDING * z)).mean()) if depth_m.size else 0.0
    in_picture = min(1.0, float(sides.prod() / max(4.0 * half.prod(), 1e-9)))
    full = rect * image.step + [*image.phase, *image.phase]
    return Predicted(full, in_picture * (1.0 - hidden), read, DRIFT_M * camera.fx * image.step / z)


def shifted_iou(view: Predicted | None, boxes: Float64Array) -> Float64Array:
    """Return the IoU (N,) of a predicted rectangle with boxes (N, 4), shifted towards each within the pose error."""
    if view is None or not len(boxes):
        return np.zeros(len(boxes))
    off = 0.5 * (boxes[:, :2] + boxes[:, 2:] - view.rect_xyxy[:2] - view.rect_xyxy[2:])
    moved = view.rect_xyxy + np.tile(np.clip(off, -view.slack_px, view.slack_px), 2)
    return np.asarray(rect_iou_matrix(moved, boxes).diagonal())


def match_views(views: Sequence[Predicted | None], boxes: Float64Array, min_iou: float) -> dict[int, int]:
    """Return the box of each predicted view, by its index in the list: pairs with the largest overlap first.

    Parameters
    ----------
    views : sequence of Predicted or None
    boxes : (N, 4) float64
    min_iou : float
        Smallest IoU of a pair; see `shifted_iou`.
    """
    iou = np.array([shifted_iou(view, boxes) for view in views]).reshape(len(views), len(boxes))
    found: dict[int, int] = {}
    taken: set[int] = set()
    for flat in np.argsort(-iou, axis=None, kind="stable").tolist():
        i, k = divmod(flat, len(boxes))
        if iou[i, k] < min_iou:
            break
        if i not in found and k not in taken:
            found[i] = k
            taken.add(k)
    return found


def read_fraction(rect_xyxy: Float64Array, seen: Observation) -> float:
    """Return the fraction of a rectangle (4,), in pixels of the full image, that has depth readings."""
    depth_m = _inside(_working(rect_xyxy, seen), seen.image.depth_m)
    return float((depth_m > 0).mean()) if depth_m.size else 0.0


def is_cut_off(rect_xyxy: Float64Array, seen: Observation) -> bool:
    """Return whether a rectangle (4,), in pixels of the full image, reaches the image border."""
    image = seen.image
    full = np.array([image.camera.width, image.camera.height]) * image.step
    return bool((rect_xyxy[:2] <= BORDER_PX).any() or (rect_xyxy[2:] >= full - BORDER_PX).any())


def ray_through(rect_xyxy: Float64Array, seen: Observation) -> tuple[Float64Array, float]:
    """Return the direction (3,) to the centre of a rectangle, in the map, and its angular size, radians."""
    ray, size_rad = _ray(rect_xyxy, seen)
    return np.asarray(seen.T_world_camera[:3, :3] @ (ray / np.linalg.norm(ray))), size_rad


def distance_along(direction: Float64Array, z: float, seen: Observation) -> float:
    """Return the distance, metres, along a direction (3,) in the map at which the depth is z."""
    return float(z / max(float(seen.T_world_camera[:3, 2] @ direction), NEAREST_M))


def size_at(rect_xyxy: Float64Array, z: float, seen: Observation) -> Float64Array:
    """Return the width and height (2,), metres, of a rectangle at a depth z."""
    camera = seen.image.camera
    return np.asarray((rect_xyxy[2:] - rect_xyxy[:2]) / seen.image.step * z / (camera.fx, camera.fy))


def distance_of(rect_xyxy: Float64Array, seen: Observation) -> float | None:
    """Return the distance, metres, along the ray through the centre of a rectangle (4,), from the readings inside it.

    If there are too few, the readings around it are included; None if these are too few as well.
    """
    rect = _working(rect_xyxy, seen)
    rim = RIM * np.tile(rect[2:] - rect[:2], 2) * (-1.0, -1.0, 1.0, 1.0)
    for area in (rect, rect + rim):
        depth_m = _inside(area, seen.image.depth_m)
        readings = depth_m[depth_m > 0]
        if len(readings) >= MIN_READINGS:
            return float(np.median(readings) * np.linalg.norm(_ray(rect_xyxy, seen)[0]))
    return None


def _working(rect_xyxy: Float64Array, seen: Observation) -> Float64Array:
    """Transform a rectangle from the full image to the working image."""
    image = seen.image
    return np.asarray((rect_xyxy - [*image.phase, *image.phase]) / image.step)


def _inside(rect: Float64Array, depth_m: Float32Array) -> Float32Array:
    """Return the pixels of a working image inside a rectangle."""
    x0, y0, x1, y1 = np.clip(np.rint(rect), 0, [*depth_m.shape[::-1]] * 2).astype(int)
    return depth_m[y0:y1, x0:x1]


def _ray(rect_xyxy: Float64Array, seen: Observation) -> tuple[Float64Array, float]:
    """Return the ray through the centre of a rectangle at depth 1, in the camera, and its angular size, radians."""
    rect, camera = _working(rect_xyxy, seen), seen.image.camera
    middle, sides = (rect[:2] + rect[2:]) / 2.0, rect[2:] - rect[:2]
    return camera.points(middle[0], middle[1], 1.0), float(max(sides[0] / camera.fx, sides[1] / camera.fy))
