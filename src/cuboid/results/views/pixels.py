"""Pictures in a smaller size, and as JPEG."""

from __future__ import annotations

import cv2
import numpy as np

from cuboid.ground.arrays import UInt8Array


def shrunk(picture: UInt8Array, max_width_px: int) -> UInt8Array:
    """Return a picture (H, W, 3) at most so wide."""
    height, width = picture.shape[:2]
    if width <= max_width_px:
        return picture
    size = (max_width_px, max(1, round(height * max_width_px / width)))
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)


def encode_jpeg(picture: UInt8Array, quality: int) -> bytes:
    """Return a picture (H, W, 3), RGB, as JPEG."""
    done, content = cv2.imencode(".jpg", picture[..., ::-1], (cv2.IMWRITE_JPEG_QUALITY, quality))
    if not done:
        raise ValueError(f"a picture of {picture.shape[1]} x {picture.shape[0]} pixels cannot be encoded as JPEG")
    return content.tobytes()
