"""Confidence intervals of means over scenes, and comparison of two versions, by the bootstrap over scenes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from cuboid.ground.arrays import Float64Array

# B. Efron and R. Tibshirani, "An Introduction to the Bootstrap" (1993): percentiles of resampled means need thousands
# of samples.
RESAMPLES = 10_000
CONFIDENCE = 0.95

# Figures that differ by less than this are equal: rounding in a sum is no difference.
EQUAL_WITHIN = 1e-9


@dataclass(frozen=True, slots=True)
class Interval:
    """A mean over scenes.

    Attributes
    ----------
    mean : float
    low, high : float
        The 95 % confidence interval by resampling scenes; for a single scene, the figure itself.
    scenes : int
        Number of scenes with the figure.
    """

    mean: float
    low: float
    high: float
    scenes: int

    def to_dict(self) -> dict[str, Any]:
        """Return it ready for JSON."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class Paired:
    """A figure of two versions over their common scenes.

    Attributes
    ----------
    before, after : Interval
    difference : Interval
        After minus before, scene by scene.
    up, down, same : int
        Number of scenes in which the figure went up, went down, or stayed the same.
    """

    before: Interval
    after: Interval
    difference: Interval
    up: int
    down: int
    same: int

    @property
    def sure(self) -> bool:
        """Whether zero is outside the interval of the difference."""
        return not self.difference.low <= 0.0 <= self.difference.high

    def to_dict(self) -> dict[str, Any]:
        """Return it ready for JSON."""
        return {**asdict(self), "sure": self.sure}


def interval(values: Sequence[float] | Float64Array) -> Interval:
    """Return the mean of a figure over at least one scene, values (N,); the same values give the same interval."""
    array = np.asarray(values, np.float64)
    low, high = _interval(array)
    return Interval(float(array.mean()), low, high, len(array))


def intervals(rows: Sequence[Mapping[str, Any]], names: Sequence[str]) -> dict[str, Interval]:
    """Return the intervals of figures over the rows that have them; figures without rows are left out."""
    found = {name: [float(row[name]) for row in rows if row.get(name) is not None] for name in names}
    return {name: interval(values) for name, values in found.items() if values}


def compare(
    before: Mapping[str, Mapping[str, Any]], after: Mapping[str, Mapping[str, Any]], names: Sequence[str]
) -> dict[str, Paired]:
    """Compare figures of two versions, scene by scene.

    Parameters
    ----------
    before, after : mapping
        Figures by scene; scenes that are not in both are left out.
    names : sequence of str
        Names of figures; those that no scene has on both sides are left out.
    """
    found = {}
    for name in names:
        both = [
            (float(before[scene][name]), float(after[scene][name]))
            for scene in sorted(before.keys() & after.keys())
            if before[scene].get(name) is not None and after[scene].get(name) is not None
        ]
        if both:
            old, new = (np.array(side) for side in zip(*both, strict=True))
            change = new - old
            found[name] = Paired(
                interval(old),
                interval(new),
                interval(change),
                int((change > EQUAL_WITHIN).sum()),
                int((change < -EQUAL_WITHIN).sum()),
                int((np.abs(change) <= EQUAL_WITHIN).sum()),
            )
    return found


def _interval(values: Float64Array) -> tuple[float, float]:
    if len(values) == 1:
        return float(values[0]), float(values[0])
    chosen = np.random.default_rng(0).integers(0, len(values), (RESAMPLES, len(values)))
    tail = 50.0 * (1.0 - CONFIDENCE)
    low, high = np.percentile(values[chosen].mean(axis=1), (tail, 100.0 - tail))
    return float(low), float(high)
