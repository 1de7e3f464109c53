"""Reliability of the probability of labels: of labels with probability p, a fraction p should be right."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cuboid.lab.evaluation.matching import ratio
from cuboid.lab.evaluation.result import IntArray

# Number of bins of equal width over the probabilities 0 to 1: a recording has ten to a hundred labels.
PROBABILITY_BINS = 5
# The object of a sighting that pairs with none.
NO_OBJECT = -1


@dataclass(frozen=True, slots=True)
class ReliabilityBin:
    """The labels whose probability lies in an interval.

    Attributes
    ----------
    low, high : float
        Limits of the probability; the upper one belongs to the next bin, except 1.
    labels, right : int
        Number of labels, and of right ones among them.
    mean_probability, fraction_right : float or None
        None without labels.
    """

    low: float
    high: float
    labels: int
    right: int
    mean_probability: float | None
    fraction_right: float | None


@dataclass(frozen=True, slots=True)
class Reliability:
    """The reliability of the probability of labels.

    Attributes
    ----------
    labels : int
        Number of judged labels with a probability.
    expected_calibration_error : float or None
        Mean difference between mean probability and fraction of right labels in a bin, weighted by its labels; None
        without labels.
    bins : tuple of ReliabilityBin
        By rising probability.
    """

    labels: int
    expected_calibration_error: float | None
    bins: tuple[ReliabilityBin, ...]


def right_labels(label: IntArray, item: IntArray) -> dict[int, bool]:
    """Return for each label whether it is right.

    A label is right if more than half of its judged sightings pair with one object, and if no other label is more
    frequent among the sightings of this object; of two equally frequent ones the smaller, older one is right.

    Parameters
    ----------
    label, item : (N,) int64
        The label of each judged sighting, and the object with which it pairs or `NO_OBJECT`.
    """
    pairs, count = np.unique(np.stack([item, label], axis=1), axis=0, return_counts=True)
    best: dict[int, tuple[int, int]] = {}  # of each object: the number of sightings of its label, and the label
    for (thing, name), number in zip(pairs.tolist(), count.tolist(), strict=True):
        if thing != NO_OBJECT and number > best.get(thing, (0, 0))[0]:
            best[thing] = number, name
    names, total = np.unique(label, return_counts=True)
    sightings = dict(zip(names.tolist(), total.tolist(), strict=True))
    right = {name for number, name in best.values() if 2 * number > sightings[name]}
    return {name: name in right for name in sightings}


def reliability(right: Mapping[int, bool], probability: Mapping[int, float]) -> Reliability:
    """Return the reliability of the labels that have a probability.

    The expected calibration error is that of Naeini, Cooper, Hauskrecht, "Obtaining Well Calibrated Probabilities
    Using Bayesian Binning", AAAI 2015, and Guo et al., "On Calibration of Modern Neural Networks", ICML 2017.

    Parameters
    ----------
    right : mapping of int to bool
        Whether each judged label is right.
    probability : mapping of int to float
        0..1 of each label.
    """
    rows = [(probability[name], is_right) for name, is_right in right.items() if name in probability]
    p, hit = (np.array(column, np.float64) for column in (zip(*rows, strict=True) if rows else ((), ())))
    number = np.minimum((p * PROBABILITY_BINS).astype(np.int64), PROBABILITY_BINS - 1)
    labels, hits, total = (np.bincount(number, weights, PROBABILITY_BINS) for weights in (None, hit, p))
    return _of_bins(list(zip(labels.tolist(), hits.tolist(), total.tolist(), strict=True)))


def pooled(parts: Iterable[Reliability]) -> Reliability:
    """Return the reliability of the labels of several recordings."""
    counts = np.zeros((PROBABILITY_BINS, 3))
    for part in parts:
        counts += [(one.labels, one.right, one.labels * (one.mean_probability or 0.0)) for one in part.bins]
    return _of_bins([(labels, right, total) for labels, right, total in counts.tolist()])


def _of_bins(counts: Sequence[tuple[float, float, float]]) -> Reliability:
    """Return the reliability from the number of labels, right labels, and the sum of probabilities in each bin."""
    bins = tuple(
        ReliabilityBin(
            k / PROBABILITY_BINS,
            (k + 1) / PROBABILITY_BINS,
            int(labels),
            int(right),
            ratio(total, labels),
            ratio(right, labels),
        )
        for k, (labels, right, total) in enumerate(counts)
    )
    labels = sum(one.labels for one in bins)
    gap = sum(abs(total - right) for _, right, total in counts)
    return Reliability(labels, ratio(gap, labels), bins)
