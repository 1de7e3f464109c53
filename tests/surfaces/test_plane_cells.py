"""The cells of a picture: as wide, seen from the camera, in every image."""

from __future__ import annotations

import numpy as np

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.depth import DepthImage, cell_pixels
from cuboid.ground.core.frame import Intrinsics
from cuboid.method.surfaces.cells import find_cells
from made_scenes import CAMERA, cast, look_at, upright


def test_a_picture_of_twice_the_resolution_shows_as_many_cells_that_are_no_less_true() -> None:
    c = CAMERA
    fine = Intrinsics(2 * c.fx, 2 * c.fy, 2 * c.cx + 0.5, 2 * c.cy + 0.5, 2 * c.width, 2 * c.height)
    rng, config, T = np.random.default_rng(0), TrackerConfig(), look_at((0.0, -0.9, 0.7), (0, 0, 0))
    found = []
    for camera in (c, fine):
        depth, _ = cast([upright((0, 0), (1.4, 1.0, 0.05), z=-0.05)], T, camera)
        depth = np.where(depth > 0, depth + rng.normal(size=depth.shape) * 1e-3 * depth**2, 0).astype(np.float32)
        found.append(find_cells(DepthImage(depth, camera), T, config.depth_noise_per_m, config.max_depth_m))
    coarse, full = found
    assert abs(len(full.places) / len(coarse.places) - 1.0) < 0.1
    assert abs(full.area_m2.sum() / coarse.area_m2.sum() - 1.0) < 0.1
    tilts = [np.degrees(np.median(np.arccos(np.clip(cells.normal[:, 2], -1.0, 1.0)))) for cells in found]
    assert tilts[1] <= tilts[0]


def test_a_cell_of_a_coarse_picture_has_as_many_readings_as_tell_a_slope() -> None:
    assert cell_pixels(CAMERA) == cell_pixels(CAMERA.downscaled(2)) == 8
