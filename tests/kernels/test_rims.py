"""The slab that is a rim, beside the same question in NumPy and SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from cuboid.ground.core.limits import SAMPLE_POINTS
from cuboid.ground.core.tolerances import MIN_READINGS
from cuboid.method.objects.kernels.rims import BENEATH_FRACTION, RIM_WIDTH_FRACTION, WIDTH_END_FRACTION, highest_rim

GAP_M, SLAB_M = 0.02, 0.03


def rims(points: np.ndarray, slabs: list[tuple[int, int]], axes: np.ndarray) -> list[int]:
    """Return which slabs of points that are sorted by height are rims."""
    plan, found = (points @ axes).astype(np.float32), []
    for k, (begin, end) in enumerate(slabs):
        slab, rest = plan[begin:end], plan[end:]
        slab, rest = slab[:: 1 + len(slab) // SAMPLE_POINTS], rest[:: 1 + len(rest) // SAMPLE_POINTS]
        if len(slab) < MIN_READINGS:
            continue
        along = np.linalg.eigh(np.cov(slab.T))[1][:, 1]
        low, high = np.quantile(slab @ along, [WIDTH_END_FRACTION, 1.0 - WIDTH_END_FRACTION])
        low_rest, high_rest = np.quantile(rest @ along, [WIDTH_END_FRACTION, 1.0 - WIDTH_END_FRACTION])
        beneath = (cKDTree(rest).query(slab)[0] < GAP_M).mean()
        if high_rest - low_rest <= RIM_WIDTH_FRACTION * (high - low) and beneath < BENEATH_FRACTION:
            found.append(k)
    return found


@pytest.mark.parametrize("seed", range(12))
def test_the_highest_slab_that_is_a_rim_is_found(seed: int) -> None:
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    jar = rng.uniform((0.0, 0.0, 0.0), (0.1, 0.1, 0.25), (3000, 3))
    board = rng.uniform(
        (-0.2, -0.1, 0.03 * (seed % 4)), (rng.uniform(0.0, 0.5), -0.04, 0.03 * (seed % 4) + 0.02), (900, 3)
    )
    local = np.concatenate([jar, board])
    points = (local @ axes.T).astype(np.float32)
    order = np.argsort(local[:, 2], kind="stable")
    low = np.arange(0.0, 0.12, SLAB_M)
    begins, ends = np.searchsorted(local[order, 2], low), np.searchsorted(local[order, 2], low + SLAB_M)
    expected = rims(points[order], list(zip(begins, ends, strict=True)), axes[:, :2])
    found = highest_rim(points, order, begins, ends, np.ascontiguousarray(axes[:, :2]), GAP_M)
    assert found == max(expected, default=-1)
    # Wide boards are rims, narrow ones are none.
    assert (found >= 0) == (np.ptp(board[:, 0]) > 0.21) or abs(np.ptp(board[:, 0]) - 0.21) < 0.06
