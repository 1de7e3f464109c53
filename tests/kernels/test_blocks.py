"""Images made smaller."""

from __future__ import annotations

import numpy as np

from cuboid.ground.core.kernels.blocks import take_one


def test_one_pixel_of_each_block_is_taken_as_slices_do() -> None:
    color = np.random.default_rng(1).integers(0, 256, (13, 17, 3)).astype(np.uint8)
    for step, x, y in ((1, 0, 0), (2, 1, 0), (2, 0, 1), (3, 2, 1)):
        out = np.empty((13 // step, 17 // step, 3), np.uint8)
        take_one(color, step, x, y, out)
        np.testing.assert_array_equal(out, color[y::step, x::step][: 13 // step, : 17 // step])
