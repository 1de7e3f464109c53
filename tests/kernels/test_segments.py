from __future__ import annotations

import numpy as np
import pytest

from cuboid.ground.core.kernels import holes, patches, regions, segments
from cuboid.ground.core.kernels.cells import CELL_COLUMNS, fit_cells
from cuboid.ground.core.tolerances import JUMP_SIGMAS
from cuboid.method.proposals.kernels import unions

PINHOLE = np.array([265.0, 265.0, 79.5, 59.5])
SHAPE = (120, 160)
NOISE = 1e-3
SIZE = 8


def empty_borders(segments: int) -> regions.Borders:
    return regions.Borders(*np.empty((4, segments, segments), np.float32))


def ray(v: np.ndarray, u: np.ndarray) -> np.ndarray:
    return np.stack([(u - PINHOLE[2]) / PINHOLE[0], (v - PINHOLE[3]) / PINHOLE[1], np.ones(u.shape)], axis=-1)


def depth_of(*planes: tuple[tuple[float, float, float], float]) -> np.ndarray:
    """Depth of the nearest of planes n . p = d."""
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    layers = [d / (ray(v, u) @ np.array(n)) for n, d in planes]
    return np.minimum.reduce(layers).astype(np.float32)


def planes_of(depth: np.ndarray, least_area: float = 0.02) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    rows, columns = SHAPE[0] // SIZE, SHAPE[1] // SIZE
    cells = np.empty((rows * columns, CELL_COLUMNS))
    fit_cells(depth, PINHOLE, SIZE, 4.0, cells)
    planes, member = np.empty((6, 3)), np.empty((rows, columns), np.int16)
    count = patches.grow_planes(cells, (rows, columns), PINHOLE, NOISE, 0.004, 5e-3, least_area, planes, member)
    return cells, planes, member, count


def test_two_planes_that_meet_are_found_with_their_equations() -> None:
    # a floor-like plane and a wall behind it
    depth = depth_of(((0.0, 0.8, 0.6), 0.6), ((0.0, 0.0, 1.0), 1.1))
    _, planes, member, count = planes_of(depth)
    assert count == 2
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    # cells across the crease belong to either, and pull a little
    fits = [np.abs(p[0] * u + p[1] * v + p[2] - 1.0 / depth) < NOISE for p in planes[:2]]
    assert (fits[0] | fits[1]).mean() > 0.97
    assert 0.2 < fits[0].mean() < 0.8
    assert (member >= 0).mean() > 0.85


def test_pixels_off_the_planes_are_surface_those_beyond_are_far() -> None:
    depth = depth_of(((0.0, 0.6, 0.8), 0.8))
    truth = np.full(SHAPE, segments.PLANE)
    depth[50:80, 60:90] -= 0.06
    truth[50:80, 60:90] = segments.SURFACE
    depth[:8, :8], truth[:8, :8] = 0.0, segments.NONE
    depth[:8, 8:16], truth[:8, 8:16] = 5.0, segments.FAR
    cells, planes, member, count = planes_of(depth, 0.1)
    inverse, kind, on = np.empty(SHAPE, np.float32), np.empty(SHAPE, np.uint8), np.empty(SHAPE, np.int8)
    grown = patches.Grown(cells, planes, count, member)
    patches.classify(depth, grown, PINHOLE, SIZE, 4, NOISE, 0.005, 0.002, 4.0, inverse, kind, on)
    assert (kind == truth).all()
    assert (on == np.where(truth == segments.PLANE, 0, -1)).all()
    np.testing.assert_allclose(inverse[depth > 0], 1.0 / depth[depth > 0], rtol=1e-6)


def marks_of(depth: np.ndarray) -> np.ndarray:
    inverse = np.where(depth > 0, 1.0 / np.maximum(depth, 1e-6), 0.0).astype(np.float32)
    kind = np.where(depth > 0, segments.SURFACE, segments.NONE).astype(np.uint8)
    marks, smooth = np.empty(SHAPE, np.uint8), np.empty(SHAPE, np.float32)
    segments.mark(inverse, kind, PINHOLE[0], NOISE, 0.012, 0.015, 0.4, 0.8, smooth, marks)
    return marks


def roof(sign: float) -> np.ndarray:
    """Two planes at 90 degrees that meet in the column 80, the crease towards (-1) or away from the camera (1)."""
    x = (np.arange(SHAPE[1]) - 80.0) / PINHOLE[0]
    z = 1.0 / (1.0 + sign * np.abs(x))
    return np.tile(z.astype(np.float32), (SHAPE[0], 1))


def test_a_concave_crease_is_marked_where_it_is_and_a_convex_one_is_not() -> None:
    concave = (marks_of(roof(1.0)) & segments.CREASE) > 0
    assert concave[10:-10, 80].all()
    assert not concave[:, :74].any()
    assert not concave[:, 87:].any()
    assert not (marks_of(roof(-1.0)) & segments.CREASE).any()


def valley(half_angle_deg: float) -> np.ndarray:
    """Two planes that meet in column 80, 1 m away; half of the angle between them is given."""
    x = (np.arange(SHAPE[1]) - 80.0) / PINHOLE[0]
    z = 1.0 / (1.0 + np.abs(x) / np.tan(np.radians(half_angle_deg)))
    return np.tile(z.astype(np.float32), (SHAPE[0], 1))


def test_a_groove_is_sharper_than_a_right_angle() -> None:
    for half_angle_deg, grooved in ((60.0, False), (50.0, False), (38.0, True), (30.0, True)):
        marks = marks_of(valley(half_angle_deg))
        groove = (marks & segments.GROOVE) > 0
        assert groove[10:-10, 80].all() == grooved, half_angle_deg
        assert groove.any() == grooved, half_angle_deg
        assert ((marks & segments.CREASE) > 0)[10:-10, 80].all(), "a groove is a crease"


def test_a_step_is_marked_on_its_pixel_and_a_slant_is_not() -> None:
    depth = depth_of(((0.0, 0.94, 0.34), 0.4))
    assert not (marks_of(depth) & (segments.RIGHT | segments.DOWN)).any()
    depth[:, 100:] += 0.05
    right = (marks_of(depth) & segments.RIGHT) > 0
    near = depth[:, 99] < 2.0  # farther, 5 cm are within four deviations
    assert right[near, 99].all()
    assert right.sum() == right[:, 99].sum()


def test_a_gap_of_two_pixels_in_a_crease_does_not_join_its_sides() -> None:
    kind = np.full(SHAPE, segments.SURFACE, np.uint8)
    marks = np.zeros(SHAPE, np.uint8)
    marks[:, 80] = segments.CREASE
    marks[60:62, 80] = 0
    labels, queue = np.empty(SHAPE, np.int16), np.empty(SHAPE[0] * SHAPE[1], np.int32)
    assert segments.label_surfaces(kind, marks, 10, 10, labels, queue) == 2
    assert (labels[:, :80] == 1).all()
    assert (labels[:, 81:] == 2).all()
    assert (labels > 0).all()


def test_small_patches_become_nothing() -> None:
    kind = np.zeros(SHAPE, np.uint8)
    kind[5:8, 5:8] = segments.SURFACE
    kind[20:30, 20:30] = segments.SURFACE
    labels, queue = np.empty(SHAPE, np.int16), np.empty(SHAPE[0] * SHAPE[1], np.int32)
    marks = np.zeros(SHAPE, np.uint8)
    assert segments.label_surfaces(kind, marks, 10, 10, labels, queue) == 1
    assert (labels[20:30, 20:30] == 1).all()
    assert (labels > 0).sum() == 100
    assert (kind[5:8, 5:8] == segments.NONE).all()


def fill(kind: np.ndarray, labels: np.ndarray, color: np.ndarray, reach_px: float) -> np.ndarray:
    inverse = np.where(kind != segments.NONE, 1.0, 0.0).astype(np.float32)
    labels = labels.copy()
    on = np.where(kind == segments.PLANE, 0, -1).astype(np.int8)
    holes.fill_holes(kind, on, color, 1, 12.0, reach_px / 100.0, 100.0, labels, inverse)
    return labels


def test_holes_of_one_color_go_to_what_is_nearest() -> None:
    rng = np.random.default_rng(3)
    kind = np.zeros((40, 50), np.uint8)
    labels = np.zeros((40, 50), np.int16)
    for k, (v, u) in enumerate(rng.integers(0, 40, (6, 2)), start=1):
        kind[v, u], labels[v, u] = segments.SURFACE, k
    found = fill(kind, labels, np.zeros((40, 50, 3), np.uint8), 1e3)
    v, u = np.mgrid[:40, :50]
    seeds = np.argwhere(labels > 0)
    down, across = np.abs(v[..., None] - seeds[:, 0]), np.abs(u[..., None] - seeds[:, 1])
    away = np.maximum(down, across) + 0.4 * np.minimum(down, across)  # a diagonal step is 1.4
    cost = np.stack([away[..., labels[tuple(seed)] == labels[tuple(seeds.T)]].min(-1) for seed in seeds], -1)
    chosen = np.array([labels[tuple(seed)] for seed in seeds])
    picked = np.take_along_axis(cost, np.argmax(found[..., None] == chosen, axis=-1)[..., None], -1)[..., 0]
    np.testing.assert_allclose(picked, cost.min(-1), atol=1e-4)


def test_a_hole_is_shared_out_along_the_edge_of_color_and_not_beyond_reach() -> None:
    kind = np.full((20, 40), segments.NONE, np.uint8)
    labels = np.zeros((20, 40), np.int16)
    kind[:, :5], labels[:, :5] = segments.SURFACE, 1
    kind[:, 35:] = segments.PLANE
    color = np.zeros((20, 40, 3), np.uint8)
    color[:, 28:] = 200
    found = fill(kind, labels, color, 40.0)
    assert (found[:, :28] == 1).all()
    assert (found[:, 28:] == regions.BACKGROUND - 1).all()
    near = fill(kind, labels, color, 10.0)
    assert (near[:, 15:25] == 0).all()


def nearest_by_hand(
    known: np.ndarray, inverse: np.ndarray, color: np.ndarray, edge: float, reach: float, focal: float
) -> np.ndarray:
    """What each hole learns from in one sweep there and one back, pixel by pixel: its source, -1 none."""
    height, width = known.shape
    cost = np.where(known, 0.0, np.inf)
    near, source = np.where(known, inverse, 0.0), np.where(known, np.arange(known.size).reshape(known.shape), -1)
    places = np.argwhere(~known).tolist()
    for ahead in (-1, 1):
        for v, u in places if ahead < 0 else places[::-1]:
            found = []
            for dv, du in ((0, ahead), (ahead, -1), (ahead, 0), (ahead, 1)):
                y, x = v + dv, u + du
                if 0 <= y < height and 0 <= x < width:
                    change = np.abs(color[v, u].astype(float) - color[y, x]).sum() / edge
                    total = cost[y, x] + (1.4 if dv and du else 1.0) + change
                    if total <= reach * focal * near[y, x]:
                        found.append((total, y, x))
            total, y, x = min(found, key=lambda f: f[0], default=(np.inf, v, u))
            if total < cost[v, u]:
                cost[v, u], near[v, u], source[v, u] = total, near[y, x], source[y, x]
    return source


def test_holes_are_filled_as_two_sweeps_by_hand_fill_them() -> None:
    rng = np.random.default_rng(5)
    for fraction, step in ((0.2, 1), (0.9, 2), (0.995, 1)):
        known = rng.random((30, 41)) >= fraction
        known[4:9] = False
        inverse = rng.uniform(0.3, 2.0, known.shape).astype(np.float32)
        # No two ways cost the same.
        color = rng.integers(0, 255, (30 * step, 41 * step, 3)).astype(np.uint8)
        at, source = holes.nearest(known, np.where(known, inverse, 0).astype(np.float32), color, step, 97.3, 0.2, 100.0)
        np.testing.assert_array_equal(at, np.flatnonzero(~known))
        truth = nearest_by_hand(known, inverse, color[::step, ::step], 97.3, 0.2, 100.0)
        assert (source == truth.ravel()[at]).mean() > 0.995


def test_segments_are_measured_as_numpy_counts_them() -> None:
    rng = np.random.default_rng(5)
    labels = np.repeat(np.repeat(rng.integers(1, 4, (6, 8)), 4, axis=0), 4, axis=1).astype(np.int16)
    inverse = np.array([0.0, 1.0, 0.7, 1.4])[labels].astype(np.float32)
    kind, marks = np.full(labels.shape, segments.SURFACE, np.uint8), np.zeros(labels.shape, np.uint8)
    table, borders = np.empty((4, regions.COLUMNS)), empty_borders(4)
    planes = np.empty((0, regions.COLUMNS))
    regions.measure(kind, labels, inverse, marks, NOISE, 0.012, 0.06, table, borders, planes)
    assert not borders.level.any(), "depth jumps between all of them"
    contact, weight = borders.contact, borders.weight
    framed = np.pad(labels, 1)
    pairs = np.vstack(
        [
            np.stack([framed[:, :-1], framed[:, 1:]], -1).reshape(-1, 2),
            np.stack([framed[:-1], framed[1:]], -1).reshape(-1, 2),
        ]
    )
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    for a in (1, 2, 3):
        rows, columns = np.nonzero(labels == a)
        row = table[a]
        assert row[regions.PIXELS] == row[regions.READINGS] == len(rows)
        assert row[regions.INVERSE] == pytest.approx(inverse[labels == a].sum(), rel=1e-5)
        assert (row[regions.LEFTMOST], row[regions.TOP]) == (columns.min(), rows.min())
        assert (row[regions.RIGHTMOST], row[regions.BOTTOM]) == (columns.max(), rows.max())
        assert row[regions.OUTLINE] == (pairs == a).any(1).sum()
        for b in (1, 2, 3):
            both = (pairs == a).any(1) & (pairs == b).any(1)
            assert contact[a, b] == (both.sum() if a != b else 0)
            if a != b and inverse[labels == a][0] > inverse[labels == b][0]:
                assert weight[a, b] > weight[b, a], "the outline belongs to the nearer"


def test_a_plane_is_measured_by_what_lies_along_its_outline() -> None:
    # plane 1 in front of far things on three sides, another plane going on from its lower side, a thing on it
    labels = np.full((20, 20), regions.BACKGROUND, np.int16)
    inverse = np.full((20, 20), 0.4, np.float32)
    labels[5:15, 5:15], inverse[5:15, 5:15] = regions.BACKGROUND - 2, 1.0
    labels[15:, :], inverse[15:, :] = regions.BACKGROUND - 1, 1.0
    labels[8:10, 8:10] = 1
    rows, table = np.empty((2, regions.COLUMNS)), np.empty((2, regions.COLUMNS))
    kind, marks = np.full(labels.shape, segments.PLANE, np.uint8), np.zeros(labels.shape, np.uint8)
    borders = empty_borders(2)
    regions.measure(kind, labels, inverse, marks, NOISE, 0.012, 0.06, table, borders, rows)
    lower, plane = rows
    assert plane[regions.PIXELS] == 96
    assert [plane[k] for k in (regions.LEFTMOST, regions.TOP, regions.RIGHTMOST, regions.BOTTOM)] == [5, 5, 14, 14]
    assert plane[regions.OUTLINE] == 40 + 8
    assert plane[regions.STRENGTH] == pytest.approx(30 * 1.0 + 10 * 0.6 + 8 * 0.2)
    assert lower[regions.PIXELS] == 100


def test_two_planes_that_touch_change_no_segment() -> None:
    labels = np.full((10, 10), regions.BACKGROUND - 1, np.int16)
    labels[:, 5:] = regions.BACKGROUND - 2
    labels[2:4, 2:4] = 1
    table, borders = np.empty((2, regions.COLUMNS)), empty_borders(2)
    kind, marks = np.full(labels.shape, segments.PLANE, np.uint8), np.zeros(labels.shape, np.uint8)
    inverse = np.ones(labels.shape, np.float32)
    planes = np.empty((2, regions.COLUMNS))
    regions.measure(kind, labels, inverse, marks, NOISE, 0.012, 0.06, table, borders, planes)
    assert table[1, regions.OUTLINE] == 8
    assert table[1, regions.STRENGTH] == 8
    assert not borders.contact.any()


def test_where_depth_does_not_jump_the_strength_of_a_border_is_known_apart() -> None:
    # 1 and 2 lie level, with a crease between them in the upper half, half of it a groove; 3 lies behind both
    labels = np.ones((8, 12), np.int16)
    labels[:, 4:8], labels[:, 8:] = 2, 3
    inverse = np.where(labels == 3, 0.7, 1.0).astype(np.float32)
    kind, marks = np.full(labels.shape, segments.SURFACE, np.uint8), np.zeros(labels.shape, np.uint8)
    marks[:4, 4] = segments.CREASE
    marks[:2, 4] |= segments.GROOVE
    marks[:, 8] = segments.CREASE | segments.GROOVE
    table, borders, planes = np.empty((4, regions.COLUMNS)), empty_borders(4), np.empty((0, regions.COLUMNS))
    regions.measure(kind, labels, inverse, marks, NOISE, 0.012, 0.06, table, borders, planes)
    weight, level, grooves = borders.weight, borders.level, borders.grooves
    assert level[1, 2] == level[2, 1] == pytest.approx(4 * 0.4 + 4 * 0.1)
    assert grooves[1, 2] == grooves[2, 1] == 2
    assert grooves.sum() == 4, "no groove where depth jumps"
    assert weight[1, 2] == level[1, 2]
    assert weight[2, 3] > 0
    assert level[2, 3] == level[3, 2] == 0


def test_mean_colors_are_those_that_numpy_finds() -> None:
    rng = np.random.default_rng(8)
    labels = rng.integers(-2, 4, (20, 30)).astype(np.int16)
    color = rng.integers(0, 256, (40, 60, 3)).astype(np.uint8)
    means = np.empty((6, 3))
    regions.mean_colors(labels, color, 2, means)
    for k in range(6):
        own = color[::2, ::2][labels == k] if k > 0 else np.zeros((0, 3))
        np.testing.assert_allclose(means[k], own.mean(0) if len(own) else 0.0)


def test_joining_takes_the_weakest_outline_first_and_keeps_every_union() -> None:
    # 1 and 2 share a weak outline, 2 and 3 a strong one; 4 is too large for any union
    table = np.zeros((5, regions.COLUMNS))
    for k, (left, right) in enumerate([(0, 9), (10, 19), (20, 29), (30, 500)], start=1):
        table[k, [regions.PIXELS, regions.READINGS, regions.INVERSE]] = 100.0
        table[k, [regions.LEFTMOST, regions.RIGHTMOST, regions.TOP, regions.BOTTOM]] = left, right, 0, 9
        table[k, [regions.OUTLINE, regions.STRENGTH]] = 40.0, 30.0
    borders = regions.Borders(*np.zeros((4, 5, 5), np.float32))
    for a, b, strength in ((1, 2, 0.2), (2, 3, 0.9), (3, 4, 0.1)):
        borders.contact[a, b] = borders.contact[b, a] = 10.0
        borders.weight[a, b] = borders.weight[b, a] = strength * 10.0
        borders.grooves[a, b] = borders.grooves[b, a] = 10.0 * (strength > 0.8)
    members, found = np.empty((10, 5), np.uint8), np.empty((10, regions.COLUMNS))
    parts = np.empty((10, 2), np.int32)
    n = unions.join(table, borders, 4, 100.0, 1.0, members, found, parts)
    assert members[:n, 1:].tolist() == [
        [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [1, 1, 0, 0], [1, 1, 1, 0]
    ]  # fmt: skip
    assert parts[:n].tolist() == [[-1, -1]] * 4 + [[0, 1], [4, 2]]
    union = found[5]
    assert union[regions.PIXELS] == 300
    assert union[regions.OUTLINE] == 40 * 3 - 4 * 10
    assert union[regions.STRENGTH] == pytest.approx(90 - 4 - 18)
    assert found[4:n, regions.GROOVES].tolist() == [0, 10], "2 and 3 meet in a groove"
    assert (union[regions.LEFTMOST], union[regions.RIGHTMOST]) == (0, 29)


def test_pairs_are_the_neighbours_that_joining_never_took_alone() -> None:
    # A row of four, the middle ones joined first: 1-2 and 3-4 are no unions of that tree. 4 is too far for a pair.
    table = np.zeros((5, regions.COLUMNS))
    for k in range(1, 5):
        table[k, [regions.PIXELS, regions.READINGS, regions.INVERSE]] = 100.0, 100.0, 100.0 if k < 4 else 40.0
        table[k, [regions.LEFTMOST, regions.RIGHTMOST, regions.BOTTOM]] = 10 * k, 10 * k + 9, 9
        table[k, [regions.OUTLINE, regions.STRENGTH]] = 40.0, 30.0
    borders = regions.Borders(*np.zeros((4, 5, 5), np.float32))
    for a, b, strength in ((1, 2, 0.5), (2, 3, 0.1), (3, 4, 0.9)):
        borders.contact[a, b] = borders.contact[b, a] = 10.0
        borders.weight[a, b] = borders.weight[b, a] = strength * 10.0
        borders.grooves[a, b] = borders.grooves[b, a] = 10.0 * (strength > 0.8)
    members, found = np.empty((20, 5), np.uint8), np.empty((20, regions.COLUMNS))
    parts = np.empty((20, 2), np.int32)
    joined = regions.Borders(*(matrix.copy() for matrix in borders))
    n = unions.join(table.copy(), joined, 4, 100.0, 1.0, members, found, parts)
    assert members[4:n, 1:].tolist() == [[0, 1, 1, 0], [1, 1, 1, 0]]
    m = unions.pair(table, borders, 4, 100.0, 1.0, n, members, found, parts)
    assert members[n:m, 1:].tolist() == [[1, 1, 0, 0]]
    assert parts[n].tolist() == [0, 1]
    assert found[n, regions.PIXELS] == 200
    assert found[n, regions.OUTLINE] == 40 * 2 - 2 * 10
    assert found[n, regions.STRENGTH] == pytest.approx(60 - 5 - 5)
    assert (found[n, regions.LEFTMOST], found[n, regions.RIGHTMOST]) == (10, 29)


def plain_jumps(inverse: np.ndarray, kind: np.ndarray, jump: float) -> tuple[np.ndarray, np.ndarray]:
    """Jumps and the mean over like neighbours, pixel by pixel; outside the picture nothing is read."""
    height, width = inverse.shape
    marks, smooth = np.zeros(inverse.shape, np.uint8), np.zeros(inverse.shape)

    def at(v: int, u: int) -> float:
        return float(inverse[v, u]) if 0 <= v < height and 0 <= u < width else 0.0

    for v, u in zip(*np.nonzero(inverse), strict=True):
        w = at(v, u)
        limit = jump * w * w + JUMP_SIGMAS * NOISE
        for bit, dv, du in ((segments.RIGHT, 0, 1), (segments.DOWN, 1, 0)):
            before, there, after = at(v - dv, u - du), at(v + dv, u + du), at(v + 2 * dv, u + 2 * du)
            goes_on = before > 0 and abs(2 * w - before - there) < limit and abs(w - before) < 2 * abs(w - there)
            goes_on |= after > 0 and abs(2 * there - after - w) < limit
            if there > 0 and abs(there - w) > limit and not goes_on:
                marks[v, u] |= bit
        around = [at(v + dv, u + du) for dv in (-1, 0, 1) for du in (-1, 0, 1)]
        if kind[v, u] == segments.SURFACE:
            smooth[v, u] = np.mean([x for x in around if x > 0 and abs(x - w) < limit])
    return marks, smooth


def test_jumps_and_smooth_surfaces_are_those_of_the_plain_loop() -> None:
    rng = np.random.default_rng(6)
    depth = rng.choice([0.0, 1.0, 1.01, 1.06, 1.2], (25, 33)) + 0.002 * np.arange(33)
    inverse = np.where(depth > 0.5, 1.0 / np.maximum(depth, 0.5), 0.0).astype(np.float32)
    kind = rng.choice([segments.PLANE, segments.SURFACE], inverse.shape).astype(np.uint8)
    kind[inverse == 0] = segments.NONE
    marks, smooth = np.empty(inverse.shape, np.uint8), np.empty(inverse.shape, np.float32)
    segments.mark_jumps(inverse, kind, NOISE, 0.012, smooth, marks)
    expected = plain_jumps(inverse, kind, 0.012)
    assert (np.bincount(expected[0].ravel())[1:] > 20).all()
    np.testing.assert_array_equal(marks, expected[0])
    np.testing.assert_allclose(smooth, expected[1], rtol=1e-6)


def test_masks_are_those_pixels_whose_segment_is_in() -> None:
    rng = np.random.default_rng(4)
    labels = rng.integers(-3, 5, (12, 20)).astype(np.int16)  # segments 0..4, none, and planes 0 and 1
    members = rng.integers(0, 2, (6, 7)).astype(np.uint8)
    chosen = np.array([4, 0, 5])
    boxes = np.array([[0, 0, 20, 12], [3, 2, 9, 7], [19, 11, 20, 12]], np.int32)
    sizes = (boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1])
    masks = np.full(sizes.sum(), 9, np.uint8)
    unions.cut_masks(labels, members, chosen, boxes, masks)
    ends = np.cumsum(sizes)
    for k, (x0, y0, x1, y1) in enumerate(boxes):
        # Label -1 is the entry behind all others, and plane p the one p + 1 before that.
        expected = np.append(members[chosen[k]], 0)[labels[y0:y1, x0:x1]]
        np.testing.assert_array_equal(masks[ends[k] - sizes[k] : ends[k]], expected.ravel())


def test_of_regions_that_are_nearly_the_same_the_best_one_is_kept() -> None:
    rng = np.random.default_rng(6)
    weight = rng.integers(1, 40, 12)
    members = (rng.random((60, 12)) < 0.5).astype(np.uint8)
    members[30:] = members[:30]
    members[np.arange(30, 60), rng.integers(0, 12, 30)] ^= 1
    pixels, order = members @ weight, rng.permutation(60)[:50]
    kept: list[int] = []
    for a in order:
        common = (members[kept] & members[a]) @ weight
        if not (common / np.maximum(pixels[kept] + pixels[a] - common, 1) >= 0.8).any():
            kept.append(int(a))
    assert len(kept) < 50, "some are the same"
    for most in (60, 10):
        chosen = np.empty(most, np.int64)
        number = unions.distinct(order, members, pixels, weight, 0.8, chosen)
        assert chosen[:number].tolist() == kept[:most]


def test_depth_is_filled_as_the_holes_of_surfaces_are() -> None:
    rng = np.random.default_rng(9)
    depth = rng.choice([0.0, 0.0, 0.8, 1.5], (30, 40)).astype(np.float32)
    depth[5:25, 10:30] = 0.0
    color = rng.integers(0, 40, (*depth.shape, 3)).astype(np.uint8)
    inverse = np.where(depth > 0, 1 / np.maximum(depth, np.float32(0.1)), 0).astype(np.float32)
    kind = np.where(depth > 0, segments.SURFACE, segments.NONE).astype(np.uint8)
    on, out = np.full(depth.shape, -1, np.int8), np.empty_like(depth)
    holes.fill_holes(kind, on, color, 1, 12.0, 0.05, 100.0, np.zeros(depth.shape, np.int16), inverse)
    holes.fill_depth(depth, color, 12.0, 0.05, 100.0, out)
    np.testing.assert_array_equal(out[depth > 0], depth[depth > 0])
    np.testing.assert_array_equal(out > 0, inverse > 0)
    np.testing.assert_allclose(out[out > 0], 1 / inverse[out > 0], rtol=1e-6)
    assert 0 < (out == 0).sum() < (depth == 0).sum()
