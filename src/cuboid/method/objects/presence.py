"""Presence: the log-odds that labelled objects are still in their places, from depth along the rays to their points.

A reading at a point of an object shows that the object is there, one farther behind it that it is not, and one in front
shows neither. A frame that sees through nearly all visible points of an object is evidence that it is gone, one that
sees most of them in their place is evidence that it is there. In between, poses err or the place is partly taken.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import log

from cuboid.ground.core.tolerances import MIN_READINGS
from cuboid.method.objects.affinity import CERTAIN_LOG_ODDS

# Fractions of the visible points that a frame sees through: at least the first one of an object that is not there (its
# foot is too near to its support), less than the second one of an object that is there.
ABSENT_FRACTION, THERE_FRACTION = 0.8, 0.5
# Weight of a frame that sees no object in its place that is certainly there: its pose may be wrong.
UNCONFIRMED_WEIGHT = 0.2
# Fraction of frames that err: poses and depth are wrong.
ERROR_RATE = 0.15
FRAME_LOG_ODDS = log((1.0 - ERROR_RATE) / ERROR_RATE)
# Log-odds with which an object counts as there when the camera looks again, however long it was seen before.
THERE_LOG_ODDS = CERTAIN_LOG_ODDS / 2.0
# Doubt: the log-odds lost since. The object is rather gone than there above the first value, and certainly gone at the
# second one. Below zero it counts the evidence that it is there; at minus the second value it is certainly there.
DOUBTED, GONE = THERE_LOG_ODDS, THERE_LOG_ODDS + CERTAIN_LOG_ODDS


@dataclass(frozen=True, slots=True)
class Rays:
    """Counts of the points of an object in a frame: seen in their place, and seen through."""

    in_place: int
    through: int

    @property
    def enough(self) -> bool:
        """Whether they are enough to judge."""
        return self.through + self.in_place >= MIN_READINGS

    @property
    def fraction(self) -> float:
        """Fraction of the visible points that the frame sees through."""
        return self.through / max(1, self.through + self.in_place)


def doubts(rays: Mapping[int, Rays], before: Mapping[int, float], weight: float) -> dict[int, float]:
    """Return the doubt about objects after a frame.

    Parameters
    ----------
    rays : mapping of int to Rays
        What the frame shows of the labelled objects in view, by number.
    before : mapping of int to float
        Their doubt before, log-odds, from -`GONE` to `GONE`.
    weight : float
        Weight of the frame, 0..1.

    Returns
    -------
    dict of int to float
        The doubt about those that the frame shows.
    """
    shown = {number: one for number, one in rays.items() if one.enough}
    confirmed = any(one.fraction < THERE_FRACTION and before[number] <= -GONE for number, one in shown.items())
    after = {}
    for number, one in shown.items():
        if one.fraction >= ABSENT_FRACTION:
            lost = weight * FRAME_LOG_ODDS * (1.0 if confirmed else UNCONFIRMED_WEIGHT)
            after[number] = min(GONE, max(0.0, before[number]) + lost)
        elif one.fraction < THERE_FRACTION:
            after[number] = max(-GONE, before[number] - weight * FRAME_LOG_ODDS)
    return after
