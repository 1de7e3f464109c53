"""Overlaps of rectangles that are aligned with the axes of an image."""

from __future__ import annotations

import numpy as np

from cuboid.ground.geometry.rectangles import rect_iou, rect_iou_matrix


def test_two_alone_overlap_as_they_do_among_many() -> None:
    rng = np.random.default_rng(4)
    low = rng.uniform(0, 40, (30, 2))
    rects = np.concatenate([low, low + rng.uniform(0, 30, (30, 2))], axis=1)
    rects[3, 2:] = rects[3, :2]  # without area
    rects[4, 2:] = rects[4, :2] - 5.0  # the wrong way round
    every = rect_iou_matrix(rects, rects)
    assert [[rect_iou(a, b) for b in rects] for a in rects] == every.tolist()
    assert (every > 0).sum() > 60
