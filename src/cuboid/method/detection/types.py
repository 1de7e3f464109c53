"""Detections of one frame: boxes, class scores over a vocabulary, and optional masks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from cuboid.ground.arrays import Float32Array, UInt8Array
from cuboid.ground.core.frame import Frame, Intrinsics


@dataclass(frozen=True, slots=True)
class Detections:
    """The output of a detector for one frame.

    Attributes
    ----------
    boxes_xyxy : (N, 4) int32
        Rectangles in pixels, end exclusive, inside the image, at least one pixel large.
    scores : (N, C) float32
        Score of each box for each class, 0..1.
    names : tuple of str
        The vocabulary: a name for each of the C classes; the empty name means an object of unknown class.
    masks : sequence of (h, w) uint8, or None
        Mask of each box, cropped to the box: 1 for pixels of the object, else 0; None without masks.
    """

    boxes_xyxy: np.ndarray[tuple[int, int], np.dtype[np.int32]]
    scores: Float32Array
    names: tuple[str, ...]
    masks: Sequence[UInt8Array] | None = None

    def __post_init__(self) -> None:
        n, classes = len(self.scores), len(self.names)
        if self.boxes_xyxy.shape != (n, 4) or self.scores.shape != (n, classes):
            raise ValueError(
                f"detections need boxes (N, 4) and scores (N, {classes}) for {classes} names, "
                f"got {self.boxes_xyxy.shape}, {self.scores.shape}"
            )
        sides = self.boxes_xyxy[:, 2:] - self.boxes_xyxy[:, :2]
        if n and (self.boxes_xyxy.min() < 0 or sides.min() < 1):
            raise ValueError("detections need boxes of x0, y0 >= 0, x1 > x0 and y1 > y0")
        if n and not ((self.scores >= 0) & (self.scores <= 1)).all():
            raise ValueError("detections need scores of 0..1")
        if self.masks is not None and [mask.shape for mask in self.masks] != [(h, w) for w, h in sides.tolist()]:
            raise ValueError("detections need a mask for each box, of the box's height and width")

    def __repr__(self) -> str:
        return f"Detections({len(self)} {'boxes' if self.masks is None else 'masks'} of {len(self.names)} classes)"

    def __len__(self) -> int:
        return len(self.scores)

    @property
    def best_scores(self) -> Float32Array:
        """Score (N,) of the most likely class of each box."""
        return np.asarray(self.scores.max(axis=1, initial=0.0))


class Detector(Protocol):
    """Any callable from a frame to its detections."""

    def __call__(self, frame: Frame, intrinsics: Intrinsics) -> Detections:
        """Return the detections of `frame`, which has these `intrinsics`."""
        ...
