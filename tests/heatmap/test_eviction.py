from __future__ import annotations

import numpy as np

from cuboid.ground.core.working import WorkingImage
from cuboid.method.heatmap.voxel_map import VoxelMap
from made_scenes import CAMERA, cast, look_at, upright

SCENE = [upright((0, 0), (2, 2, 0.02), z=-0.02)]
POSE = look_at((0.9, -0.8, 0.9), (0.1, 0.1, 0.0))


def image() -> WorkingImage:
    depth, hit = cast(SCENE, POSE)
    return WorkingImage(
        depth.astype(np.float32), np.repeat((hit[..., None] + 2) * 60, 3, 2).astype(np.uint8), CAMERA, 1, (0, 0)
    )


def test_what_a_later_visit_adds_comes_back_as_it_was_put_aside() -> None:
    """What was there before the visit counts less; what came since does not."""
    voxels = VoxelMap(0.01, 1.4e-3, 3.0)
    voxels.begin_visit(3)
    for k in range(8):
        voxels.fuse(image(), np.zeros((240, 320), np.float32), POSE, k)
    rows = voxels.stored.living()
    before = voxels.stored.memory.rows[rows].copy()
    assert voxels.stored.hits[rows].max() > 3
    voxels.stored.memory_mb = 1.0
    voxels.stored.evict()
    assert not voxels.stored.cubes.bits.any(), "nothing was put aside"
    np.testing.assert_array_equal(voxels.stored.memory.rows[voxels.stored.living()], before)
    voxels.begin_visit(3)
    assert voxels.stored.hits[voxels.stored.living()].max() == 3
