"""Frames with fewer pixels: for `--scale`, when speed matters more than the smallest objects."""

from __future__ import annotations

import numpy as np

from cuboid.ground.core.frame import Frame


def downscale(frame: Frame, factor: int) -> Frame:
    """Return the frame whose pixels are blocks of `factor` x `factor` pixels of this one.

    A block that shows two surfaces gets the depth of one of them, never a value in between.
    The intrinsics of the result are `Intrinsics.downscaled(factor)`: color and depth belong to the block's centre.
    Rows and columns that do not fill a block are dropped.

    Parameters
    ----------
    frame : Frame
        H x W pixels.
    factor : int
        1, 2 or 4.

    Returns
    -------
    Frame
        H // factor x W // factor pixels; color is the block's mean.
    """
    if factor == 1:
        return frame
    import cv2

    from cuboid.ground.core.depth import halved

    height, width = frame.depth_m.shape[0] // factor, frame.depth_m.shape[1] // factor
    color = frame.color[: height * factor, : width * factor]
    depth_m = frame.depth_m[: height * factor, : width * factor]
    small = cv2.resize(color, (width, height), interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
    for _ in range(factor.bit_length() - 1):
        depth_m = halved(depth_m)
    camera = None if frame.camera is None else frame.camera.downscaled(factor)
    return Frame(frame.index, frame.timestamp_s, small, depth_m, frame.T_world_camera, frame.up_camera, camera)
