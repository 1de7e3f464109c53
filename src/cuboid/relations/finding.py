"""Relations from the geometry of boxes and planes; each score is a probability, given the errors of the boxes.

What a relation means, with all boxes exact:

on
    It rests on it: its foot is where the other's top is, and most of one footprint lies within the other.
in
    It stands inside it: most of its footprint lies within the other's, and its foot is below the other's top.
supports
    The inverse of on and of in.
beside
    Neither stands on or in the other, the gap between the footprints is at most `BESIDE_M`, and the lower one's range
    of heights is mostly the other's too.
under
    Most of its footprint lies below the other, and its middle is below the other's foot; or below a plane.
against
    A side of it is no farther than `AGAINST_M` from a wall.

An object stands on one level: the planes and the tops and insides of other objects beneath it compete. Each has the
likelihood of the height of the object's foot, times the probability that it lies beneath; a plane below another object
does not support what stands over that object. The score is the posterior probability among all of them and the
possibility that the foot is not where the box says. Objects at the same height support together.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from cuboid.core.frame import Float64Array
from cuboid.core.results import RELATIONS, Relation, SupportPlane, TrackedObject, Wall
from cuboid.core.values import RelationKind
from cuboid.relations.footprints import Footprints, IntArray
from cuboid.relations.outlines import depths_inside_m
from cuboid.relations.walls import depths_of_contact

# Standard deviations of the height of a foot against what it stands on, and of the side of a box, metres. On made
# recordings with a known up 95 of 100 feet err by no more than 9 mm, halves of sides by no more than 11 mm
# (benchmarks/relations.py, seeds 1, 2, 21, 22), as with 5 mm; the rest errs by more than a normal distribution has.
HEIGHT_SIGMA_M, SIDE_SIGMA_M = 0.008, 0.008
# Standard deviation of the edge of what was seen of a plane, metres: the part under objects and behind them is missing.
EDGE_SIGMA_M = 0.05
# Greatest gap between things that are beside each other, and between a thing and the wall that it is against, metres.
BESIDE_M, AGAINST_M = 0.10, 0.05
# Most of something.
MOST = 0.5
# Relations below this are not kept: none holds more likely than not, and all of the others would be listed for nothing.
MIN_SCORE = 0.5
# Density of the height of a foot, per metre, where it is not at what supports it: one box in fifty has its foot
# somewhere within half a metre.
ASTRAY_PER_M = 0.02 / 0.5
# Of the things within a container, this fraction stands on its floor, which is this thick, metres; the others lie on
# them, anywhere up to its rim.
ON_FLOOR, FLOOR_M = 0.7, 0.01
# A thing in another one is this many times rarer than one on a surface.
RARER = 10.0


@dataclass(frozen=True, slots=True)
class _Support:
    """What may be beneath an object: its name and kind, the height of its top, and how likely it is, up to a factor."""

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
        Up in the world; None where it is unknown: there are no relations then.
    walls : sequence of Wall
        From `find_walls`.

    Returns
    -------
    dict of int to tuple of Relation
        By label, each object's own, the most likely first within a kind; also of objects without any.
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
    """Objects and planes with what every relation needs: which pairs are near, and how they lie to each other."""

    def __init__(self, objects: Sequence[TrackedObject], planes: Sequence[SupportPlane], up: Float64Array) -> None:
        self.labels = [item.label for item in objects]
        self.feet = Footprints.of([item.box for item in objects], up)
        first, second = self.feet.neighbours(BESIDE_M + 3.0 * SIDE_SIGMA_M)
        self.one, self.other = np.concatenate([first, second]), np.concatenate([second, first])
        narrow = self.feet.half.min(1) * 2.0
        sigma = np.sqrt(2.0) * SIDE_SIGMA_M / np.maximum(np.minimum(narrow[self.one], narrow[self.other]), SIDE_SIGMA_M)
        # Probability that most of the footprint of `one` lies within that of `other`, and the reverse.
        self.over = ndtr((self.feet.common_fractions(self.one, self.other) - MOST) / sigma)
        self.over_back = np.concatenate([self.over[len(first) :], self.over[: len(first)]])
        self.gap_m = self.feet.gaps_m(self.one, self.other)
        self.levels, self.within = _planes(planes, up, self.feet)
        self.rests: Float64Array = np.zeros(len(self.one))

    def add_supports(self, found: dict[int, list[Relation]]) -> None:
        """Add on, in and supports."""
        low, high = self.feet.low, self.feet.high
        rise = low[self.one] - low[self.other]
        middle = (low + high)[self.one] / 2.0
        higher = ndtr((middle - low[self.other]) / (np.sqrt(2.0) * HEIGHT_SIGMA_M))
        on = _density(low[self.one] - high[self.other]) * np.maximum(self.over, self.over_back) * higher
        # Of two boxes that stand on one level and cover each other, the smaller one is in the larger one.
        area = self.feet.half.prod(1)
        lower = ndtr((rise - HEIGHT_SIGMA_M) / (np.sqrt(2.0) * HEIGHT_SIGMA_M))
        higher = higher * np.maximum(lower, area[self.one] < area[self.other])
        inside = self._inside(rise) * self.over * higher / RARER
        covered = self.over * higher  # nothing lower than the other is beneath
        rows = _rows_of(self.one, len(self.labels))
        for a, label in enumerate(self.labels):
            pairs = rows[a]
            supports = self._supports(a, pairs, on, inside, covered)
            scores = _posterior(supports)
            for one, score in zip(supports, scores, strict=True):
                if score >= MIN_SCORE:
                    found[label].append(Relation(one.kind, one.to, score))
                    if isinstance(one.to, int):
                        found[one.to].append(Relation("supports", label, score))
            by_label: dict[int | str, float] = defaultdict(float)
            for one, score in zip(supports, scores, strict=True):
                by_label[one.to] += score
            self.rests[pairs] = [by_label[self.labels[b]] for b in self.other[pairs].tolist()]

    def _inside(self, rise: Float64Array) -> Float64Array:
        """Return the density, per metre, of the height of things over the foot of what they are in, (P,)."""
        tall = np.maximum(self.feet.high - self.feet.low, FLOOR_M)[self.other]
        sigma = np.hypot(HEIGHT_SIGMA_M, FLOOR_M)
        below_rim = ndtr((tall - rise) / HEIGHT_SIGMA_M)
        return np.asarray((ON_FLOOR * _density(rise - FLOOR_M, sigma) + (1.0 - ON_FLOOR) / tall) * below_rim)

    def _supports(
        self, a: int, pairs: IntArray, on: Float64Array, inside: Float64Array, covered: Float64Array
    ) -> list[_Support]:
        """Return what may be beneath an object; `pairs` are those in which it is the first."""
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
        """Return the probability that none of the others lies between a level and the object."""
        higher = ndtr((self.feet.high[self.other[pairs]] - level_m - HEIGHT_SIGMA_M) / HEIGHT_SIGMA_M)
        return float(np.prod(1.0 - covered[pairs] * higher))

    def add_beside(self, found: dict[int, list[Relation]]) -> None:
        """Add beside."""
        half = len(self.one) // 2
        one, other = self.one[:half], self.other[:half]
        low, high = self.feet.low, self.feet.high
        common = np.minimum(high[one], high[other]) - np.maximum(low[one], low[other])
        lower = np.minimum(high[one] - low[one], high[other] - low[other])
        score = ndtr((BESIDE_M - self.gap_m[:half]) / (np.sqrt(2.0) * SIDE_SIGMA_M))
        score = score * ndtr((common - MOST * lower) / HEIGHT_SIGMA_M)
        score = score * (1.0 - np.minimum(self.rests[:half] + self.rests[half:], 1.0))
        score = score * (1.0 - np.maximum(self.over[:half], self.over_back[:half]))
        for a, b, value in _likely(one, other, score):
            found[self.labels[a]].append(Relation("beside", self.labels[b], value))
            found[self.labels[b]].append(Relation("beside", self.labels[a], value))

    def add_under(self, found: dict[int, list[Relation]]) -> None:
        """Add under."""
        low, high = self.feet.low, self.feet.high
        middle = (low + high) / 2.0
        score = self.over * ndtr((low[self.other] - middle[self.one]) / (np.sqrt(2.0) * HEIGHT_SIGMA_M))
        for a, b, value in _likely(self.one, self.other, score):
            found[self.labels[a]].append(Relation("under", self.labels[b], value))
        below = self.within * ndtr((self.levels - middle) / HEIGHT_SIGMA_M)
        planes, which = np.nonzero(below >= MIN_SCORE)
        for k, a in zip(planes.tolist(), which.tolist(), strict=True):
            found[self.labels[a]].append(Relation("under", f"plane:{k}", float(below[k, a])))


def _planes(planes: Sequence[SupportPlane], up: Float64Array, feet: Footprints) -> tuple[Float64Array, Float64Array]:
    """Return the height of each plane at each object, and the probability that it is over or under it, (K, N)."""
    levels, within = np.zeros((len(planes), len(feet))), np.zeros((len(planes), len(feet)))
    for k, plane in enumerate(planes):
        slope = float(plane.normal @ up)
        across = feet.center @ (plane.normal @ feet.ground)
        levels[k] = -(plane.offset + across) / slope
        within[k] = ndtr(depths_inside_m(feet.center, plane.extent @ feet.ground) / EDGE_SIGMA_M)
    return levels, within


def _add_walls(found: dict[int, list[Relation]], objects: Sequence[TrackedObject], walls: Sequence[Wall]) -> None:
    for k, wall in enumerate(walls):
        gap_m, within = depths_of_contact([item.box for item in objects], wall)
        score = ndtr((AGAINST_M - gap_m) / SIDE_SIGMA_M) * ndtr(within / EDGE_SIGMA_M)
        for item, value in zip(objects, score.tolist(), strict=True):
            if value >= MIN_SCORE:
                found[item.label].append(Relation("against", f"wall:{k}", value))


def _posterior(supports: Sequence[_Support]) -> list[float]:
    """Return the probability of each support; those at one level do not compete."""
    order = sorted(range(len(supports)), key=lambda k: (supports[k].kind == "in", supports[k].level_m))
    total, scores, last = ASTRAY_PER_M, [0.0] * len(supports), None
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
    """Return the normal density, per metre, of deviations."""
    return np.asarray(np.exp(-0.5 * (off_m / sigma_m) ** 2) / (sigma_m * np.sqrt(2.0 * np.pi)))


def _rows_of(one: IntArray, count: int) -> list[IntArray]:
    """Return the pairs in which each of `count` objects is the first."""
    order = np.argsort(one, kind="stable")
    return np.split(order, np.searchsorted(one[order], np.arange(1, count)))


def _likely(one: IntArray, other: IntArray, score: Float64Array) -> list[tuple[int, int, float]]:
    kept = score >= MIN_SCORE
    return list(zip(one[kept].tolist(), other[kept].tolist(), score[kept].tolist(), strict=True))


def _ordered(relations: Sequence[Relation]) -> tuple[Relation, ...]:
    return tuple(sorted(relations, key=lambda one: (RELATIONS.index(one.kind), -one.score, str(one.to))))
