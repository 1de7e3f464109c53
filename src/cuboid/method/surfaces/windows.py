"""A table of the places of all planes: which planes may be relevant for a frame, a segment or another plane."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.state import Record
from cuboid.method.surfaces.grid import Places, cells_of
from cuboid.method.surfaces.plane import Plane

# End frame of a plane in use: it is never removed.
NEVER = np.iinfo(np.int64).max


@dataclass(slots=True, eq=False)
class Windows(Record):
    """A table with a row for each plane, by `Plane.index`; it filters planes by place, because heights exclude few.

    Attributes
    ----------
    max_unseen_frames : int
        A plane that is not in use expires when it was not seen for more frames than this.
    windows : (N, 4) int64
        First cell of each plane's ground plan, and the cell after the last.
    ends : (N,) int64
        Frame after which each plane is removed; `NEVER` for planes in use.
    weights : (N,) float64
        Weight of each plane's moments, -1 if it is not in use.
    means : (N, 3) float64
        Mean of each plane's points, in the plan frame.
    """

    max_unseen_frames: int
    windows: Places = field(default_factory=lambda: np.zeros((0, 4), np.int64))
    ends: Places = field(default_factory=lambda: np.zeros(0, np.int64))
    weights: Float64Array = field(default_factory=lambda: np.zeros(0))
    means: Float64Array = field(default_factory=lambda: np.zeros((0, 3)))

    def retain(self, keep: list[int]) -> None:
        """Keep only these planes, in this order."""
        self.windows, self.ends = self.windows[keep], self.ends[keep]
        self.weights, self.means = self.weights[keep], self.means[keep]

    def update(self, plane: Plane) -> None:
        """Add a new plane, or update the row of a plane."""
        k = plane.index
        if k == len(self.windows):
            self.windows = np.concatenate([self.windows, np.zeros((1, 4), np.int64)])
            self.ends, self.weights = np.append(self.ends, 0), np.append(self.weights, 0.0)
            self.means = np.concatenate([self.means, np.zeros((1, 3))])
        self.windows[k], self.means[k] = plane.plan.window, plane.mean
        self.ends[k] = NEVER if plane.in_use else plane.last_frame + self.max_unseen_frames
        self.weights[k] = plane.weight if plane.in_use else -1.0

    def expired(self, frame: int) -> list[int]:
        """Return the planes that have expired."""
        return [int(k) for k in np.flatnonzero(self.ends < frame)]

    def heaviest(self) -> int | None:
        """Return the plane in use with most weight, the first of equals; None if there is none."""
        k = int(self.weights.argmax()) if len(self.weights) else -1
        return k if k >= 0 and self.weights[k] >= 0 else None

    def within(self, window: Places) -> list[int]:
        """Return the planes whose windows overlap this one (4,), ascending."""
        w = self.windows
        meets = (w[:, 0] < window[2]) & (w[:, 1] < window[3]) & (w[:, 2] > window[0]) & (w[:, 3] > window[1])
        return [int(k) for k in np.flatnonzero(meets)]

    def level_with(self, plane: Plane, distance_m: float) -> list[int]:
        """Return the other planes whose windows overlap a plane's and whose means lie within a distance of it."""
        near = [k for k in self.within(plane.plan.window) if k != plane.index]
        return [near[i] for i in np.flatnonzero(np.abs(plane.height(self.means[near])) <= distance_m)]

    def at(self, points: Float64Array) -> list[int]:
        """Return the planes whose windows overlap the window of plan coordinates (N, 2 or 3)."""
        return self.within(window_of(points)) if len(points) else []


def window_of(points: Float64Array) -> Places:
    """Return the first cell and the cell after the last (4,) of plan coordinates (N, 2 or 3)."""
    cells = cells_of(np.stack([points.min(0), points.max(0)]))
    return np.concatenate([cells[0], cells[1] + 1])
