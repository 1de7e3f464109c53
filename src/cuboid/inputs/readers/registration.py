"""Registration of depth to color, for two cameras side by side."""

from __future__ import annotations

import cv2
import numpy as np

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.frame import Intrinsics
from cuboid.inputs.readers.depth_camera import DepthCamera

# Maximum error, pixels, of a pixel's ray when projected through the lens again; beyond it the lens model is not valid.
RAY_ERROR_PX = 0.5
# Minimum focal length, pixels: with a shorter one the whole scene fits into a few pixels.
MIN_FOCAL_PX = 1.0
# Minimum fraction of pixels with a valid ray; with fewer the lens is implausible.
MIN_SEEN = 0.5


class Registration:
    """Registration of depth from its own camera to the color image, computed once for all frames.

    Every surface seen by the depth camera is projected to the color camera and hides surfaces behind it. Surfaces that
    only the color camera sees have no reading.

    Parameters
    ----------
    depth : DepthCamera
    color : Intrinsics
        Pinhole of the color image, distortion taken out.

    Raises
    ------
    ValueError
        A focal length, or the coefficients of the depth camera's lens, are none.
    """

    def __init__(self, depth: DepthCamera, color: Intrinsics) -> None:
        if not min(depth.fx, depth.fy, color.fx, color.fy) >= MIN_FOCAL_PX:
            raise ValueError(f"a focal length is {min(depth.fx, depth.fy, color.fx, color.fy):.3g} pixels")
        self._T_color_depth = np.ascontiguousarray(depth.T_color_depth)
        self._K_color = color.pinhole
        self._shape = (color.height, color.width)
        self._pixel = 1.0 / min(depth.fx, depth.fy)
        rays = _rays(depth)
        if not np.isfinite(rays).mean() > MIN_SEEN:
            raise ValueError(
                "its distortion coefficients bend the image by more than a lens does; the order is k1, k2, p1, p2, k3"
            )
        self._rays = rays.astype(np.float32)
        self._footprint = _footprint(rays, self._T_color_depth, color)

    def __call__(self, depth_m: Float32Array, name: str) -> Float32Array:
        """Return depth (H, W) of the depth camera as seen in the color image (h, w), metres, 0 for no reading.

        Parameters
        ----------
        depth_m : (H, W) float32
        name : str
            The depth image's name in messages.

        Raises
        ------
        FrameError
            If no reading lies in the color image.
        """
        from cuboid.inputs.readers.kernels.registration import project_depth, splat_depth

        uvz = np.empty((*depth_m.shape, 3), np.float32)
        offset, out_m = np.empty(self._shape, np.float32), np.empty(self._shape, np.float32)
        project_depth(depth_m, self._rays, self._T_color_depth, self._K_color, uvz)
        splat_depth(uvz, self._footprint, self._pixel, offset, out_m)
        if not out_m.any():
            raise FrameError(f"depth image {name} has no reading in the color image; check T_color_depth")
        return out_m


def _rays(depth: DepthCamera) -> Float64Array:
    """Return x / z and y / z of each pixel (H, W, 2), NaN where the lens's model gives none."""
    width, height = depth.size
    u, v = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    rays = np.stack([(u - depth.cx) / depth.fx, (v - depth.cy) / depth.fy], axis=-1)
    if not any(depth.distortion):
        return rays
    K = np.array([[depth.fx, 0, depth.cx], [0, depth.fy, depth.cy], [0, 0, 1]])
    pixels, lens = np.stack([u, v], axis=-1).reshape(-1, 1, 2), np.array(depth.distortion)
    ending = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-8)
    found = np.asarray(cv2.undistortPoints(pixels, K, lens, criteria=ending), np.float64)
    in_space = np.concatenate([found, np.ones((len(found), 1, 1))], axis=2)
    bent = np.asarray(cv2.projectPoints(in_space, np.zeros(3), np.zeros(3), K, lens)[0], np.float64)
    found[~(np.abs(bent - pixels).max(axis=2) < RAY_ERROR_PX)] = np.nan
    return found.reshape(height, width, 2)


def _footprint(rays: Float64Array, T_color_depth: Float64Array, color: Intrinsics) -> Float32Array:
    """Return the steps (u, v) in the color image to the next column and the next row, (H, W, 4).

    They hold for a surface that faces the camera, at a depth where the baseline is negligible.
    """
    focal = np.array([color.fx, color.fy])
    turned = T_color_depth[:2, :2] * focal[:, None]  # a ray's small step in the color image
    steps = [np.nan_to_num(np.gradient(rays, axis=axis) @ turned.T) for axis in (1, 0)]
    return np.concatenate(steps, axis=2).astype(np.float32)
