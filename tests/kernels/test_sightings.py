"""Points of objects in a frame: counted as array operations do it."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cuboid.ground.geometry.kernels.overlap import BATCH, bound
from cuboid.method.boxes.kernels.extents import BINS
from cuboid.method.objects.kernels.sightings import NEAREST_M, Surfaces, View, boxes_in_frustum, count_seen

CAMERA = np.array([30.0, 32.0, 19.5, 14.5])
NOISE, AGREE_M, MAX_COLOR_DIFFERENCE = 1.4e-3, 0.03, 30


def numpy_counts(
    points: np.ndarray,
    colors: np.ndarray,
    foot: np.ndarray,
    number: int,
    depth: np.ndarray,
    color: np.ndarray,
    owner: np.ndarray,
    T: np.ndarray,
) -> tuple[list[int], np.ndarray]:
    counted = np.repeat([True, False], [len(points), -(-len(points) // 2)])
    points = points.astype(float)
    above = points[::2] @ foot[:3] - foot[3]
    points = np.concatenate([points, points[::2] - above[:, None] * foot[:3]])
    colors = np.concatenate([colors, colors[::2]])
    seen_from = points @ T[:3, :3].T + T[:3, 3]
    z = np.maximum(seen_from[:, 2], NEAREST_M)
    u, v = seen_from[:, 0] / z * CAMERA[0] + CAMERA[2], seen_from[:, 1] / z * CAMERA[1] + CAMERA[3]
    x, y = np.rint(u).astype(int), np.rint(v).astype(int)
    front = seen_from[:, 2] > NEAREST_M
    inside = front & (x >= 0) & (y >= 0) & (x < depth.shape[1]) & (y < depth.shape[0])
    x, y = np.where(inside, x, 0), np.where(inside, y, 0)
    reading = np.where(inside, depth[y, x], 0.0)
    within = np.maximum(AGREE_M, 3 * NOISE * z * z)
    alike = inside & (np.abs(color[y, x].astype(int) - colors).max(1) <= MAX_COLOR_DIFFERENCE)
    seen = np.where(reading > 0, np.abs(reading - z) <= within, alike)
    unknown = (reading <= 0) & ~seen
    far_side = (reading > 0) & (reading < z - within) & (owner[y, x] == number)
    kinds = (seen, ~seen & ~unknown & ~far_side, unknown)
    counts = [int((which & counted).sum()) for which in kinds]
    behind = (reading > 0) & (reading < z - within) & (owner[y, x] != number)
    around = np.column_stack([np.clip(u, -40, 80), np.clip(v, -30, 60)])[front & ~behind]
    (left, right), (top, bottom) = (numpy_ends(line) for line in around.T)
    return counts, np.array([left, top, right, bottom])


def numpy_ends(values: np.ndarray) -> tuple[float, float]:
    if not len(values) or np.ptp(values) == 0:
        return min(values, default=np.inf), max(values, default=-np.inf)
    count, edges = np.histogram(values, BINS)
    below = np.concatenate([[0], np.cumsum(count)]) / len(values)

    def where(fraction: float) -> float:
        k = int(np.searchsorted(below, fraction, "left" if fraction < 0.5 else "right")) - 1
        return float(edges[k] + (fraction - below[k]) / (below[k + 1] - below[k]) * (edges[1] - edges[0]))

    low, high = 2 * where(0.02) - where(0.04), 2 * where(0.98) - where(0.96)
    return max(low, values.min()), min(high, values.max())


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
def test_points_are_counted_as_array_operations_do_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    depth = rng.choice([0.0, 0.9, 1.0, 1.1, 1.5], (30, 40)).astype(np.float32)
    color = rng.integers(0, 80, (30, 40, 3)).astype(np.uint8)
    owner = rng.integers(0, 4, (30, 40)).astype(np.int32)
    sizes, numbers = np.array([1, 80, 50]), np.array([1, 2, 7])
    points = rng.uniform([-1.0, -0.8, -0.3], [1.0, 0.8, 1.8], (sizes.sum(), 3)).astype(np.float32)
    points[-50:, 2] = -1.0  # the last one lies behind the camera
    colors = rng.integers(0, 80, (len(points), 3)).astype(np.uint8)
    up = rng.normal(size=(3, 3))
    feet = np.column_stack([up / np.linalg.norm(up, axis=1)[:, None], rng.normal(0.0, 0.3, 3)])
    T = np.eye(4)
    T[:3, 3] = rng.normal(0.0, 0.02, 3)
    ends = np.cumsum(sizes)
    counts, corners = np.empty((3, 3), np.int64), np.empty((3, 4))
    slots = np.arange(owner.size, dtype=np.int32).reshape(owner.shape)
    surfaces = Surfaces(points, colors, ends, feet, numbers)
    view = View(depth, color, slots, owner.ravel(), CAMERA, T)
    count_seen(surfaces, view, NOISE, AGREE_M, MAX_COLOR_DIFFERENCE, counts, corners)
    for k, end in enumerate(ends):
        own = slice(end - sizes[k], end)
        expected = numpy_counts(points[own], colors[own], feet[k], numbers[k], depth, color, owner, T)
        assert counts[k].tolist() == expected[0]
        np.testing.assert_allclose(corners[k], expected[1], atol=1e-9)


def test_boxes_in_view_are_those_whose_spheres_reach_into_the_picture() -> None:
    rng = np.random.default_rng(8)
    boxes = rng.uniform(-2.0, 2.0, (400, 15))
    boxes[:, 3:6] = rng.uniform(0.02, 0.8, (400, 3))
    boxes = boxes[np.argsort(boxes[:, 0])]  # those of a batch near each other
    boxes[::7] = boxes[: BATCH // 2] = boxes[2 * BATCH : 3 * BATCH] = np.nan
    bounds = np.zeros((-(-400 // BATCH), 7))
    for batch in range(len(bounds)):
        bound(boxes, batch, bounds)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.linalg.qr(rng.normal(size=(3, 3)))[0], rng.uniform(-0.5, 0.5, 3)
    x, y, z = (boxes[:, :3] @ T[:3, :3].T + T[:3, 3]).T
    radius = np.linalg.norm(boxes[:, 3:6], axis=1) / 2
    with np.errstate(invalid="ignore"):
        expected = (z > NEAREST_M) & (z - radius < 1.5)
        for place, focal, center, size in zip((x, y), CAMERA[:2], CAMERA[2:], (40, 30), strict=True):
            expected &= (place + radius) / z * focal + center > 0
            expected &= (place - radius) / z * focal + center < size
    found = np.empty(400, np.int64)
    number = boxes_in_frustum(boxes, bounds, T, CAMERA, 40, 30, 1.5, found)
    assert found[:number].tolist() == np.flatnonzero(expected).tolist()
    assert 20 < number < 300
    bounds[:, :6] += 50.0
    assert boxes_in_frustum(boxes, bounds, T, CAMERA, 40, 30, 1.5, found) == 0, (
        "what is out of view is passed over at once"
    )
