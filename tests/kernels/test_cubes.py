"""Cubes of voxels: which of them a picture may show."""

from __future__ import annotations

import numpy as np

from cuboid.ground.geometry import se3
from cuboid.method.heatmap.kernels.cubes import BATCH, CUBE_SIDE, empty_cubes, make_cube, pack_key
from cuboid.method.heatmap.kernels.lookup import cubes_in_frustum

VOXEL_M, CAMERA, WIDTH, HEIGHT, FAR_M = 0.01, np.array([60.0, 55.0, 31.5, 23.5]), 64, 48, 3.0


def test_cubes_in_view_are_those_whose_spheres_reach_into_the_picture() -> None:
    rng = np.random.default_rng(4)
    numbers = np.unique(rng.integers(-9, 9, (4000, 3)), axis=0)
    cubes = empty_cubes(4096, np.zeros(1, np.uint16))
    for x, y, z in numbers:
        make_cube(np.int64(pack_key(x, y, z)), cubes)
    side = CUBE_SIDE * VOXEL_M
    radius = 1.74 * side / 2
    found, shown = np.empty(4096, np.int64), set()
    for _ in range(20):
        T = se3.exp(np.concatenate([rng.uniform(-3, 3, 3), rng.uniform(-2, 2, 3)]))
        x, y, z = ((numbers + 0.5) * side @ T[:3, :3].T + T[:3, 3]).T
        expected = (z >= -radius) & (z <= FAR_M + radius)
        for place, f, c, size in ((x, CAMERA[0], CAMERA[2], WIDTH), (y, CAMERA[1], CAMERA[3], HEIGHT)):
            first, last = c + 1.0, size - c
            expected &= f * place + first * z >= -radius * np.hypot(f, first)
            expected &= last * z - f * place >= -radius * np.hypot(f, last)
        count = cubes_in_frustum(T, CAMERA, WIDTH, HEIGHT, FAR_M, VOXEL_M, cubes, found)
        assert found[:count].tolist() == np.flatnonzero(expected).tolist()
        shown.add(count)
    assert max(shown) > 50
    # What lies far away is passed over by its batch.
    cubes.bounds[: len(numbers) // BATCH + 1] += 100_000
    assert cubes_in_frustum(T, CAMERA, WIDTH, HEIGHT, FAR_M, VOXEL_M, cubes, found) == 0
