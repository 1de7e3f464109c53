from __future__ import annotations

import numpy as np

from cuboid.inputs.calibration.kernels.edges import depth_edges, edge_agreement


def ends(depth, jump=0.05, gap=3):
    out, across = np.empty((depth.size, 3), np.float32), np.empty(depth.size, np.bool_)
    count = depth_edges(depth.astype(np.float32), jump, gap, out, across)
    return {(*map(float, row), bool(along)) for row, along in zip(out[:count], across[:count], strict=True)}


def ends_by_the_book(depth, jump=0.05, gap=3):
    """The truth: from each reading with one like it behind, on to the next reading, over a short gap."""
    found = set()
    for (r, c), z in np.ndenumerate(depth):
        if z <= 0 or r in (0, depth.shape[0] - 1) or c in (0, depth.shape[1] - 1):
            continue
        for dr, dc in ((0, 1), (0, -1), (1, 0), (-1, 0)):
            behind = depth[r - dr, c - dc]
            line = [(r + k * dr, c + k * dc) for k in range(1, gap + 2)]
            beyond = [depth[p] for p in line if 0 <= p[0] < depth.shape[0] and 0 <= p[1] < depth.shape[1]]
            after = next((one for one in beyond if one > 0), 0)
            if behind > 0 and abs(behind - z) <= jump * z / 2 and after > z * (1 + jump):
                found.add((c + dc / 2, r + dr / 2, float(np.float32(z)), dc != 0))
    return found


def test_ends_of_surfaces_equal_the_truth():
    rng = np.random.default_rng(4)
    depth = np.full((30, 40), 2.0)
    depth[8:20, 10:25] = 1.0
    depth[15:27, 20:33] = 1.2
    depth[8:20, 25:27] = 0  # a projector's shadow
    depth[rng.random(depth.shape) < 0.05] = 0
    found = ends(depth)
    assert found == ends_by_the_book(np.float32(depth).astype(float))
    assert (9.5, 12.0, 1.0, True) in found


def test_agreement_equals_the_truth():
    rng = np.random.default_rng(5)
    strength = rng.random((2, 2, 24, 32), np.float32)
    places = np.column_stack([rng.uniform(0, 31, 50), rng.uniform(0, 23, 50), rng.uniform(0.5, 3, 50)])
    across, image = rng.random(50) < 0.5, rng.integers(0, 2, 50).astype(np.int32)
    moves = np.array([[1, 0, 0, 0, 0], [1.1, 2, -1, 0.5, -0.2]])
    center = np.array([15.5, 11.5])
    sums, counts = np.empty((2, 2)), np.empty((2, 2))
    edge_agreement(places.astype(np.float32), across, image, strength, moves, center, sums, counts)
    expected = np.zeros((2, 2, 2))
    for m, (g, du, dv, p, q) in enumerate(moves):
        at = center + g * (places[:, :2] - center) + (du, dv) + np.outer(1 / places[:, 2], (p, q))
        for (u, v), along, k in zip(at, across, image, strict=True):
            c, r = int(np.floor(u)), int(np.floor(v))
            if 0 <= c < 31 and 0 <= r < 23:
                (a, b), block = (u - c, v - r), strength[k, 0 if along else 1, r : r + 2, c : c + 2]
                expected[:, m, k] += (np.array([1 - b, b]) @ block @ np.array([1 - a, a]), 1)
    np.testing.assert_allclose(sums, expected[0], rtol=1e-4)
    np.testing.assert_array_equal(counts, expected[1])
