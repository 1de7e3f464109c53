"""The interface between 2D proposal sources and the later stages, which do not depend on the source."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Protocol, overload

import numpy as np

from cuboid.ground.arrays import Float32Array, UInt8Array
from cuboid.ground.core.frame import Frame, Intrinsics


class JoinedMasks(Sequence[UInt8Array]):
    """Masks that are stored one after the other in one array; each is extracted on access.

    Parameters
    ----------
    flat : (L,) uint8
        The pixels of all masks, row by row.
    sizes : list of [int, int]
        Width and height of each mask.
    """

    def __init__(self, flat: UInt8Array, sizes: list[list[int]]) -> None:
        self.flat, self.sizes = flat, sizes
        self._ends = list(accumulate(wide * high for wide, high in sizes))

    def __len__(self) -> int:
        return len(self.sizes)

    @overload
    def __getitem__(self, k: int) -> UInt8Array: ...
    @overload
    def __getitem__(self, k: slice) -> tuple[UInt8Array, ...]: ...
    def __getitem__(self, k: int | slice) -> UInt8Array | tuple[UInt8Array, ...]:
        if isinstance(k, slice):
            return tuple(self[i] for i in range(len(self))[k])
        end, (wide, high) = self._ends[k], self.sizes[k]
        return self.flat[end - wide * high : end].reshape(high, wide)


@dataclass(frozen=True, slots=True)
class Proposals:
    """Class-agnostic 2D proposals of one frame.

    Attributes
    ----------
    boxes_xyxy : (N, 4) int32
        Rectangles in pixels, end exclusive, inside the image, at least one pixel large.
    scores : (N,) float32
        Confidence of the source, 0..1; larger is better.
    masks : sequence of (h, w) uint8, or None
        For each rectangle, a mask cropped to the rectangle: 1 for pixels of the proposal, else 0;
        None if the source gives only boxes.
    mask_step : int
        Side of the block of image pixels that one mask pixel represents, pixels; rectangles begin and end at multiples
        of it.
    """

    boxes_xyxy: np.ndarray[tuple[int, int], np.dtype[np.int32]]
    scores: Float32Array
    masks: Sequence[UInt8Array] | None = None
    mask_step: int = 1

    def __post_init__(self) -> None:
        n = len(self.scores)
        if self.boxes_xyxy.shape != (n, 4) or self.scores.shape != (n,):
            raise ValueError(
                f"proposals need boxes (N, 4) and scores (N,), got {self.boxes_xyxy.shape}, {self.scores.shape}"
            )
        sides = self.boxes_xyxy[:, 2:] - self.boxes_xyxy[:, :2]
        if n and (self.boxes_xyxy.min() < 0 or sides.min() < 1 or not np.isfinite(self.scores).all()):
            raise ValueError("proposals need boxes of x0, y0 >= 0, x1 > x0 and y1 > y0, and finite scores")
        if self.masks is not None and len(self.masks) != n:
            raise ValueError(f"proposals need a mask for each of the {n} boxes, got {len(self.masks)}")
        step = self.mask_step
        if step < 1 or (step > 1 and n and (self.boxes_xyxy % step).any()):
            raise ValueError(f"proposals with masks of step {step} need boxes that begin and end at its multiples")
        blocks = (sides // step).tolist()
        if isinstance(self.masks, JoinedMasks) and self.masks.sizes == blocks:
            return
        for mask, (wide, high) in zip(self.masks or (), blocks, strict=False):
            if mask.shape != (high, wide):
                raise ValueError(
                    f"the mask of a box of {wide * step} x {high * step} pixels must be ({high}, {wide}), "
                    f"got {mask.shape}"
                )

    def __repr__(self) -> str:
        return f"Proposals({len(self)} {'boxes' if self.masks is None else 'masks'})"

    def __len__(self) -> int:
        return len(self.scores)

    def best(self, max_count: int) -> Proposals:
        """Return the `max_count` proposals with the highest scores, in their current order."""
        if len(self) <= max_count:
            return self
        kept = np.sort(np.argsort(-self.scores, kind="stable")[:max_count])
        masks = None if self.masks is None else tuple(self.masks[k] for k in kept.tolist())
        return Proposals(self.boxes_xyxy[kept], self.scores[kept], masks, self.mask_step)

    def full_masks(self) -> Sequence[UInt8Array] | None:
        """Return the masks at full resolution: one mask pixel for each pixel of their rectangles."""
        if self.masks is None or self.mask_step == 1:
            return self.masks
        return tuple(mask.repeat(self.mask_step, 0).repeat(self.mask_step, 1) for mask in self.masks)


class ProposalSource(Protocol):
    """A callable that returns the proposals of a frame."""

    def __call__(self, frame: Frame, intrinsics: Intrinsics) -> Proposals:
        """Return the 2D proposals of `frame`; `intrinsics` belong to its image."""
        ...
