"""How a frame's pixels are shared out, what bounds each share, and how voxels are voted for, done slowly."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cuboid.ground.core.tolerances import JUMP_SIGMAS
from cuboid.method.heatmap.kernels.claims import assign_pixels, proposal_overlaps, segment_overlaps, vote_owners
from cuboid.method.surfaces.kernels.outlines import (
    BORDER,
    BOTTOM,
    CONTACT,
    EDGE_LEVELS,
    END_FRACTION,
    FREE,
    HIDDEN,
    INNER_PIXELS,
    KINDS,
    LEFT,
    RIGHT,
    SUPPORT,
    TOP,
    UNSURE,
    Picture,
    outlines,
)

HEIGHT, WIDTH = 16, 24
SIDES = np.array([BOTTOM, TOP, RIGHT, LEFT])  # of a camera held upright: below, above, right, left
SEEDS = given(st.integers(0, 100_000))
FEW = settings(max_examples=25, deadline=None)


class Proposed:
    """Random proposals, and what each covers."""

    def __init__(self, rng: np.random.Generator, count: int) -> None:
        low = rng.integers(0, (WIDTH - 1, HEIGHT - 1), (count, 2))
        high = np.minimum(low + rng.integers(0, 20, (count, 2)), (WIDTH, HEIGHT))
        self.rectangles = np.concatenate([low, high], 1)
        self.masks = np.zeros((count, HEIGHT, WIDTH), bool)
        laid_out = []
        for mask, (x0, y0, x1, y1) in zip(self.masks, self.rectangles, strict=True):
            mask[y0:y1, x0:x1] = rng.random((y1 - y0, x1 - x0)) < 0.6
            laid_out.append(mask[y0:y1, x0:x1].ravel())
        self.starts = np.cumsum([0, *(len(m) for m in laid_out)])
        self.covered = np.concatenate(laid_out).astype(np.uint8)

    def arguments(self) -> tuple[object, ...]:
        return self.rectangles, self.starts, self.covered


@FEW
@SEEDS
def test_pixels_are_counted_by_proposal_and_object(seed: int) -> None:
    rng = np.random.default_rng(seed)
    proposed = Proposed(rng, 6)
    owner = rng.choice([0, 3, 5, 6], (HEIGHT, WIDTH)).astype(np.int32)
    place = np.array([2, 2, 2, 1, 2, 0, 2])  # 3 and 5 are in view, 6 is not
    table, object_pixels, column = np.full((6, 3), -7), np.full(3, -7), np.empty(owner.shape, np.int32)
    proposal_overlaps(owner, place, *proposed.arguments(), column, table, object_pixels)
    others = ~np.isin(owner, [3, 5])
    for k, mine in enumerate(proposed.masks):
        assert table[k].tolist() == [(mine & own).sum() for own in (owner == 5, owner == 3, others)]
    assert object_pixels.tolist() == [(owner == 5).sum(), (owner == 3).sum(), others.sum()]


@FEW
@SEEDS
def test_each_pixel_goes_to_the_strongest_proposal_that_is_mostly_free(seed: int) -> None:
    rng = np.random.default_rng(seed)
    proposed = Proposed(rng, 8)
    order = rng.permutation(8)[:6]
    claim = np.full((HEIGHT, WIDTH), 9, np.int32)
    assign_pixels(order, *proposed.arguments(), 10, 0.6, claim)
    expected = np.full((HEIGHT, WIDTH), -1)
    for i, k in enumerate(order):
        mine = proposed.masks[k]
        free = mine & (expected < 0)
        if free.sum() >= 10 and free.sum() >= 0.6 * mine.sum():
            expected[free] = i
    np.testing.assert_array_equal(claim, expected)


JUMP_M, NOISE, FOCAL, GAP_M = 0.01, 1e-3, 40.0, 0.08


def outlines_of(
    depth: np.ndarray,
    claim: np.ndarray,
    on_plane: np.ndarray,
    plane_of: list[int],
    sides: np.ndarray = SIDES,
    color: np.ndarray | None = None,
    readings: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    count = len(plane_of)
    corners = np.zeros((count, 4), np.int64)
    for k in range(count):
        v, u = np.nonzero(claim == k)
        if len(v):
            corners[k] = u.min(), v.min(), u.max(), v.max()
    outline, contact = np.empty((count, 4, KINDS), np.int64), np.empty((count, count), np.int64)
    picture = Picture(
        depth.astype(np.float32),
        (depth if readings is None else readings).astype(np.float32),
        np.zeros((*depth.shape, 3), np.uint8) if color is None else color,
        claim.astype(np.int32),
        on_plane.astype(np.int32),
    )
    outlines(picture, corners, np.array(plane_of), sides, FOCAL, NOISE, JUMP_M, GAP_M, outline, contact)
    return outline, contact


def slow_outlines(
    depth: np.ndarray,
    readings: np.ndarray,
    color: np.ndarray,
    claim: np.ndarray,
    on_plane: np.ndarray,
    plane_of: list[int],
) -> tuple[np.ndarray, np.ndarray]:
    """The same, ray by ray along whole rows and columns; of a camera held upright."""
    count = len(plane_of)
    outline, contact = np.zeros((count, 4, KINDS), int), np.zeros((count, count), int)
    steps = {BOTTOM: (1, 0), TOP: (-1, 0), RIGHT: (0, 1), LEFT: (0, -1)}
    for v, u in np.argwhere(claim >= 0):
        a, z = int(claim[v, u]), np.float32(depth[v, u])
        rows = np.nonzero((claim == a).any(1))[0]
        for side, (dv, du) in steps.items():
            reach = max(2, int(GAP_M * FOCAL / z))
            ray = [(v + n * dv, u + n * du) for n in range(1, reach + 1)]
            inside = [(y, x) for y, x in ray if 0 <= y < depth.shape[0] and 0 <= x < depth.shape[1]]
            if inside and claim[inside[0]] == a:
                continue
            end = {BOTTOM: rows.max() - v, TOP: v - rows.min()}.get(side, 0)
            if end > max(1, END_FRACTION * (rows.max() - rows.min())):
                continue  # neither its top nor its bottom
            back = [(v - n * dv, u - n * du) for n in range(reach)]
            mine = [0 <= y < depth.shape[0] and 0 <= x < depth.shape[1] and claim[y, x] == a for y, x in back]
            back = back[: mine.index(False)] if False in mine else back
            inwards = next((n for n, p in enumerate(back) if readings[p] > 0), reach)
            hit = next((p for p in inside if claim[p] == a or readings[p] > 0), None)
            if hit is not None and claim[hit] == a:
                continue
            passed = inside[: None if hit is None else inside.index(hit) + 1]
            within = (v - INNER_PIXELS * dv, u - INNER_PIXELS * du)
            there = 0 <= within[0] < depth.shape[0] and 0 <= within[1] < depth.shape[1] and claim[within] == a
            own = color[within if there else (v, u)].astype(int)
            edge = max((np.abs(color[p] - own).sum() for p in passed), default=0) >= EDGE_LEVELS
            if hit is None:
                if len(inside) == len(ray):
                    first = next((int(claim[p]) for p in inside if claim[p] >= 0), -1)
                    contact[a, first] += first >= 0
                outline[a, side, BORDER if len(inside) < len(ray) else FREE if edge else UNSURE] += 1
                continue
            b, beyond = int(claim[hit]), float(np.float32(readings[hit])) - float(z)
            limit = JUMP_M + JUMP_SIGMAS * NOISE * float(z) ** 2
            if b >= 0:
                contact[a, b] += 1
            if on_plane[hit] >= 0 and on_plane[hit] == plane_of[a]:
                kind = SUPPORT
            elif beyond > limit:
                kind = FREE if edge or inwards + ray.index(hit) + 1 <= reach else UNSURE
            elif beyond < -limit:
                kind = HIDDEN
            else:
                kind = UNSURE if b >= 0 else CONTACT
            outline[a, side, kind] += 1
    return outline, contact


def random_outlines(seed: int) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Outlines and contacts of a random picture: as found, and as they should be."""
    rng = np.random.default_rng(seed)
    readings = rng.choice([0.0, 0.9, 1.0, 1.003, 1.1], (HEIGHT, WIDTH), p=[0.3, 0.1, 0.3, 0.2, 0.1])
    depth = np.where((readings == 0) & (rng.random(readings.shape) < 0.3), 1.0, readings)
    blocks = rng.integers(-1, 4, (HEIGHT // 4, WIDTH // 4))
    claim = np.where(depth > 0, np.kron(blocks, np.ones((4, 4), int)), -1)
    on_plane = np.where(claim < 0, rng.integers(-1, 2, claim.shape), -1)
    plane_of = [0, 1, -1, 0]
    color = rng.choice([0, 20, 50], (HEIGHT, WIDTH, 3)).astype(np.uint8)
    found = outlines_of(depth, claim, on_plane, plane_of, SIDES, color, readings)
    return found, slow_outlines(depth, readings, color, claim, on_plane, plane_of)


@FEW
@SEEDS
def test_outlines_are_those_of_rays_that_are_followed_one_by_one(seed: int) -> None:
    found, expected = random_outlines(seed)
    np.testing.assert_array_equal(found[0], expected[0])
    np.testing.assert_array_equal(found[1], expected[1])


def test_random_pictures_have_outlines_of_all_kinds() -> None:
    kinds = sum(random_outlines(seed)[0][0].sum((0, 1)) for seed in range(3))
    assert (kinds > 0).all()


def test_a_share_that_ends_in_a_filled_hole_ends_where_its_color_does() -> None:
    readings = np.full((9, 30), 2.0)
    readings[:, 5:20] = 1.0
    readings[:, 12:20] = 0.0  # its right half has no reading
    depth = np.where(readings == 0, 1.0, readings)
    claim = np.full(depth.shape, -1)
    claim[:, 5:20] = 0
    color = np.full((*depth.shape, 3), 100, np.uint8)
    plain = outlines_of(depth, claim, np.full(depth.shape, -1), [-1], SIDES, color, readings)[0]
    color[:, 5:20] = 30
    edged = outlines_of(depth, claim, np.full(depth.shape, -1), [-1], SIDES, color, readings)[0]
    assert plain[0, LEFT, FREE] == edged[0, LEFT, FREE] == 9, "where it has readings depth alone tells"
    assert plain[0, RIGHT, UNSURE] == edged[0, RIGHT, FREE] == 9, "the hole is wider than a shadow"
    readings[:, 12:18] = 1.0
    narrow = outlines_of(depth, claim, np.full(depth.shape, -1), [-1], SIDES, None, readings)[0]
    assert narrow[0, RIGHT, FREE] == 9


def scene() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A box of 6 x 6 pixels before a far wall, on a table: depth, shares, planes."""
    depth, claim, plane = np.full((12, 20), 2.0), np.full((12, 20), -1), np.full((12, 20), -1)
    depth[3:9, 7:13], claim[3:9, 7:13] = 1.0, 0
    depth[9:], plane[9:] = 1.0, 5
    return depth, claim, plane


def test_what_stands_free_is_bounded_by_air_and_by_what_it_stands_on() -> None:
    depth, claim, plane = scene()
    outline, contact = outlines_of(depth, claim, plane, [5])
    assert outline[0, TOP].tolist() == outline[0, LEFT].tolist() == outline[0, RIGHT].tolist() == [6, 0, 0, 0, 0, 0]
    assert outline[0, BOTTOM].tolist() == [0, 6, 0, 0, 0, 0]
    assert contact.sum() == 0
    turned, _ = outlines_of(depth[::-1], claim[::-1], plane[::-1], [5], np.array([TOP, BOTTOM, LEFT, RIGHT]))
    np.testing.assert_array_equal(turned, outline)
    fallen, _ = outlines_of(depth.T, claim.T, plane.T, [5], np.array([RIGHT, LEFT, BOTTOM, TOP]))
    np.testing.assert_array_equal(fallen, outline)


def test_the_narrow_shadow_beside_a_thing_hides_nothing_and_a_wide_hole_may() -> None:
    depth, claim, plane = scene()
    depth[:9, 13:15] = 0.0  # 2 pixels, 5 cm at a metre: looked across
    assert outlines_of(depth, claim, plane, [5])[0][0, RIGHT, FREE] == 6
    depth[:9, 13:] = 0.0
    assert outlines_of(depth, claim, plane, [5])[0][0, RIGHT, UNSURE] == 6


def test_in_a_wide_hole_an_edge_of_color_ends_a_thing() -> None:
    depth, claim, plane = scene()
    depth[:9, 13:] = 0.0
    color = np.full((12, 20, 3), 90, np.uint8)
    color[:, 15:] = 90 + EDGE_LEVELS // 3 - 1
    assert outlines_of(depth, claim, plane, [5], SIDES, color)[0][0, RIGHT, UNSURE] == 6, "shading is no edge"
    color[:, 15:] += 1
    assert outlines_of(depth, claim, plane, [5], SIDES, color)[0][0, RIGHT, FREE] == 6
    color[:, 12:] = color[0, 19]  # the blur at the outline is of the other color already
    assert outlines_of(depth, claim, plane, [5], SIDES, color)[0][0, RIGHT, FREE] == 6
    depth[:9, 15:] = 1.003
    assert outlines_of(depth, claim, plane, [5], SIDES, color)[0][0, RIGHT, CONTACT] == 6, "where depth tells, it tells"


@FEW
@SEEDS
def test_what_shares_have_of_objects_is_counted(seed: int) -> None:
    rng = np.random.default_rng(seed)
    claim, owner = rng.integers(-1, 3, (2, HEIGHT, WIDTH)).astype(np.int32)
    owner = np.array([0, 2, 5], np.int32)[owner]
    known = rng.random(claim.shape) < 0.5
    table, size = np.empty((4, 2), np.int64), np.empty(4, np.int64)
    segment_overlaps(claim, owner, known, np.array([1, 1, 1, 1, 1, 0]), table, size)  # 5 is in view, 2 is not
    for row, fraction in enumerate((0, 1, 2, -1)):
        mine = claim == fraction
        assert table[row].tolist() == [(mine & (owner == 5)).sum(), (mine & (owner != 5)).sum()]
        assert size[row] == (mine & known).sum()


def test_walls_neighbours_and_what_stands_before_are_told_apart() -> None:
    depth, claim, plane = scene()
    depth[3:9, 13:] = 1.003  # a wall goes on at the right
    depth[3:9, 4:7], claim[3:9, 4:7] = 1.003, 1  # another thing touches at the left
    depth[:3] = 0.7  # something nearer above
    outline, contact = outlines_of(depth, claim, plane, [5, 5])
    assert outline[0, RIGHT].tolist() == [0, 0, 0, 6, 0, 0]
    assert outline[0, LEFT].tolist() == [0, 0, 6, 0, 0, 0]
    assert outline[0, TOP].tolist() == [0, 0, 0, 0, 6, 0]
    assert contact.tolist() == [[0, 6], [6, 0]]
    cut, _ = outlines_of(depth[:, :13], claim[:, :13], plane[:, :13], [5, 5])
    assert cut[0, RIGHT].tolist() == [0, 0, 0, 0, 0, 6], "what the picture's border cuts goes on, or not"


def test_a_slanted_side_is_neither_top_nor_bottom() -> None:
    depth, claim, plane = scene()
    for k in range(6):  # a stair of 1 pixel a row
        depth[3 + k, 7 : 12 - k], claim[3 + k, 7 : 12 - k] = 2.0, -1
    outline, _ = outlines_of(depth, claim, plane, [5])
    assert outline[0, TOP].sum() == 2, "the end, and one pixel of noise"
    assert outline[0, LEFT, FREE] == outline[0, RIGHT, FREE] == 6


MAX_CONFIDENCE = 8


def slow_vote(
    held: dict[int, tuple[int, int]],
    claim: np.ndarray,
    slots: np.ndarray,
    speaks: dict[int, int],
    candidate: np.ndarray,
    may: dict[tuple[int, int], bool],
    hits: np.ndarray,
) -> dict[int, tuple[int, int]]:
    """Each voxel hears the first pixel that has something to say: for an object, or, on a plane, for no one."""
    after = dict(held)
    done = set()
    for row, fraction, off_plane in zip(slots.ravel(), claim.ravel(), candidate.ravel(), strict=True):
        if row < 0 or row in done or (fraction < 0 and off_plane) or (fraction >= 0 and speaks[fraction] == 0):
            continue
        number = speaks[fraction] if fraction >= 0 else 0
        owner, votes = held[row]
        if fraction >= 0 and owner != number and hits[row] > 1 and not may[fraction, owner]:
            continue
        done.add(row)
        if owner == number:
            after[row] = (owner, min(MAX_CONFIDENCE, votes + 1) if number else votes)
        elif votes > 1:
            after[row] = (owner, votes - 1)
        else:
            after[row] = (number, 1 if number else 0)
    return after


@FEW
@SEEDS
def test_voxels_are_voted_for_as_boyer_and_moore_do(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count = 60
    owner = rng.choice([0, 1, 2, 4], count).astype(np.int32)
    confidence = np.where(owner > 0, rng.integers(1, MAX_CONFIDENCE + 1, count), 0).astype(np.uint8)
    place = np.array([0, 1, 2, -1, -1])  # 4 is not in view
    voted = np.zeros(count, np.uint8)
    for _ in range(6):
        claim = rng.integers(-1, 3, (8, 12)).astype(np.int32)
        slots = rng.integers(-1, count, (8, 12)).astype(np.int32)
        candidate = ((rng.random((8, 12)) < 0.8) | (claim >= 0)).astype(np.uint8)
        number_of = np.array([1, 2, 0], np.int32)
        allowed = rng.integers(0, 2, (3, 3)).astype(np.uint8)
        hits = rng.integers(1, 4, count).astype(np.int32)
        may = {(i, o): bool(place[o] >= 0 and allowed[i, place[o]]) for i in range(3) for o in (0, 1, 2, 4)}
        held = {k: (int(owner[k]), int(confidence[k])) for k in range(count)}
        expected = slow_vote(held, claim, slots, dict(enumerate(number_of.tolist())), candidate, may, hits)
        pairs = vote_owners(
            claim, number_of, place, allowed, candidate, slots, hits, MAX_CONFIDENCE, owner, confidence, voted
        )
        # What has a new owner is told of; all of these rows lie in block 0.
        won = {int(owner[k]) for k in range(count) if owner[k] and owner[k] != held[k][0]}
        assert won <= set((pairs >> 32).tolist()) <= {1, 2, 4}
        assert not (pairs & 0xFFFFFFFF).any()
        assert {k: (int(owner[k]), int(confidence[k])) for k in range(count)} == expected
        assert not voted.any()
        np.testing.assert_array_equal(owner > 0, confidence > 0)


def test_so_many_frames_as_there_are_votes_change_an_owner() -> None:
    slots, claim, yes = np.zeros((1, 1), np.int32), np.zeros((1, 1), np.int32), np.ones((1, 3), np.uint8)
    owner, confidence, voted = np.zeros(1, np.int32), np.zeros(1, np.uint8), np.zeros(1, np.uint8)
    place, hits = np.array([0, 1, 2]), np.full(1, 9, np.int32)
    history = []
    for number in [1] * 12 + [2] * 10:
        votes = claim, np.array([number], np.int32), place, yes, np.ones((1, 1), np.uint8)
        vote_owners(*votes, slots, hits, MAX_CONFIDENCE, owner, confidence, voted)
        history.append((int(owner[0]), int(confidence[0])))
    assert history[11] == (1, MAX_CONFIDENCE)
    assert history[18] == (1, 1)
    assert history[19] == (2, 1)
    assert history[21] == (2, 3)
