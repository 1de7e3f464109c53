"""Measures of the objects on one surface: length, width, height, how sure they are, and how near each is to a box."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import Any

import numpy as np

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.results import MapPoints, TrackedObject
from cuboid.ground.core.sizes import SIGMAS_95
from cuboid.ground.geometry.box import Box

# Metres and digits after the point of each unit of length.
UNITS = {"mm": (0.001, 1), "cm": (0.01, 2), "in": (0.0254, 2)}
# An object is the known one if no side differs by more than this fraction.
KNOWN_TOLERANCE = 0.15


@dataclass(frozen=True, slots=True)
class Measure:
    """The measures of an object.

    Attributes
    ----------
    item : TrackedObject
    off_box_m : float
        How far it is from being a box, metres; see `off_box_m`.
    """

    item: TrackedObject
    off_box_m: float

    @property
    def within_m(self) -> Float64Array:
        """Half the 95 % intervals of length, width and height, (3,) metres."""
        return SIGMAS_95 * np.array(self.item.size_sigma_m)

    def text(self, unit: str) -> str:
        """Return the line that `cuboid measure` prints."""
        metres, digits = UNITS[unit]
        sides, within = (
            " x ".join(f"{value / metres:.{digits}f}" for value in values)
            for values in (self.item.box.size, self.within_m)
        )
        off = f"{self.off_box_m / metres:.{digits}f} {unit} off the shape of a box"
        name = f" {self.item.name}" if self.item.name else ""
        volume = f"box volume {_volume_text(self.item.box.volume)}"
        return f"#{self.item.label}{name}: {sides} {unit} ± {within}, {volume}, {off}"

    def to_dict(self) -> dict[str, Any]:
        """Return the measures ready for JSON, in metres."""
        item = self.item
        return {
            "label": item.label,
            "name": item.name,
            "size_m": _rounded(item.box.size),
            "size_within_m": _rounded(self.within_m),
            "size_sigma_m": _rounded(item.size_sigma_m),
            "center_m": _rounded(item.box.center),
            "center_sigma_m": _rounded(item.center_sigma_m),
            "sides_seen": list(item.sides_seen),
            "box_volume_m3": round(item.box.volume, 9),
            "off_box_m": round(self.off_box_m, 6),
            "probability": round(item.probability, 6),
        }


@dataclass(frozen=True, slots=True)
class Scale:
    """The error of scale from an object of known size.

    Attributes
    ----------
    label : int
        The object.
    measured : float
        Measured length of one metre, metres.
    sigma : float
        Its standard deviation.
    """

    label: int
    measured: float
    sigma: float

    @property
    def clear(self) -> bool:
        """Whether the error is larger than its own uncertainty, 95 %."""
        return abs(self.measured - 1.0) > SIGMAS_95 * self.sigma

    def text(self) -> str:
        """Return the line that `cuboid measure` prints."""
        found = "a clear error of scale" if self.clear else "no clear error of scale"
        within = SIGMAS_95 * self.sigma
        return (
            f"object #{self.label} is the known one: one metre measures {self.measured:.4f} ± {within:.4f} m, {found}"
        )


def measures_of(objects: Iterable[TrackedObject], points: MapPoints, in_view: Collection[int]) -> list[Measure]:
    """Return the measures of the objects on the surface in front of the camera, by label.

    It is the supporting plane beneath most of the objects in view.

    Parameters
    ----------
    objects : iterable of TrackedObject
    points : MapPoints
        The points of the map, with labels.
    in_view : collection of int
        Labels of the objects that the last frames show.
    """
    standing = [item for item in objects if item.kind == "volume" and item.plane is not None]
    count = Counter(item.plane for item in standing if item.label in in_view)
    if not count:
        return []
    surface = max(count, key=lambda plane: (count[plane], -(plane or 0)))
    return [
        Measure(item, off_box_m(item.box, points.of_object(item.label).xyz))
        for item in standing
        if item.plane == surface
    ]


def off_box_m(box: Box, points: Float32Array) -> float:
    """Return how far a body is from being a box, metres.

    It is the larger one of two distances: the root mean square distance of its points from the surface of its box, and
    the median distance of the corners of the top from its points. A box has some millimetres, a can a fifth of its
    diameter.

    Parameters
    ----------
    box : Box
    points : (N, 3) float32
        World, metres.
    """
    if not len(points):
        return 0.0
    local, half = (points.astype(np.float64) - box.center) @ box.rotation, box.size / 2.0
    inside = half - np.abs(local)
    outside_m = np.linalg.norm(np.maximum(-inside, 0.0), axis=1)
    nearest_m = np.minimum(inside[:, :2].min(1), half[2] - local[:, 2])
    spread_m = np.sqrt(np.mean(np.where(outside_m > 0.0, outside_m, nearest_m) ** 2))
    corners = np.array([(x, y, 1.0) for x in (-1.0, 1.0) for y in (-1.0, 1.0)]) * half
    corners_m = np.linalg.norm(corners[:, None] - local, axis=2).min(1)
    return float(max(spread_m, np.median(corners_m)))


def scale_of(measures: Sequence[Measure], known_m: Sequence[float]) -> Scale:
    """Return the error of scale from the object with known sides (3), metres, in any order.

    Raises
    ------
    InputError
        No object has about these sides.
    """
    known = np.array(known_m)
    fits = [
        (float(np.abs(one.item.box.size / known[list(order)] - 1.0).max()), one.item.label, one, known[list(order)])
        for one in measures
        for order in permutations(range(3))
    ]
    off, _, best, sides = min(fits, key=lambda fit: fit[:2], default=(np.inf, 0, None, known))
    if best is None or off > KNOWN_TOLERANCE:
        wanted = " x ".join(f"{1000 * side:.0f}" for side in known)
        found = "; ".join(one.text("mm").partition(" ±")[0] for one in measures) or "nothing"
        raise InputError(f"no object is within {KNOWN_TOLERANCE:.0%} of the known {wanted} mm; measured: {found}")
    sigma = np.array(best.item.size_sigma_m)
    weight = (sides / sigma) ** 2
    measured = float(weight @ (best.item.box.size / sides) / weight.sum())
    return Scale(best.item.label, measured, float(1.0 / np.sqrt(weight.sum())))


def _volume_text(volume_m3: float) -> str:
    """Return a volume in litres, or in cubic centimetres below one litre."""
    return f"{1e3 * volume_m3:.2f} l" if volume_m3 >= 1e-3 else f"{1e6 * volume_m3:.0f} cm3"


def _rounded(values: Iterable[float]) -> list[float]:
    return [round(float(value), 6) for value in values]
