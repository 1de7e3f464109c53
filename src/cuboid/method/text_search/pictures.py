"""Pictures of an object for an image-text model: cut from its views, with and without the surroundings.

The mean over several views is better than any single view. The mean of a picture with the surroundings of the object
and a picture without them is better than either (A. Werby et al., "Hierarchical open-vocabulary 3D scene graphs",
2024).
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, UInt8Array
from cuboid.ground.core.tolerances import NEAREST_M
from cuboid.ground.geometry import se3
from cuboid.ground.geometry.box import Box
from cuboid.method.shapes.views import MARGIN_M, ObjectView
from cuboid.method.text_search.model import TextModel

# Number of embedded views of an object: more sides add little, and each view costs two runs of the model.
PICTURED_VIEWS = 5
# Readings less than this above the foot of a box, metres, may belong to its support: the noise of depth.
FOOT_M = 0.005
# A mask with less than this fraction of the picture shows no shape: the box misses the object, or the object is hidden.
MIN_OBJECT_FRACTION = 0.05


def embed_views(model: TextModel, views: Sequence[ObjectView], box: Box) -> Float32Array | None:
    """Return the mean unit vector (D,) of the pictures of an object; None if no view shows it.

    Parameters
    ----------
    model : TextModel
    views : sequence of ObjectView
    box : Box
        Box of the object, in the world of the views.
    """
    background = model.preparation.background
    return mean_vector(model, [picture for view in views for picture in pictures_of(view, box, background)])


def mean_vector(model: TextModel, pictures: Sequence[UInt8Array]) -> Float32Array | None:
    """Return the mean unit vector (D,) of square pictures; None without pictures."""
    if not pictures:
        return None
    mean = model.embed_pictures(pictures).mean(axis=0)
    return np.asarray(mean / max(float(np.linalg.norm(mean)), 1e-9), np.float32)


def pictures_of(view: ObjectView, box: Box, background: UInt8Array) -> list[UInt8Array]:
    """Return square pictures of an object: the unchanged view, and the object alone on a `background` (3,)."""
    found = [squared(view.color, background)]
    shown = object_pixels(view, box)
    if shown.mean() >= MIN_OBJECT_FRACTION:
        rows, columns = np.flatnonzero(shown.any(axis=1)), np.flatnonzero(shown.any(axis=0))
        cut = np.where(shown[..., None], view.color, background)
        found.append(squared(cut[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1], background))
    return found


def object_pixels(view: ObjectView, box: Box) -> npt.NDArray[np.bool_]:
    """Return which pixels (h, w) of a view show the object: within the outline of its box, and not measured outside it.

    Pixels without a reading are included, since dark and shiny parts have none.
    """
    camera = view.camera
    corners = se3.transform(se3.inverse(view.T_world_camera), box.corners())
    outline = np.zeros(view.depth_m.shape, np.uint8)
    if (corners[:, 2] < NEAREST_M).any():
        return outline > 0
    cv2.fillConvexPoly(outline, cv2.convexHull(np.rint(camera.pixels(corners)).astype(np.int32)), 1)
    v, u = np.nonzero((outline > 0) & (view.depth_m > 0))
    points = se3.transform(view.T_world_camera, camera.points(u, v, view.depth_m[v, u]))
    within = (points - box.center) @ box.rotation
    half = box.size / 2.0 + MARGIN_M
    other = (np.abs(within) > half).any(axis=1) | (within[:, 2] < FOOT_M - box.size[2] / 2.0)
    shown = outline > 0
    shown[v[other], u[other]] = False
    return shown


def squared(color: UInt8Array, background: UInt8Array) -> UInt8Array:
    """Return a picture (h, w, 3) at the centre of a square with its longer side."""
    height, width = color.shape[:2]
    side = max(height, width)
    square = np.empty((side, side, 3), np.uint8)
    square[:] = background
    top, left = (side - height) // 2, (side - width) // 2
    square[top : top + height, left : left + width] = color
    return square
