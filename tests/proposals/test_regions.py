"""Regions of color and depth: each loop against a readable computation, and the source on made pictures."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from two_colors import enlarged, picture

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.depth import DepthImage
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.method.proposals import make_source
from cuboid.method.proposals.forest import Forest, fitted_forest
from cuboid.method.proposals.kernels import choice, forest, hierarchy, leaves, quantities, sums
from cuboid.method.proposals.kernels.quantities import QUANTITIES
from cuboid.method.proposals.region_maps import Maps, ReducedFrame, empty_sums, graph_of, maps_of
from cuboid.method.proposals.regions import MIN_LOG_ODDS, RegionSource, RegionTree, room_to_merge

CAMERA = Intrinsics(90.0, 90.0, 31.5, 23.5, 64, 48)
PINHOLE = np.array(CAMERA.pinhole)
MAX_UNION = 0.9


@pytest.fixture(scope="module")
def maps() -> Maps:
    color, depth_m = picture()
    return maps_of(color, DepthImage(depth_m, CAMERA), 1)


@pytest.fixture(scope="module")
def tree(maps: Maps) -> tuple[hierarchy.Graph, RegionTree]:
    """The leaves of the picture, blocks of eight pixels, and a tree of them."""
    rows, columns = np.mgrid[:48, :64]
    labels = (rows // 8 * 8 + columns // 8).astype(np.int32)
    graph = graph_of(labels, 48, maps, PINHOLE)
    return graph, merged(graph, labels, hierarchy.BY_BOTH)


def merged(graph: hierarchy.Graph, labels: np.ndarray, order: int) -> RegionTree:
    n = len(graph.sums)
    made, work = room_to_merge(n, len(graph.ends))
    count = hierarchy.merge(graph, order, float(labels.size), MAX_UNION * labels.size, made, work)
    found, usable = np.zeros((count, len(QUANTITIES)), np.float32), np.empty(count, np.uint8)
    limits = 1.0, 1.0, float(labels.size)
    quantities.quantities(made, count, 0, PINHOLE, labels.shape, limits, found, usable)
    return RegionTree(labels, made, count, n, found, usable)


def test_changes_of_color_and_normals() -> None:
    rng = np.random.default_rng(1)
    across, down, normals = (rng.normal(size=(20, 30, 3)).astype(np.float32) / 3 for _ in range(3))
    gradient, bend = np.empty((20, 30), np.float32), np.empty((20, 30), np.float32)
    leaves.changes(across, down, normals, gradient, bend)
    assert np.array_equal(gradient, np.sqrt((across * across + down * down).sum(2)))
    vertical, horizontal = normals[2:, 1:-1] - normals[:-2, 1:-1], normals[1:-1, 2:] - normals[1:-1, :-2]
    expected = np.zeros((20, 30), np.float32)
    expected[1:-1, 1:-1] = np.minimum(np.sqrt((vertical**2).sum(2) + (horizontal**2).sum(2)), 1.0)
    assert np.array_equal(bend, expected)
    assert 0.0 < (bend == 1.0).mean() < 1.0


def members(region: RegionTree, i: int) -> set[int]:
    """The leaves of a region."""
    a, b = region.tree.parts[i]
    return {i} if a < 0 else members(region, a) | members(region, b)


def mask_of(region: RegionTree, i: int) -> np.ndarray:
    return np.isin(region.labels, list(members(region, i)))


def test_normals_of_a_plane() -> None:
    """The plane z = 1 + 0.2 x has the normal (0.2, 0, -1), normalised."""
    columns = (np.arange(64) - CAMERA.cx) / CAMERA.fx
    depth_m = np.tile(1.0 / (1.0 - 0.2 * columns), (48, 1)).astype(np.float32)
    normals = np.empty((48, 64, 3), np.float32)
    leaves.surface_normals(depth_m, *PINHOLE.tolist(), normals)
    expected = np.array([0.2, 0.0, -1.0]) / np.sqrt(1.04)
    np.testing.assert_allclose(normals, np.broadcast_to(expected, normals.shape), atol=1e-4)


def joined_plainly(right: np.ndarray, down: np.ndarray, tolerance: float, min_pixels: int) -> np.ndarray:
    """Leaves by sorted links and sets of pixels."""
    h, w = right.shape
    links = [(right[v, u], 2 * (v * w + u), v * w + u, v * w + u + 1) for v in range(h) for u in range(w - 1)]
    links += [(down[v, u], 2 * (v * w + u) + 1, v * w + u, v * w + u + w) for v in range(h - 1) for u in range(w)]
    group = {i: (frozenset([i]), tolerance) for i in range(h * w)}
    for small_ones in (False, True):
        for steps, _, i, j in sorted(links):
            (a, limit_a), (b, limit_b) = group[i], group[j]
            weight = steps / leaves.WEIGHT_STEPS
            joins = min(len(a), len(b)) < min_pixels if small_ones else weight <= min(limit_a, limit_b)
            if a != b and joins:
                union = a | b
                for k in union:
                    group[k] = (union, weight + tolerance / len(union))
    labels, numbers = np.empty(h * w, int), {}
    for i in range(h * w):
        labels[i] = numbers.setdefault(group[i][0], len(numbers))
    return labels.reshape(h, w)


@pytest.mark.parametrize("seed", range(4))
def test_leaves_as_by_sets(seed: int) -> None:
    random, shape = np.random.default_rng(seed), (7, 9)
    right, down = (random.integers(0, 120, shape).astype(np.int32) for _ in range(2))
    pixels = shape[0] * shape[1]
    work = [np.empty(n, kind) for n, kind in ((pixels, np.int32), (pixels, np.int32), (pixels, np.float32))]
    order, starts = np.empty(2 * pixels, np.int32), np.empty(leaves.MAX_WEIGHT + 2, np.int32)
    labels = np.empty(shape, np.int32)
    count = leaves.join_pixels(right, down, 6.0, 3, *work, order, starts, labels)
    expected = joined_plainly(right, down, 6.0, 3)
    np.testing.assert_array_equal(labels, expected)
    assert count == expected.max() + 1


def test_links_are_heavy_where_color_or_depth_changes(maps: Maps) -> None:
    weights = {}
    for name, color, depth in (("color", 1.0, 0.0), ("depth", 0.0, 1.0)):
        right, down = (np.zeros(maps.depth_m.shape, np.int32) for _ in range(2))
        leaves.link_weights(maps.lab, maps.depth_m, maps.normals, color, depth, right, down)
        weights[name] = right[14:30].astype(float)
    between_colors, at_the_side, inside = slice(28, 31), slice(14, 17), slice(19, 26)
    for name, border, other in (("color", between_colors, inside), ("depth", at_the_side, inside)):
        assert weights[name][:, border].max(1).min() > 5.0 * np.median(weights[name][:, other])
    assert weights["depth"][:, between_colors].mean() < 0.2 * weights["depth"][:, at_the_side].mean()


def test_sums_over_pixels(maps: Maps, tree: tuple[hierarchy.Graph, RegionTree]) -> None:
    graph, region = tree
    inside = region.labels == 13
    found = graph.sums[13]
    assert found[sums.PIXELS] == 64
    np.testing.assert_allclose(found[sums.COLOR : sums.COLOR + 3], maps.lab[inside].sum(0), rtol=1e-5)
    np.testing.assert_allclose(found[sums.COLOR2 : sums.COLOR2 + 3], (maps.lab[inside] ** 2).sum(0), rtol=1e-5)
    np.testing.assert_allclose(found[sums.NORMAL : sums.NORMAL + 3], maps.normals[inside].sum(0), rtol=1e-5)
    v, u = np.nonzero(inside & maps.read)
    z = maps.depth_m[v, u].astype(float)
    points = np.stack([(u - CAMERA.cx) / CAMERA.fx * z, (v - CAMERA.cy) / CAMERA.fy * z, z])
    np.testing.assert_allclose(found[sums.POINT_SUMS : sums.POINT_SUMS + 3], points.sum(1), rtol=1e-6)
    products = [points[a] @ points[b] for a, b in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    np.testing.assert_allclose(found[sums.POINT_SUMS + 3 : sums.POINT_SUMS + 9], products, rtol=1e-6)
    assert graph.boxes[13].tolist() == [40, 8, 48, 16]
    assert graph.sums[:, sums.CUT_OFF].sum() == 2 * (48 + 64) - 4


def test_a_union_has_the_sums_of_its_mask(maps: Maps, tree: tuple[hierarchy.Graph, RegionTree]) -> None:
    """Sums that were added up over the tree equal those over the pixels and the border of the region itself."""
    _, region = tree
    for i in range(region.leaves, region.count, 5):
        mask = mask_of(region, i)
        x0, y0, x1, y1 = region.tree.boxes[i]
        over, boxes = empty_sums(1, mask.shape)
        border = np.zeros((1, sums.LINK_SUMS))
        flat = mask[y0:y1, x0:x1].astype(np.uint8).ravel()
        rectangle = np.array([[x0, y0, x1, y1]], np.int64)
        sums.mask_sums(rectangle, np.zeros(1, np.int64), flat, maps, PINHOLE, over, border, boxes)
        np.testing.assert_allclose(over[0], region.tree.sums[i], rtol=1e-9, atol=1e-7)
        np.testing.assert_allclose(border[0], region.tree.borders[i], rtol=1e-9, atol=1e-7)
        assert boxes[0].tolist() == [x0, y0, x1, y1]


def test_the_border_of_a_box_before_a_wall(maps: Maps) -> None:
    """The surface of the box ends on all sides, the wall is hidden behind it."""
    labels = np.zeros((48, 64), np.int32)
    labels[10:34, 16:44] = 1
    graph = graph_of(labels, 2, maps, PINHOLE)
    wall, box = graph.borders[0]
    links = 2 * (24 + 28)
    assert wall[sums.LINKS] == box[sums.LINKS] == links
    assert box[sums.BY_SIDE : sums.BY_SIDE + 4].tolist() == [24, 24, 28, 28]
    assert box[sums.ENDS] > 0.95 * links
    assert wall[sums.HIDDEN] > 0.95 * links
    assert box[sums.EDGES] > 0.95 * links


@pytest.mark.parametrize("order", [hierarchy.BY_COLOR, hierarchy.BY_DEPTH, hierarchy.BY_BOTH, hierarchy.BY_SIZE])
def test_each_union_joins_the_least_dissimilar_neighbours(maps: Maps, order: int) -> None:
    rows, columns = np.mgrid[:48, :64]
    labels = (rows // 12 * 4 + columns // 16).astype(np.int32)
    graph = graph_of(labels, 16, maps, PINHOLE)
    region = merged(graph, labels, order)
    alive = set(range(16))
    for new in range(16, region.count):
        pairs = {}
        for a, b in combinations(sorted(alive), 2):
            between = [
                (k, s)
                for k, ends in enumerate(graph.ends.tolist())
                for s in range(2)
                if ends[s] in members(region, a) and ends[1 - s] in members(region, b)
            ]
            together = region.tree.sums[a, sums.PIXELS] + region.tree.sums[b, sums.PIXELS]
            if between and together <= MAX_UNION * labels.size:
                border = sum(graph.borders[k, s] for k, s in between)
                pairs[a, b] = hierarchy.dissimilarity(region.tree, a, b, border, order, float(labels.size))
        joined = tuple(sorted(region.tree.parts[new].tolist()))
        assert region.tree.joined[new] == pytest.approx(min(pairs.values()), rel=0.02)
        assert pairs[joined] == pytest.approx(min(pairs.values()), rel=0.02)
        alive = alive - set(joined) | {new}


def test_principal_axes_and_plane() -> None:
    random = np.random.default_rng(3)
    points = random.normal(size=(500, 3)) @ random.normal(size=(3, 3)) + [0.0, 0.0, 9.0]
    found = np.zeros(sums.PIXEL_SUMS)
    squares = [(points[:, a] * points[:, b]).sum() for a, b in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    found[sums.POINT_SUMS : sums.POINT_SUMS + 9] = [*points.sum(0), *squares]
    axes = np.empty(3)
    quantities.axes_of(found, 500.0, axes)
    np.testing.assert_allclose(axes, np.linalg.eigvalsh(np.cov(points.T, bias=True))[::-1], rtol=1e-6)
    a, b = random.uniform(-0.5, 0.5, (2, 500))
    q = 0.3 * a - 0.2 * b + 1.1 + random.normal(0.0, 0.01, 500)
    found[sums.RAYS : sums.RAYS + 9] = [q.sum(), a.sum(), b.sum(), q @ q, a @ a, b @ b, a @ b, a @ q, b @ q]
    plane = np.empty(3)
    residual = quantities.solve_plane(found, sums.RAYS, 500.0, plane)
    expected, squared, *_ = np.linalg.lstsq(np.column_stack([a, b, np.ones(500)]), q, rcond=None)
    np.testing.assert_allclose(plane, expected, atol=1e-6)
    assert residual == pytest.approx(squared[0] / 500.0, rel=1e-4)


def test_quantities_of_a_box_before_a_wall(maps: Maps) -> None:
    labels = np.zeros((48, 64), np.int32)
    labels[10:34, 16:44] = 1
    region = merged(graph_of(labels, 2, maps, PINHOLE), labels, hierarchy.BY_DEPTH)
    found = dict(zip(QUANTITIES, region.found[1].tolist(), strict=True))
    assert np.exp(found["width"]) == pytest.approx(28 * 0.88 / 90.0, rel=0.02)
    assert np.exp(found["height"]) == pytest.approx(24 * 0.88 / 90.0, rel=0.02)
    assert (found["fill"], found["cut_off"], found["readings"]) == (1.0, 0.0, 1.0)
    assert found["above"] == pytest.approx(0.12, abs=0.02)
    assert found["facing"] < -0.8  # towards the camera, but at its edges
    assert found["least_closed"] > 0.9


def test_surfaces_are_compared_by_their_pixels(tree: tuple[hierarchy.Graph, RegionTree]) -> None:
    _, region = tree
    mask = mask_of(region, region.count - 1)
    y, x = np.nonzero(mask)
    x0, y0, x1, y1 = x.min(), y.min(), x.max() + 1, y.max() + 1
    flat, rectangle = mask[y0:y1, x0:x1].astype(np.uint8).ravel(), np.array([[x0, y0, x1, y1]], np.int64)
    counts = np.zeros((region.count, 1), np.float32)
    quantities.count_leaves(rectangle, np.zeros(1, np.int64), flat, region.labels, counts)
    size = np.array([mask.sum()], np.float32)
    usable, score = np.ones(region.count, np.uint8), np.array([0.5], np.float32)
    found = region.found.copy()
    quantities.compare_surfaces(region.tree, region.count, region.leaves, size, score, usable, counts, found)
    for i in (3, region.leaves + 4, region.count - 1):
        other = mask_of(region, i)
        iou = (mask & other).sum() / (mask | other).sum()
        np.testing.assert_allclose(found[i, -2:], [iou, 0.5 * iou], rtol=1e-5)


def test_boosted_trees_as_by_recursion() -> None:
    model, random = fitted_forest(), np.random.default_rng(1)
    found = random.normal(0.0, 2.0, (40, len(QUANTITIES))).astype(np.float32)
    usable, out = np.ones(40, np.uint8), np.empty(40)
    usable[7] = 0
    given_up = np.array([-1.0, -0.5], np.float32)
    forest.log_odds(found, usable, model, given_up, out)

    def value(at: int, row: np.ndarray) -> float:
        column = model.quantity[at]
        if column < 0:
            return float(model.value[at])
        return value(model.smaller[at] if row[column] <= model.value[at] else model.larger[at], row)

    for i, row in enumerate(found):
        sums = model.base + np.cumsum([value(root, row) for root in model.roots])
        stages = sums[forest.STAGE - 1 :: forest.STAGE]
        expected = next((s for s, least in zip(stages, given_up, strict=False) if s < least), sums[-1])
        assert out[i] == pytest.approx(forest.LEFT_OUT_LOG_ODDS if i == 7 else expected, abs=1e-9)


def test_hardly_any_probable_region_is_given_up_early() -> None:
    model, (color, depth_m) = fitted_forest(), (enlarged(image, 5) for image in picture(4))
    camera, seen = Intrinsics(450.0, 450.0, 159.5, 119.5, 320, 240), Frame(0, 0.0, color, depth_m, None)
    trees, surfaces = RegionSource(TrackerConfig()).candidates(ReducedFrame(seen, camera))
    found = np.concatenate([each.found for each in (*trees, surfaces)])
    usable = np.concatenate([each.usable for each in (*trees, surfaces)])
    whole, early = np.empty(len(found)), np.empty(len(found))
    forest.log_odds(found, usable, model, np.zeros(0, np.float32), whole)
    forest.log_odds(found, usable, model, model.least, early)
    probable = whole >= MIN_LOG_ODDS
    assert probable.sum() > 10
    assert (early[probable] == whole[probable]).mean() > 0.98
    assert (early[~probable] < MIN_LOG_ODDS).all()


def best_by_enumeration(parts: np.ndarray, gains: np.ndarray) -> float:
    """The largest sum of gains of disjoint regions of a tree, over all sets of regions."""
    count = len(gains)
    under = [{i} if a < 0 else set() for i, (a, _) in enumerate(parts)]
    for i, (a, b) in enumerate(parts):
        if a >= 0:
            under[i] = under[a] | under[b]
    best = 0.0
    for chosen in range(1 << count):
        regions = [i for i in range(count) if chosen >> i & 1]
        if all(not under[a] & under[b] for a, b in combinations(regions, 2)):
            best = max(best, sum(gains[i] for i in regions))
    return best


@pytest.mark.parametrize("seed", range(5))
def test_the_choice_in_a_tree_is_the_best(seed: int) -> None:
    random = np.random.default_rng(seed)
    parts = np.full((9, 2), -1, np.int32)
    parts[5:] = [[0, 1], [5, 2], [3, 4], [6, 7]]
    gains, best, chosen = random.normal(0.3, 1.0, 9), np.empty(9), np.empty(9, np.uint8)
    total = choice.best_in_tree(parts, 9, gains, best, chosen)
    assert total == pytest.approx(best_by_enumeration(parts, gains))
    assert total == pytest.approx(gains[chosen > 0].sum())


@pytest.mark.parametrize("seed", range(5))
def test_exchanges_raise_the_sum_and_leave_no_conflict(seed: int) -> None:
    random, count = np.random.default_rng(seed), 12
    gains = np.sort(random.uniform(0.1, 3.0, count))[::-1].copy()
    conflict = np.triu(random.random((count, count)) < 0.3, 1)
    conflict = (conflict | conflict.T).astype(np.uint8)
    chosen = np.zeros(count, np.uint8)
    chosen[0] = 1
    choice.exchange(gains, conflict, 10, chosen)
    kept = np.flatnonzero(chosen)
    assert not conflict[np.ix_(kept, kept)].any()
    best = max(
        sum(gains[list(regions)])
        for n in range(1, count)
        for regions in combinations(range(count), n)
        if not conflict[np.ix_(regions, regions)].any()
    )
    assert gains[kept].sum() >= 0.9 * best


def test_masks_of_regions_and_their_conflicts(tree: tuple[hierarchy.Graph, RegionTree]) -> None:
    _, region = tree
    chosen = np.array([2, region.leaves + 3, region.count - 1])
    masks = region.masks(chosen)
    full = [mask_of(region, i) for i in chosen.tolist()]
    for k, (x0, y0, x1, y1) in enumerate(masks.rectangles.tolist()):
        flat = masks.flat[masks.starts[k] :][: (x1 - x0) * (y1 - y0)]
        np.testing.assert_array_equal(flat.reshape(y1 - y0, x1 - x0) > 0, full[k][y0:y1, x0:x1])
        assert masks.sizes[k] == full[k].sum()
    conflict = np.empty((3, 3), np.uint8)
    choice.overlaps(*masks, masks.sizes, 0.3, conflict)
    for a, b in combinations(range(3), 2):
        common = (full[a] & full[b]).sum()
        assert conflict[a, b] == conflict[b, a] == (common > 0.3 * min(full[a].sum(), full[b].sum()))


def test_the_source_gives_disjoint_masks_with_probabilities() -> None:
    color, depth_m = (enlarged(image, 5) for image in picture(2))
    frame, camera = Frame(0, 0.0, color, depth_m, None), Intrinsics(450.0, 450.0, 159.5, 119.5, 320, 240)
    source = make_source("regions", TrackerConfig())
    found, again = source(frame, camera), source(frame, camera)
    np.testing.assert_array_equal(found.boxes_xyxy, again.boxes_xyxy)
    np.testing.assert_array_equal(found.scores, again.scores)
    assert ((found.scores > 0.0) & (found.scores < 1.0)).all()
    covered = np.zeros((240, 320), int)
    for (x0, y0, x1, y1), mask in zip(found.boxes_xyxy.tolist(), found.masks or (), strict=True):
        covered[y0:y1, x0:x1] += mask
    assert covered.max() <= 1
    box = np.array([80, 50, 220, 170])
    best = max(
        (np.minimum(box[2:], b[2:]) - np.maximum(box[:2], b[:2])).clip(0).prod() / (140 * 120) for b in found.boxes_xyxy
    )
    assert best > 0.9


def test_a_picture_without_depth_gives_no_error() -> None:
    color, _ = picture()
    frame = Frame(0, 0.0, enlarged(color, 5), np.zeros((240, 320), np.float32), None)
    found = RegionSource(TrackerConfig())(frame, Intrinsics(450.0, 450.0, 159.5, 119.5, 320, 240))
    assert len(found.scores) == len(found.boxes_xyxy)


def test_a_forest_of_other_quantities_is_no_forest() -> None:
    model = fitted_forest()
    assert isinstance(model, Forest)
    assert model.quantity.max() < len(QUANTITIES)
