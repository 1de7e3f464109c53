"""What a plain tracker can know of objects: their boxes, or the features of their surfaces."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.geometry.overlap import iou_matrix, pack
from cuboid.method.boxes.fit import fit_box
from features import FEATURES, KEYPOINTS, make_surface
from observations import Observation, Observed

# Features that an object keeps, the newest: four views of it.
KEPT = 4 * KEYPOINTS
VOXEL_M = 0.01
# Fraction of an object's points that may stick out of its box at each side.
STRAYS = 0.01


class Memory(Protocol):
    """What a method knows of the objects, by number from 0."""

    def describe(self, frame: Observed) -> list[Any]:
        """Return what the method compares, for each cluster."""

    def likeness(self, descriptions: list[Any]) -> Float64Array:
        """Return how like each cluster is to each object, 0..1, (N, M)."""

    def learn(self, number: int, cluster: Observation | None, description: Any) -> None:
        """Take in a cluster of an object; the next number makes a new one."""

    def bytes_an_object(self) -> float:
        """Return the memory that an object takes."""


class Boxes:
    """Objects as boxes, fitted to all points that they got."""

    def __init__(self) -> None:
        self._boxes = np.zeros((0, 15))
        self._points: dict[int, Float64Array] = {}

    def describe(self, frame: Observed) -> list[Any]:
        """Return each cluster's box."""
        return [pack([cluster.box]) for cluster in frame.clusters]

    def likeness(self, descriptions: list[Any]) -> Float64Array:
        """Return the IoU of boxes."""
        return iou_matrix(np.concatenate(descriptions), self._boxes)

    def learn(self, number: int, cluster: Observation | None, description: Any) -> None:
        """Fit the object's box anew."""
        if number == len(self._boxes):
            self._boxes = np.concatenate([self._boxes, description])
        if cluster is None:
            return
        points = cluster.points
        if number in self._points:
            points = np.concatenate([self._points[number], points])
        points = points[np.unique(np.floor(points / VOXEL_M).astype(np.int64), axis=0, return_index=True)[1]]
        self._points[number] = points
        normal, offset = (np.array([0.0, 0.0, 1.0]), None) if cluster.plane is None else cluster.plane
        self._boxes[number] = pack([fit_box(points, normal, offset, STRAYS)])[0]

    def bytes_an_object(self) -> float:
        """Return what nine numbers take."""
        return 9.0 * 8


class Features:
    """Objects as bags of their newest features; a cluster's keypoints vote by their nearest ones.

    Parameters
    ----------
    name : str
        Of `features.FEATURES`.
    radius : float
        A keypoint votes when its nearest feature is no farther.
    """

    def __init__(self, name: str, radius: float) -> None:
        self.dimensions, self._compute = FEATURES[name]
        self._radius = radius
        self._rows = np.zeros((0, self.dimensions), np.float32)
        self._square = np.zeros(0, np.float32)
        self._count: list[int] = []

    def describe(self, frame: Observed) -> list[Any]:
        """Return each cluster's features (K, D)."""
        found = []
        for cluster in frame.clusters:
            surface = make_surface(cluster.points, cluster.pixels, frame.width, frame.eye)
            found.append(self._compute(surface).astype(np.float32))
        return found

    def likeness(self, descriptions: list[Any]) -> Float64Array:
        """Return the shares of votes; the nearest features are found exactly, by one product of matrices."""
        votes = np.zeros((len(descriptions), len(self._count)))
        used = len(self._count) * KEPT
        asked = np.concatenate(descriptions)
        away = asked @ self._rows[:used].T
        away *= -2.0
        away += self._square[:used]
        nearest = away.argmin(1)
        near = away[np.arange(len(asked)), nearest] + (asked**2).sum(1) <= self._radius**2
        which = np.repeat(np.arange(len(descriptions)), [len(one) for one in descriptions])
        np.add.at(votes, (which[near], nearest[near] // KEPT), 1.0)
        fractions: Float64Array = votes / np.bincount(which, minlength=len(descriptions))[:, None]
        return fractions

    def learn(self, number: int, cluster: Observation | None, description: Any) -> None:
        """Keep features in place of the oldest ones."""
        if number == len(self._count):
            self._count.append(0)
            if len(self._count) * KEPT > len(self._rows):
                more = max(16 * KEPT, len(self._rows))
                self._rows = np.concatenate([self._rows, np.zeros((more, self.dimensions), np.float32)])
                self._square = np.concatenate([self._square, np.full(more, np.inf, np.float32)])
        places = number * KEPT + (self._count[number] + np.arange(len(description))) % KEPT
        self._rows[places], self._square[places] = description, (description**2).sum(1)
        self._count[number] += len(description)

    def bytes_an_object(self) -> float:
        """Return what the kept features take."""
        return KEPT * self.dimensions * 4.0
