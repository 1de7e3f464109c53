"""Objectness: the probability that an object of the map is one whole thing of its own.

A logistic model of a few quantities, each with a meaning of its own (`Quantities`). Most are means or fractions over
the views of an object, so that the probability depends on where the camera was, not on how many frames it took there.
`benchmarks/fit_objectness.py` fits the coefficients in `objectness.json` over many places.
"""

from __future__ import annotations

import math
from functools import cache
from importlib import resources
from typing import NamedTuple

import msgspec
import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.method.objects.entry import MapObject
from cuboid.method.surfaces.kernels.outlines import FREE, HIDDEN, LEFT, RIGHT, SUPPORT, TOP, UNSURE

# An end of the outline that was hardly seen has the value of the prior: it counts as much as this fraction of the whole
# outline.
PRIOR_WEIGHT = 0.02
# Prior fraction of an end that is free, and of an end that was judged.
PRIOR_FREE, PRIOR_JUDGED = 0.5, 0.3
# The mean similarity of segments, and the fraction of matching frames, in one view that comes before all others: with
# few views the quantities are near these.
PRIOR_AGREEMENT, PRIOR_MATCHED = 0.9, 0.9
# Weight of a view whose segment has log-odds of 0, before all others.
PRIOR_SCORED = 0.5
# Largest thickness that makes a difference, in standard deviations of the noise of its points.
MAX_THICKNESS_SIGMAS = 30.0


class Quantities(NamedTuple):
    """The quantities from which the probability of an object follows.

    Attributes
    ----------
    agreement : float
        Mean similarity of its segments in the frames with it, 0..1: proposals of many views agree on its extent.
    matched : float
        Fraction of the frames with its points in which a segment matched it, 0..1.
    whole : float
        Mean log-odds that its segments show one whole thing, by the fitted score of regions in color and depth; near 0
        if few views were scored.
    unrepeated : float
        1 over the weight of its views: 1 if one view shows it, near 0 if many do.
    directions : float
        Logarithm of the number of directions from which it was seen.
    top_free, side_free : float
        Fraction of the judged top, and of the worse one of its left and right side, beyond which there is free space or
        its support, 0..1; a border at a hole counts half.
    top_judged, side_judged : float
        Fraction of the top, and of the less known side, that is neither hidden nor cut off by the image border, 0..1.
    continuing : float
        Number of its four sides, and its top, that continue into a surface outside all objects, at most 2.
    elongation : float
        Logarithm of the longest side over the middle one.
    filled : float
        Logarithm of the area of its points over the area of its box: a whole thing fills its box.
    thickness : float
        Logarithm of the shortest side in standard deviations of the noise of its points.
    pixels : float
        Logarithm of the working pixels of its largest segment.
    on_plane : float
        1 if a supporting plane is known beneath it, else 0.
    bears : float
        1 if it bears a supporting plane or covers other objects, as furniture does, else 0.
    """

    agreement: float
    matched: float
    whole: float
    unrepeated: float
    directions: float
    top_free: float
    side_free: float
    top_judged: float
    side_judged: float
    continuing: float
    elongation: float
    filled: float
    thickness: float
    pixels: float
    on_plane: float
    bears: float


class Coefficients(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The fitted model: log-odds = intercept + sum of weight times quantity.

    Attributes
    ----------
    intercept : float
    weights : dict of str to float
        A weight for each field of `Quantities`.
    places, cases : int
        Number of places and of judged objects from which it was fitted.
    """

    intercept: float
    weights: dict[str, float]
    places: int
    cases: int


def quantities_of(entry: MapObject) -> Quantities:
    """Return the quantities of an object whose box was fitted."""
    outline = entry.outline.tolist()  # so few numbers are faster without arrays
    total, judged = [sum(side) for side in outline], [sum(side[:HIDDEN]) for side in outline]
    free = [side[FREE] + side[SUPPORT] + 0.5 * side[UNSURE] for side in outline]
    prior = PRIOR_WEIGHT * max(1.0, sum(total))
    ends = (TOP, LEFT, RIGHT)
    top_free, *sides_free = [(free[k] + PRIOR_FREE * prior) / (judged[k] + prior) for k in ends]
    top_judged, *sides_judged = [(judged[k] + PRIOR_JUDGED * prior) / (total[k] + prior) for k in ends]
    shortest, middle, longest = sorted(entry.box.size.tolist())
    thickness = min(shortest / entry.noise_m, MAX_THICKNESS_SIGMAS) if entry.noise_m > 0.0 else MAX_THICKNESS_SIGMAS
    return Quantities(
        agreement=(entry.agreement + PRIOR_AGREEMENT) / (entry.compared + 1.0),
        matched=(entry.sightings + PRIOR_MATCHED) / (max(entry.shown, entry.sightings) + 1.0),
        whole=entry.whole_log_odds / (entry.scored + PRIOR_SCORED),
        unrepeated=1.0 / (entry.compared + 1.0),
        directions=math.log(max(1, len(entry.directions))),
        top_free=top_free,
        side_free=min(sides_free),
        top_judged=top_judged,
        side_judged=min(sides_judged),
        continuing=float(min(2, entry.continuing)),
        elongation=math.log(longest / middle),
        filled=math.log(0.01 + entry.filled),
        thickness=math.log(thickness),
        pixels=math.log1p(entry.largest_px),
        on_plane=float(entry.plane is not None),
        bears=float(entry.supports_plane),
    )


def probability(quantities: Quantities) -> float:
    """Return the probability that an object with these quantities is one whole thing, 0..1."""
    model, named = coefficients(), zip(Quantities._fields, quantities, strict=True)
    return _sigmoid(model.intercept + sum([model.weights[name] * quantity for name, quantity in named]))


@cache
def coefficients() -> Coefficients:
    """Return the fitted model in `objectness.json`."""
    content = resources.files(__package__).joinpath("objectness.json").read_bytes()
    return msgspec.json.decode(content, type=Coefficients)


def area_fraction(points: Float64Array, size_m: Float64Array, cell_m: float) -> float:
    """Return the area of points over the area of the surface of their box.

    Parameters
    ----------
    points : (N, 3)
        In the axes of the box, metres.
    size_m : (3,)
        Sides of the box.
    cell_m : float
        Edge of the cells that are counted, metres: each cell with a point has the area of one of its faces.
    """
    l, w, h = size_m.tolist()  # noqa: E741
    cells = np.unique(np.floor(points / cell_m).astype(np.int64) @ np.array([1, 1 << 20, 1 << 40]))
    return float(len(cells) * cell_m**2 / max(2.0 * (l * w + l * h + w * h), cell_m**2))


def _sigmoid(log_odds: float) -> float:
    return 1.0 / (1.0 + math.exp(-log_odds)) if log_odds > -700.0 else 0.0
