"""Relations from the geometry of boxes and planes; each score is a probability, given the errors of the boxes.

Meaning of the relations of an object A to another object B, if all boxes are exact:

on
    A rests on B: its foot is at the height of B's top, and most of one footprint lies within the other.
in
    A stands inside B: most of its footprint lies within that of B, and its foot is below the top of B.
supports
    The inverse of on and of in.
beside
    Neither stands on or in the other, the gap between the footprints is at most `BESIDE_M`, and most of the height
    range of the lower object is common to both.
under
    Most of A's footprint lies below B, and the centre of A is below the foot of B. The same holds for a plane as B.
against
    A side of A is at most `AGAINST_M` from a wall.

An object stands on one level: the planes, and the tops and insides of other objects beneath it, compete as its support.
The likelihood of a support is that of the height of the object's foot, times the probability that the support lies
beneath the object; a plane below another object does not support an object above that object. The score is the
posterior probability among all supports and the case that the box has a wrong foot. Supports at the same height do not
compete.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.results import RELATIONS, Relation, SupportPlane, TrackedObject, Wall
from cuboid.ground.core.values import RelationKind
from cuboid.ground.geometry.polygons import lie_inside
from cuboid.method.relations.footprints import Footprints, IntArray
from cuboid.method.relations.walls import depths_of_contact

# Standard deviations, metres, of the height of a foot above its support, and of the position of a side of a box. On
# made recordings with a known up direction, 95 % of feet have errors of at most 9 mm, and 95 % of half sides at most
# 11 mm (benchmarks/relations.py, seeds 1, 2, 21, 22), as with a standard deviation of 5 mm; the errors of the other
# 5 % are larger than those of a normal distribution.
HEIGHT_SIGMA_M, SIDE_SIGMA_M = 0.008, 0.008
# Standard deviation of the edge of a plane's seen part, metres: the parts under and behind objects are missing.
PLANE_EDGE_SIGMA_M = 0.05
# Largest gap, metres, between objects beside each other, and between an object and a wall that it is against.
BESIDE_M, AGAINST_M = 0.20, 0.05
# Two boxes are on, in or under each other if more than this fraction of a footprint is common to both, and beside each
# other if more than this fraction of the heights of the lower one is common to both.
MIN_COMMON_FRACTION = 0.5
# Only relations with at least this probability are kept; the others hold less likely than not.
MIN_PROBABILITY = 0.5
# Density of the height of a wrong foot, per metre: one box in fifty has its foot anywhere within half a metre.
WRONG_FOOT_PER_M = 0.02 / 0.5
# Fraction of the objects within a container that stand on its floor, and thickness of the floor, metres. The others lie
# on these objects, at any height up to the rim.
ON_FLOOR, FLOOR_THICKNESS_M = 0.7, 0.01
# An object in another one is rarer than an object on a surface by this factor.
RARER = 10.0


@dataclass(frozen=True, slots=True)
class _Support:
    """A possible support of an object: its name and kind, the height of its top, and its unnormalised likelihood."""

    to: int | str
    kind: RelationKind
    level_m: float
    likelihood: float


def find_relations(
    objects: Sequence[TrackedObject],
    planes: Sequence[SupportPlane],
    up: Float64Array | None,
    walls: Sequence[Wall] = (),
) -> dict[int, tuple[Relation, ...]]:
    """Return the relations of objects that hold more likely than not.

    Parameters
    ----------
    objects : sequence of TrackedObject
    planes : sequence of SupportPlane
        The supporting planes of the same map.
    up : (3,) float64 or None
        Up in the world; None if it is unknown, and then there are no relations.
    walls : sequence of Wall
        From `find_walls`.

    Returns
    -------
    dict of int to tuple of Relation
        Relations of each object by label, the most likely first within a kind; empty for objects without relations.
    """
    found: dict[int, list[Relation]] = {item.label: [] for item in objects}
    if up is not None and len(objects):
        place = _Place(objects, planes, up)
        place.add_supports(found)
        place.add_beside(found)
        place.add_under(found)
        _add_walls(found, objects, walls)
    return {label: _ordered(relations) for label, relations in found.items()}


class _Place:
    """Objects and planes with the data for all relations: the near pairs, and their relative positions."""

    def __init__(self, objects: Sequence[TrackedObject], planes: Sequence[SupportPlane], up: Float64Array) -> None:
        self.labels = [item.label for item in objects]
        self.feet = Footprints.of([item.box for item in objects], up)
        first, second = self.feet.neighbours(BESIDE_M + 3.0 * SIDE_SIGMA_M)
        self.one, self.other = np.concatenate([first, second]), np.concatenate([second, first])
        narrow = self.feet.half.min(1) * 2.0
        sigma = np.sqrt(2.0) * SIDE_SIGMA_M / np.maximum(np.minimum(narrow[self.one], narrow[self.other]), SIDE_SIGMA_M)
        # Probability that most of the footprint of `one` lies within that of `other`, and the reverse.
        self.over = _normal_cdf((self.feet.common_fractions(self.one, self.other) - MIN_COMMON_FRACTION) / sigma)
        self.over_back = np.concatenate([self.over[len(first) :], self.over[: len(first)]])
        self.gap_m = self.feet.gaps_m(self.one, self.other)
        self.levels, self.within = _planes(planes, up, self.feet)
        self.rests: Float64Array = np.zeros(len(self.one))

    def add_supports(self, found: dict[int, list[Relation]]) -> None:
        """Add on, in and supports."""
        low, high = self.feet.low, self.feet.high
        rise = low[self.one] - low[self.other]
        middle = (low + high)[self.one] / 2.0
        higher = _normal_cdf((middle - low[self.other]) / (np.sqrt(2.0) * HEIGHT_SIGMA_M))
        on = _density(low[self.one] - high[self.other]) * np.maximum(self.over, self.over_back) * higher
        # If two boxes at the same level cover each other, the smaller one is in the larger one.
        area = self.feet.half.prod(1)
        lower = _normal_cdf((rise - HEIGHT_SIGMA_M) / (np.sqrt(2.0) * HEIGHT_SIGMA_M))
        higher = higher * np.maximum(lower, area[self.one] < area[self.other])
        inside = self._inside(rise) * self.over * higher / RARER
        covered = self.over * higher  # an object whose centre is below the other's foot is not above it
        rows = _rows_of(self.one, len(self.labels))
        for a, label in enumerate(self.labels):
            pairs = rows[a]
            supports = self._supports(a, pairs, on, inside, covered)
            scores = _posterior(supports)
            for one, score in zip(supports, scores, strict=True):
                if score >= MIN_PROBABILITY:
                    found[label].append(Relation(one.to, one.kind, score))
                    if isinstance(one.to, int):
                        found[one.to].append(Relation(label, "supports", score))
            by_label: dict[int | str, float] = defaultdict(float)
            for one, score in zip(supports, scores, strict=True):
                by_label[one.to] += score
            self.rests[pairs] = [by_label[self.labels[b]] for b in self.other[pairs].tolist()]

    def _inside(self, rise: Float64Array) -> Float64Array:
        """Return the density, per metre, of the height of objects above the foot of their container, (P,)."""
        tall = np.maximum(self.feet.high - self.feet.low, FLOOR_THICKNESS_M)[self.other]
        sigma = np.hypot(HEIGHT_SIGMA_M, FLOOR_THICKNESS_M)
        below_rim = _normal_cdf((tall - rise) / HEIGHT_SIGMA_M)
        return np.asarray((ON_FLOOR * _density(rise - FLOOR_THICKNESS_M, sigma) + (1.0 - ON_FLOOR) / tall) * below_rim)

    def _supports(
        self, a: int, pairs: IntArray, on: Float64Array, inside: Float64Array, covered: Float64Array
    ) -> list[_Support]:
        """Return the possible supports of an object; `pairs` are the pairs with it as the first object."""
        low, high = self.feet.low, self.feet.high
        others = self.other[pairs]
        found = []
        for pair, b in zip(pairs.tolist(), others.tolist(), strict=True):
            hidden = self._hidden(float(high[b]), pairs[others != b], covered)
            found.append(_Support(self.labels[b], "on", float(high[b]), float(on[pair]) * hidden))
            found.append(_Support(self.labels[b], "in", float(low[b]), float(inside[pair])))
        for k in range(len(self.levels)):
            level = float(self.levels[k, a])
            height = float(_density(np.array(low[a] - level)))
            beneath = float(self.within[k, a]) * self._hidden(level, pairs, covered)
            found.append(_Support(f"plane:{k}", "on", level, height * beneath))
        return [one for one in found if one.likelihood > 0.0]

    def _hidden(self, level_m: float, pairs: IntArray, covered: Float64Array) -> float:
        """Return the probability that no other object lies between a level and the object."""
        higher = _normal_cdf((self.feet.high[self.other[pairs]] - level_m - HEIGHT_SIGMA_M) / HEIGHT_SIGMA_M)
        return float(np.prod(1.0 - covered[pairs] * higher))

    def add_beside(self, found: dict[int, list[Relation]]) -> None:
        """Add beside."""
        half = len(self.one) // 2
        one, other = self.one[:half], self.other[:half]
        low, high = self.feet.low, self.feet.high
        common = np.minimum(high[one], high[other]) - np.maximum(low[one], low[other])
        lower = np.minimum(high[one] - low[one], high[other] - low[other])
        score = _normal_cdf((BESIDE_M - self.gap_m[:half]) / (np.sqrt(2.0) * SIDE_SIGMA_M))
        score = score * _normal_cdf((common - MIN_COMMON_FRACTION * lower) / HEIGHT_SIGMA_M)
        score = score * (1.0 - np.minimum(self.rests[:half] + self.rests[half:], 1.0))
        score = score * (1.0 - np.maximum(self.over[:half], self.over_back[:half]))
        for a, b, value in _likely(one, other, score):
            found[self.labels[a]].append(Relation(self.labels[b], "beside", value))
            found[self.labels[b]].append(Relation(self.labels[a], "beside", value))

    def add_under(self, found: dict[int, list[Relation]]) -> None:
        """Add under."""
        low, high = self.feet.low, self.feet.high
        middle = (low + high) / 2.0
        score = self.over * _normal_cdf((low[self.other] - middle[self.one]) / (np.sqrt(2.0) * HEIGHT_SIGMA_M))
        for a, b, value in _likely(self.one, self.other, score):
            found[self.labels[a]].append(Relation(self.labels[b], "under", value))
        below = self.within * _normal_cdf((self.levels - middle) / HEIGHT_SIGMA_M)
        planes, which = np.nonzero(below >= MIN_PROBABILITY)
        for k, a in zip(planes.tolist(), which.tolist(), strict=True):
            found[self.labels[a]].append(Relation(f"plane:{k}", "under", float(below[k, a])))


def _planes(planes: Sequence[SupportPlane], up: Float64Array, feet: Footprints) -> tuple[Float64Array, Float64Array]:
    """Return the height of each plane at each object, and the probability that the plane extends there, (K, N)."""
    levels, within = np.zeros((len(planes), len(feet))), np.zeros((len(planes), len(feet)))
    for k, plane in enumerate(planes):
        slope = float(plane.normal @ up)
        across = feet.center @ (plane.normal @ feet.ground)
        levels[k] = -(plane.offset + across) / slope
        within[k] = _normal_cdf(_depths_inside_m(feet.center, plane.extent @ feet.ground) / PLANE_EDGE_SIGMA_M)
    return levels, within


def _add_walls(found: dict[int, list[Relation]], objects: Sequence[TrackedObject], walls: Sequence[Wall]) -> None:
    for k, wall in enumerate(walls):
        gap_m, within = depths_of_contact([item.box for item in objects], wall)
        score = _normal_cdf((AGAINST_M - gap_m) / SIDE_SIGMA_M) * _normal_cdf(within / PLANE_EDGE_SIGMA_M)
        for item, value in zip(objects, score.tolist(), strict=True):
            if value >= MIN_PROBABILITY:
                found[item.label].append(Relation(f"wall:{k}", "against", value))


def _posterior(supports: Sequence[_Support]) -> list[float]:
    """Return the probability of each support; supports at the same level do not compete."""
    order = sorted(range(len(supports)), key=lambda k: (supports[k].kind == "in", supports[k].level_m))
    total, scores, last = WRONG_FOOT_PER_M, [0.0] * len(supports), None
    for k in order:
        one = supports[k]
        if one.kind == "in" or last is None or one.level_m - last[0] > HEIGHT_SIGMA_M:
            last = (one.level_m, 0.0)
        total += max(0.0, one.likelihood - last[1])
        last = (last[0], max(last[1], one.likelihood))
    for k, one in enumerate(supports):
        scores[k] = one.likelihood / total
    return scores


def _density(off_m: Float64Array, sigma_m: float = HEIGHT_SIGMA_M) -> Float64Array:
    """Return the density of a normal distribution, per metre, at deviations."""
    return np.asarray(np.exp(-0.5 * (off_m / sigma_m) ** 2) / (sigma_m * np.sqrt(2.0 * np.pi)))


def _rows_of(one: IntArray, count: int) -> list[IntArray]:
    """Return for each of `count` objects the pairs with it as the first object."""
    order = np.argsort(one, kind="stable")
    return np.split(order, np.searchsorted(one[order], np.arange(1, count)))


def _likely(one: IntArray, other: IntArray, score: Float64Array) -> list[tuple[int, int, float]]:
    kept = score >= MIN_PROBABILITY
    return list(zip(one[kept].tolist(), other[kept].tolist(), score[kept].tolist(), strict=True))


def _ordered(relations: Sequence[Relation]) -> tuple[Relation, ...]:
    return tuple(sorted(relations, key=lambda one: (RELATIONS.index(one.kind), -one.score, str(one.to))))


def _depths_inside_m(points: Float64Array, outline: Float64Array) -> Float64Array:
    """Return the distance of points (N, 2) from the edge of a polygon (K, 2), metres: negative outside, (N,).

    If the polygon has fewer than three corners, all distances are -inf.
    """
    if len(outline) < 3:
        return np.full(len(points), -np.inf)
    side = np.roll(outline, -1, axis=0) - outline
    from_start = points[:, None] - outline
    along = np.einsum("nkj,kj->nk", from_start, side) / np.maximum((side**2).sum(1), 1e-18)
    nearest = np.linalg.norm(from_start - np.clip(along, 0.0, 1.0)[..., None] * side, axis=2).min(1)
    return np.asarray(np.where(lie_inside(points, outline), nearest, -nearest))


def _normal_cdf(value: Float64Array) -> Float64Array:
    """Return the probability that a standard normal variable is below each value, of any shape."""
    from scipy.special import ndtr

    return np.asarray(ndtr(value))
