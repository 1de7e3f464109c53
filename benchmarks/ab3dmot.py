"""Association as in AB3DMOT, of boxes that another program found.

After Weng, Wang, Held, Kitani, "3D Multi-Object Tracking: A Baseline and New Evaluation Metrics", IROS 2020: a Kalman
filter of constant velocity for each object (position, heading, size; the velocity of the position), 3D IoU between
predicted and found boxes, the Hungarian method, pairs below an IoU of 0.01 undone; an object is told of after 3 hits in
a row and forgotten after 2 frames without one. Noise as published: the covariance starts at 10, that of the velocity at
10,000, the velocity's process noise is 0.01, all others 1. Written by us after the paper; boxes turn about the normal
of their plane, so that the filter works in axes of which the third is that normal.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from cuboid.ground.arrays import Float64Array
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.overlap import iou_matrix, pack

MIN_IOU, MIN_HITS, MAX_AGE = 0.01, 3, 2
# State: x, y, z, heading, length, width, height, and the velocity of x, y, z; all but the velocity is measured.
_STEP = np.eye(10) + np.eye(10, k=7)
_MEASURE = np.eye(7, 10)
_PROCESS = np.diag([1.0] * 7 + [0.01] * 3)


class _Filter:
    def __init__(self, measured: Float64Array, label: int) -> None:
        self.label = label
        self.hits, self.since = 1, 0
        self.state = np.concatenate([measured, np.zeros(3)])
        self._covariance = np.diag([10.0] * 7 + [10_000.0] * 3)

    def predict(self) -> None:
        self.state = _STEP @ self.state
        self._covariance = _STEP @ self._covariance @ _STEP.T + _PROCESS
        if self.since > 0:
            self.hits = 0
        self.since += 1

    def update(self, measured: Float64Array) -> None:
        measured = measured.copy()
        turn = (measured[3] - self.state[3] + np.pi / 2) % np.pi - np.pi / 2  # a box has no front
        if abs(turn) > np.pi / 4:  # its length has become its width
            turn -= np.sign(turn) * np.pi / 2
            measured[4:6] = measured[[5, 4]]
        measured[3] = self.state[3] + turn
        gain = self._covariance @ _MEASURE.T @ np.linalg.inv(_MEASURE @ self._covariance @ _MEASURE.T + np.eye(7))
        self.state = self.state + gain @ (measured - _MEASURE @ self.state)
        self._covariance = (np.eye(10) - gain @ _MEASURE) @ self._covariance
        self.hits += 1
        self.since = 0


def track(frames: Sequence[Sequence[Box]], up: Float64Array, max_age: int = MAX_AGE) -> Iterator[list[tuple[int, Box]]]:
    """Yield the labelled boxes of each frame.

    Parameters
    ----------
    frames : sequence of sequence of Box
        The boxes found in each, in the world.
    up : (3,) float64
        Normal of the planes, in the world.
    max_age : int
        Frames that an object is kept without a box.
    """
    axes = np.linalg.svd(up[None])[2]
    R_world_plan = np.column_stack([axes[1], np.cross(up, axes[1]), up])
    filters: list[_Filter] = []
    labels = 0
    for number, boxes in enumerate(frames):
        for one in filters:
            one.predict()
        filters = [one for one in filters if np.isfinite(one.state).all()]
        known = pack([_box(one.state, R_world_plan) for one in filters])
        pairs = _update_affinity(iou_matrix(pack(boxes), known))
        for i, box in enumerate(boxes):
            measured = _measured(box, R_world_plan)
            if i in pairs:
                filters[pairs[i]].update(measured)
            else:
                labels += 1
                filters.append(_Filter(measured, labels))
        yield [
            (one.label, _box(one.state, R_world_plan))
            for one in filters
            if one.since == 0 and (one.hits >= MIN_HITS or number < MIN_HITS)
        ]
        filters = [one for one in filters if one.since < max_age]


def _update_affinity(iou: Float64Array) -> dict[int, int]:
    rows, columns = linear_sum_assignment(iou, maximize=True)
    return {int(i): int(j) for i, j in zip(rows, columns, strict=True) if iou[i, j] >= MIN_IOU}


def _measured(box: Box, R_world_plan: Float64Array) -> Float64Array:
    along = R_world_plan.T @ box.rotation[:, 0]
    heading = np.arctan2(along[1], along[0])
    return np.array([*(R_world_plan.T @ box.center), heading, *box.size])


def _box(state: Float64Array, R_world_plan: Float64Array) -> Box:
    c, s = np.cos(state[3]), np.sin(state[3])
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return Box(R_world_plan @ state[:3], np.maximum(state[4:7], 1e-3), R_world_plan @ turn)
