"""An image as the input of a model: resized, placed, with colors normalised as in the model's training."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np

from cuboid.ground.arrays import Float64Array, UInt8Array

# Grey of the padding of an image whose aspect ratio differs from the input's.
GREY = 114


class Fit(NamedTuple):
    """The placement of the image in the input: input pixel = scale * image pixel + offset, for x and y."""

    scale_x: float
    scale_y: float
    left: int
    top: int

    def to_image(self, boxes_xyxy: Float64Array) -> Float64Array:
        """Convert boxes (N, 4) from input pixels to image pixels."""
        shift = np.array([self.left, self.top, self.left, self.top], dtype=np.float64)
        scale = np.array([self.scale_x, self.scale_y, self.scale_x, self.scale_y])
        return np.asarray((boxes_xyxy - shift) / scale)


@dataclass(frozen=True, slots=True)
class ImageForm:
    """The preprocessing of a model's image.

    Attributes
    ----------
    place : {"middle", "corner", "stretched"}
        Placement in the middle of the input or at its upper left, with the image's aspect ratio; or stretched to fill
        the input.
    blue_first : bool
        Whether the channels are blue, green, red.
    mean, deviation : (float, float, float)
        Mean and deviation of the channels in the model's order, levels 0..255: the input is (level - mean) / deviation.
    """

    place: Literal["middle", "corner", "stretched"] = "middle"
    blue_first: bool = False
    mean: tuple[float, float, float] = (0.0, 0.0, 0.0)
    deviation: tuple[float, float, float] = (255.0, 255.0, 255.0)

    def prepare(self, color: UInt8Array, rows: int, columns: int, dtype: Any) -> tuple[Any, Fit]:
        """Return the model's input (1, 3, rows, columns) for an RGB image (H, W, 3), and its placement."""
        import cv2

        height, width = color.shape[:2]
        if self.place == "stretched":
            placed = cv2.resize(color, (columns, rows), interpolation=cv2.INTER_LINEAR)
            fit = Fit(columns / width, rows / height, 0, 0)
        else:
            scale = min(columns / width, rows / height)
            w, h = max(1, round(width * scale)), max(1, round(height * scale))
            left, top = (0, 0) if self.place == "corner" else ((columns - w) // 2, (rows - h) // 2)
            placed = np.full((rows, columns, 3), GREY, np.uint8)
            placed[top : top + h, left : left + w] = cv2.resize(color, (w, h), interpolation=cv2.INTER_LINEAR)
            fit = Fit(scale, scale, left, top)
        planes = placed.transpose(2, 0, 1)[None].astype(np.float32)
        if self.blue_first:
            planes = planes[:, ::-1]
        if any(self.mean):
            planes = planes - np.array(self.mean, np.float32)[:, None, None]
        if self.deviation != (1.0, 1.0, 1.0):
            planes = planes / np.array(self.deviation, np.float32)[:, None, None]
        return np.ascontiguousarray(planes, dtype=dtype), fit


# Mean and deviation of ImageNet, with which many models normalise images: red, green, blue.
IMAGENET_MEAN = (123.675, 116.28, 103.53)
IMAGENET_DEVIATION = (58.395, 57.12, 57.375)
# The same of CLIP, of levels 0..1 (Radford et al., "Learning transferable visual models from natural language
# supervision", 2021).
CLIP_MEAN, CLIP_DEVIATION = (0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711)
YOLO_FORM = ImageForm()
YOLOX_FORM = ImageForm(place="corner", blue_first=True, deviation=(1.0, 1.0, 1.0))
STRETCHED_FORM = ImageForm(place="stretched")
IMAGENET_FORM = ImageForm(place="stretched", mean=IMAGENET_MEAN, deviation=IMAGENET_DEVIATION)
NANODET_FORM = ImageForm(
    place="stretched", blue_first=True, mean=IMAGENET_MEAN[::-1], deviation=IMAGENET_DEVIATION[::-1]
)
OWL_FORM = ImageForm(
    place="stretched", mean=(122.7709383, 116.7460125, 104.09373615), deviation=(68.5005327, 66.6321579, 70.32316305)
)
OWL_2_FORM = replace(OWL_FORM, place="corner")
