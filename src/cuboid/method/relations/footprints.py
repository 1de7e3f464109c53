"""Boxes from above: each is a rectangle on the ground and a range of heights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.geometry.box import Box
from cuboid.method.boxes.fit import plane_axes

IntArray = npt.NDArray[np.int64]

# Points along each side of a footprint for the comparison with another one; they give the common fraction to 1/64.
SAMPLES = 8
_CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
_GRID = np.stack(np.meshgrid(*[(np.arange(SAMPLES) + 0.5) / SAMPLES * 2.0 - 1.0] * 2), -1).reshape(-1, 2)


@dataclass(frozen=True, slots=True, eq=False)
class Footprints:
    """Footprints and heights of N boxes.

    Attributes
    ----------
    ground : (3, 2) float64
        Two axes across up; coordinates on the ground are p @ ground, metres.
    center : (N, 2) float64
        Centres of the rectangles, on the ground.
    axes : (N, 2, 2) float64
        Columns are the directions of the sides, unit vectors on the ground.
    half : (N, 2) float64
        Half the sides, metres.
    low, high : (N,) float64
        Heights of foot and top along up, metres.
    """

    ground: Float64Array
    center: Float64Array
    axes: Float64Array
    half: Float64Array
    low: Float64Array
    high: Float64Array

    @classmethod
    def of(cls, boxes: Sequence[Box], up: Float64Array) -> Footprints:
        """Return the footprints of boxes; for a tilted box, the footprint of the upright box around it.

        Parameters
        ----------
        boxes : sequence of Box
            In the world.
        up : (3,) float64
            Up in the world, a unit vector.
        """
        count = len(boxes)
        ground = np.column_stack(plane_axes(up))
        center = np.array([box.center for box in boxes]).reshape(count, 3)
        size = np.array([box.size for box in boxes]).reshape(count, 3)
        rotation = np.array([box.rotation for box in boxes]).reshape(count, 3, 3)
        steep = np.abs(np.einsum("i,nij->nj", up, rotation))
        reach = 0.5 * (steep * size).sum(1)
        flat = np.einsum("ik,nij->njk", ground, rotation)  # each axis of a box, on the ground
        first = flat[np.arange(count), np.argmin(steep, 1)]
        first = first / np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-12)
        axes = np.stack([first, np.column_stack([-first[:, 1], first[:, 0]])], -1)
        half = 0.5 * np.einsum("nja,nj->na", np.abs(flat @ axes), size)
        height = center @ up
        return cls(ground, center @ ground, axes, half, height - reach, height + reach)

    def __len__(self) -> int:
        """Return the number of boxes."""
        return len(self.low)

    def neighbours(self, within_m: float) -> tuple[IntArray, IntArray]:
        """Return the pairs (i, j), i < j, with footprints at most a distance apart, and some pairs beyond it."""
        from scipy.spatial import cKDTree

        if len(self) < 2:
            return np.zeros(0, np.int64), np.zeros(0, np.int64)
        radius = np.linalg.norm(self.half, axis=1)
        tree = cKDTree(self.center)
        near = tree.query_ball_point(self.center, radius + radius.max() + within_m)
        first = np.repeat(np.arange(len(self)), [len(one) for one in near])
        second = np.concatenate([np.asarray(one, np.int64) for one in near])
        away = np.linalg.norm(self.center[first] - self.center[second], axis=1)
        kept = (first < second) & (away <= radius[first] + radius[second] + within_m)
        order = np.lexsort((second[kept], first[kept]))
        return first[kept][order], second[kept][order]

    def common_fractions(self, one: IntArray, other: IntArray) -> Float64Array:
        """Return the fraction (P,), 0..1, of the footprint of each `one` (P,) that lies in that of `other` (P,)."""
        inside = np.abs(self._in_frame(other, self._points(one, _GRID))) <= self.half[other][:, None]
        return np.asarray(inside.all(2).mean(1))

    def gaps_m(self, one: IntArray, other: IntArray) -> Float64Array:
        """Return the distance (P,) between footprints, metres; for overlapping ones, minus the depth of the overlap."""
        beyond = [np.abs(self._in_frame(b, self._points(a, _CORNERS))) for a, b in ((one, other), (other, one))]
        away = [
            np.linalg.norm(np.maximum(corner - self.half[b][:, None], 0.0), axis=2).min(1)
            for corner, b in zip(beyond, (other, one), strict=True)
        ]
        apart = np.max([self._separation(a, b) for a, b in ((one, other), (other, one))], axis=0)
        return np.asarray(np.where(apart > 0.0, np.minimum(*away), apart))

    def _separation(self, one: IntArray, other: IntArray) -> Float64Array:
        """Return the distance of pairs along the sides of the second footprint, metres, negative for overlaps, (P,)."""
        between = np.abs(np.einsum("pij,pi->pj", self.axes[other], self.center[one] - self.center[other]))
        across = np.abs(np.einsum("pij,pik->pjk", self.axes[other], self.axes[one]))
        reach = np.einsum("pjk,pk->pj", across, self.half[one])
        return np.asarray((between - reach - self.half[other]).max(1))

    def _points(self, which: IntArray, units: Float64Array) -> Float64Array:
        """Return points of footprints on the ground, (P, K, 2), from positions in units of half sides (K, 2)."""
        local = units[None] * self.half[which][:, None]
        return np.asarray(self.center[which][:, None] + np.einsum("pij,pkj->pki", self.axes[which], local))

    def _in_frame(self, which: IntArray, points: Float64Array) -> Float64Array:
        """Return points (P, K, 2) on the ground in the frames of footprints: origin at centre, axes along sides."""
        return np.asarray((points - self.center[which][:, None]) @ self.axes[which])
